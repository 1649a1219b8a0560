"""What six wheels and an accelerometer say about a rover's nodes; no gyro needed.

Between nodes i and j, with Q = R_i^T R_j, phi = Log Q, k the slip coefficient, d the wheels' own
displacement of their centroid c (body axes of the middle of the interval), w their yaw, s the way
they rolled and a the part of it ahead:

    wheel_displacement  R_i^T (p_j - p_i) + Q c_j - c_i - Exp(phi/2) (k d + b s e_x) = 0      (C2)
    wheel_yaw           phi_z - (k w + (t + y) a) = 0                                         (C4)
    tilt                phi_x, phi_y = 0, loosely
    wheel_speed         R^T v - k u = 0

with calibrations k slip coefficient, b side slip, t toe (steady steering errors), y yaw slip
(wheels slipping unlike each other), e accelerometer bias. One k in the first two is C6: a heading
sensor or gyro that sees a turn measures the slip.
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import (
    NODE_DIM,
    PHASE,
    POSITION,
    ROTATION,
    VELOCITY,
    Array,
    Block,
    Scope,
    Term,
    between,
    whitened,
)
from factors.calibration import (
    SIDE_SLIP,
    SLIP_COEFFICIENT,
    TOE,
    YAW_SLIP,
    Component,
    Layout,
)
from factors.estimate import Estimate

AXES = ("right", "forward", "up")
E_X = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class WheelSums:
    """The wheels' motion summed over each of n intervals, at k_s = 1."""

    displacement: Array  # (n, 3) m, of the centroid, axes of the middle of the interval
    path: Array  # (n,) m, way rolled, never negative
    ahead: Array  # (n,) m, way forward, negative in reverse
    yaw: Array  # (n,) rad, left positive
    centroid_b: Array  # (n + 1, 3) m, at the nodes


@dataclass(frozen=True)
class Turns:
    """Rotation over all intervals, shared by the factors between nodes."""

    Q: Array  # (n, 3, 3) R_i^T R_j
    phi: Array  # (n, 3) Log Q
    dphi_i: Array  # (n, 3, 3) d phi / d theta_i
    dphi_j: Array  # (n, 3, 3)


def turns(R_nb: Array) -> Turns:
    """Rotations between consecutive nodes (N, 3, 3)."""
    Q = so3.transpose(R_nb[:-1]) @ R_nb[1:]
    phi = so3.log(Q)
    return Turns(Q, phi, -so3.right_jacobian_inverse(-phi), so3.right_jacobian_inverse(phi))


def wheel_displacement(
    sums: WheelSums, turn: Turns, sigma: Array, layout: Layout, scope: Scope, x: Estimate
) -> Block:
    """C2 integrated over intervals: 3 rows [right, forward, up] m in node i; `sigma` (n, 3) m."""
    n = len(sums.path)
    at_k, at_b = layout.column(SLIP_COEFFICIENT), layout.column(SIDE_SLIP)
    k, b = x.calibration[scope.segment, at_k], x.calibration[scope.segment, at_b]
    Rit = so3.transpose(x.R_nb[:-1])
    c_i, c_j = sums.centroid_b[:-1], sums.centroid_b[1:]
    H = so3.exp(0.5 * turn.phi)
    u = k[:, None] * sums.displacement + (b * sums.path)[:, None] * E_X
    q, Qc = so3.mv(Rit, x.p_n[1:] - x.p_n[:-1]), so3.mv(turn.Q, c_j)
    swing = 0.5 * H @ so3.skew(u) @ so3.right_jacobian(0.5 * turn.phi)
    J_i, J_j = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, NODE_DIM))
    J_i[:, :, ROTATION] = so3.skew(q + Qc) + swing @ turn.dphi_i
    J_j[:, :, ROTATION] = -turn.Q @ so3.skew(c_j) + swing @ turn.dphi_j
    J_i[:, :, POSITION], J_j[:, :, POSITION] = -Rit, Rit
    J_c = np.zeros((n, 3, layout.dim))
    J_c[:, :, at_k] = -so3.mv(H, sums.displacement)
    J_c[:, :, at_b] = -sums.path[:, None] * H[:, :, 0]
    residual = q + Qc - c_i - so3.mv(H, u)
    terms = between(scope, J_i, J_j, J_c)
    return whitened(kinds.WHEEL_DISPLACEMENT, AXES, scope.time, residual, sigma, terms)


def wheel_yaw(
    sums: WheelSums, turn: Turns, sigma: Array, layout: Layout, scope: Scope, x: Estimate
) -> Block:
    """C4 integrated over every interval: 1 row, rad; `sigma` (n,)."""
    n = len(sums.path)
    at_k, at_t, at_y = (layout.column(name) for name in (SLIP_COEFFICIENT, TOE, YAW_SLIP))
    c = x.calibration[scope.segment]
    k, stray = c[:, at_k], c[:, [at_t, at_y]].sum(axis=1)
    J_i, J_j = np.zeros((n, 1, NODE_DIM)), np.zeros((n, 1, NODE_DIM))
    J_i[:, 0, ROTATION], J_j[:, 0, ROTATION] = turn.dphi_i[:, 2], turn.dphi_j[:, 2]
    J_c = np.zeros((n, 1, layout.dim))
    J_c[:, 0, at_k] = -sums.yaw
    J_c[:, 0, at_t] = J_c[:, 0, at_y] = -sums.ahead
    residual = (turn.phi[:, 2] - k * sums.yaw - stray * sums.ahead)[:, None]
    terms = between(scope, J_i, J_j, J_c)
    return whitened(kinds.WHEEL_YAW, ("yaw",), scope.time, residual, sigma[:, None], terms)


def tilt(turn: Turns, sigma: Array, scope: Scope) -> Block:
    """The ground's slope changes little over an interval: 2 rows, rad; `sigma` (n,)."""
    n = len(turn.phi)
    J_i, J_j = np.zeros((n, 2, NODE_DIM)), np.zeros((n, 2, NODE_DIM))
    J_i[:, :, ROTATION], J_j[:, :, ROTATION] = turn.dphi_i[:, :2], turn.dphi_j[:, :2]
    terms = (Term("x", scope.node, J_i), Term("x", scope.node + 1, J_j))
    both = np.repeat(sigma[:, None], 2, axis=1)
    return whitened(kinds.TILT, ("pitch", "roll"), scope.time, turn.phi[:, :2], both, terms)


def wheel_speed(u_b: Array, sigma: Array, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """Velocity of the body origin (n, 3) m/s at nodes, at k_s = 1; `sigma` (n,)."""
    n, at_k = len(u_b), layout.column(SLIP_COEFFICIENT)
    R = x.R_nb[scope.node]
    v_b = so3.mtv(R, x.v_n[scope.node])
    J, J_c = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, layout.dim))
    J[:, :, ROTATION], J[:, :, VELOCITY] = so3.skew(v_b), so3.transpose(R)
    J_c[:, :, at_k] = -u_b
    residual = v_b - x.calibration[scope.segment, at_k][:, None] * u_b
    terms = (Term("x", scope.node, J), Term("c", scope.segment, J_c))
    all_axes = np.repeat(sigma[:, None], 3, axis=1)
    return whitened(kinds.WHEEL_SPEED, AXES, scope.time, residual, all_axes, terms)


def unused_phase(time: Array, x: Estimate) -> Block:
    """Holds the nodes' pulse phase, which a rover has no use for, at zero."""
    n = len(x.phase)
    J = np.zeros((n, 1, NODE_DIM))
    J[:, 0, PHASE] = 1.0
    term = Term("x", np.arange(n), J)
    return Block(kinds.PHASE, ("phase",), time, x.phase[:, None], (term,))


@dataclass(frozen=True)
class Wandering:
    """A calibration that wanders with the distance driven and returns to its mean.

    Gauss-Markov: `sd` at any place, correlated over `length` m. Stated as a random walk between
    segments plus a pull towards the mean, which together have that stationary covariance.
    """

    component: Component
    length: float  # m


def wander(
    layout: Layout, wandering: tuple[Wandering, ...], calibration: Array, path: Array, time: Array
) -> list[Block]:
    """Steps between segments (constants hold) and pull to the mean of what wanders.

    `path` (K,) m driven up to the middle of each segment, `time` (K,) s.
    """
    K, dim = calibration.shape
    step = np.maximum(np.diff(path), 0.02)
    gap = np.sqrt(np.maximum(np.diff(time), 1e-3))[:, None] * layout.walk
    pull = np.zeros((K, dim))
    reach = np.maximum(np.gradient(path) if K > 1 else np.ones(1), 0.02)
    for w in wandering:
        at = layout.slices[w.component.name]
        gap[:, at] = w.component.sd * np.sqrt(2 * step / w.length)[:, None]
        pull[:, at] = np.sqrt(reach / (2 * w.length))[:, None] / w.component.sd
    index = np.arange(K - 1)
    across = np.eye(dim) / gap[:, :, None]
    names = tuple(str(i) for i in range(dim))
    steps = Block(
        kinds.CALIBRATION_WALK,
        names,
        time[1:],
        np.diff(calibration, axis=0) / gap,
        (Term("c", index, -across), Term("c", index + 1, across)),
    )
    to_mean = Block(
        kinds.CALIBRATION_MEAN,
        names,
        time,
        (calibration - layout.prior) * pull,
        (Term("c", np.arange(K), np.eye(dim) * pull[:, :, None]),),
    )
    return [steps, to_mean]


@dataclass(frozen=True)
class Bounds:
    """Between which a calibration is to stay, and how hard it is held back."""

    name: str
    low: float
    high: float
    sigma: float


def bounded(bounds: Bounds, layout: Layout, time: Array, x: Estimate) -> Block:
    """Softly keeps a calibration within bounds (C6's clip): a row only where it lies outside."""
    at = layout.column(bounds.name)
    value = x.calibration[:, at]
    excess = np.where(value > bounds.high, value - bounds.high, 0.0)
    excess = np.where(value < bounds.low, value - bounds.low, excess)
    J = np.zeros((len(value), 1, layout.dim))
    J[:, 0, at] = (excess != 0) / bounds.sigma
    term = Term("c", np.arange(len(value)), J)
    residual = (excess / bounds.sigma)[:, None]
    return Block(kinds.BOUNDS, (bounds.name,), time, residual, (term,))
