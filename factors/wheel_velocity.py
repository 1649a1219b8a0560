"""What six wheels and an accelerometer say about a rover's nodes; no gyro needed.

Between nodes i and j, with Q = R_i^T R_j, phi = Log Q, k the slip coefficient, d the wheels' own
displacement of their centroid c (body axes of the middle of the interval), w their yaw, s the way
they rolled and a the part of it ahead:

    wheel_displacement  R_i^T (p_j - p_i) + Q c_j - c_i - Exp(phi/2) (k d + b s e_x) = 0      (C2)
    wheel_yaw           phi_z - (k w + (t + y) a) = 0                                         (C4)
    tilt                phi_x, phi_y = 0, loosely
    level               (f - e - R^T (-g_n))_x,y = 0                                          (C5)
    wheel_speed         R^T v - k u = 0

with calibrations k slip coefficient, b side slip, t toe (steady steering errors), y yaw slip
(wheels slipping unlike each other), e accelerometer bias. One k in the first two is C6: a heading
sensor or gyro that sees a turn measures the slip.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Block, Index, Term, whitened
from factors.calibration import Component, Layout

Array = NDArray[np.float64]

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
class Interval:
    """Geometry of all intervals, shared by the factors between nodes."""

    Q: Array  # (n, 3, 3)
    phi: Array  # (n, 3)
    dphi_i: Array  # (n, 3, 3) d phi / d theta_i
    dphi_j: Array  # (n, 3, 3)


def interval(R: Array) -> Interval:
    """Rotations between consecutive nodes `R` (N, 3, 3)."""
    Q = so3.transpose(R[:-1]) @ R[1:]
    phi = so3.log(Q)
    return Interval(Q, phi, -so3.right_jacobian_inverse(-phi), so3.right_jacobian_inverse(phi))


def wheel_displacement(
    sums: WheelSums,
    turn: Interval,
    R: Array,
    p: Array,
    calibration: Array,
    layout: Layout,
    segment: Index,
    sigma: Array,
    time: Array,
) -> Block:
    """C2 integrated: 3 rows [right, forward, up] m in node i; `sigma` (n, 3), `time` (N,)."""
    n = len(sums.path)
    at_k, at_b = layout.column("slip_coefficient"), layout.column("side_slip")
    k, b = calibration[segment, at_k], calibration[segment, at_b]
    Rit = so3.transpose(R[:-1])
    c_i, c_j = sums.centroid_b[:-1], sums.centroid_b[1:]
    H = so3.exp(0.5 * turn.phi)
    u = k[:, None] * sums.displacement + (b * sums.path)[:, None] * E_X
    q, Qc = so3.mv(Rit, p[1:] - p[:-1]), so3.mv(turn.Q, c_j)
    swing = 0.5 * H @ so3.skew(u) @ so3.right_jacobian(0.5 * turn.phi)
    J_i, J_j = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, NODE_DIM))
    J_i[:, :, ROTATION] = so3.skew(q + Qc) + swing @ turn.dphi_i
    J_j[:, :, ROTATION] = -turn.Q @ so3.skew(c_j) + swing @ turn.dphi_j
    J_i[:, :, POSITION], J_j[:, :, POSITION] = -Rit, Rit
    J_c = np.zeros((n, 3, layout.dim))
    J_c[:, :, at_k] = -so3.mv(H, sums.displacement)
    J_c[:, :, at_b] = -sums.path[:, None] * H[:, :, 0]
    index = np.arange(n)
    terms = (Term("x", index, J_i), Term("x", index + 1, J_j), Term("c", segment, J_c))
    residual = q + Qc - c_i - so3.mv(H, u)
    axes = ("right", "forward", "up")
    return whitened("wheel_displacement", axes, time[1:], residual, sigma, terms)


def wheel_yaw(
    sums: WheelSums,
    turn: Interval,
    calibration: Array,
    layout: Layout,
    segment: Index,
    sigma: Array,
    time: Array,
) -> Block:
    """C4 integrated: 1 row, rad; `sigma` (n,)."""
    n = len(sums.path)
    at_k, at_t, at_y = (layout.column(x) for x in ("slip_coefficient", "toe", "yaw_slip"))
    k, stray = calibration[segment, at_k], calibration[segment][:, [at_t, at_y]].sum(axis=1)
    J_i, J_j = np.zeros((n, 1, NODE_DIM)), np.zeros((n, 1, NODE_DIM))
    J_i[:, 0, ROTATION], J_j[:, 0, ROTATION] = turn.dphi_i[:, 2], turn.dphi_j[:, 2]
    J_c = np.zeros((n, 1, layout.dim))
    J_c[:, 0, at_k] = -sums.yaw
    J_c[:, 0, at_t] = J_c[:, 0, at_y] = -sums.ahead
    index = np.arange(n)
    terms = (Term("x", index, J_i), Term("x", index + 1, J_j), Term("c", segment, J_c))
    residual = (turn.phi[:, 2] - k * sums.yaw - stray * sums.ahead)[:, None]
    return whitened("wheel_yaw", ("yaw",), time[1:], residual, sigma[:, None], terms)


def tilt(turn: Interval, sigma: Array, time: Array) -> Block:
    """The ground's slope changes little over an interval: 2 rows, rad; `sigma` (n,)."""
    n = len(turn.phi)
    J_i, J_j = np.zeros((n, 2, NODE_DIM)), np.zeros((n, 2, NODE_DIM))
    J_i[:, :, ROTATION], J_j[:, :, ROTATION] = turn.dphi_i[:, :2], turn.dphi_j[:, :2]
    index = np.arange(n)
    terms = (Term("x", index, J_i), Term("x", index + 1, J_j))
    both = np.repeat(sigma[:, None], 2, axis=1)
    return whitened("tilt", ("pitch", "roll"), time[1:], turn.phi[:, :2], both, terms)


def level(
    force_b: Array,
    node: Index,
    R: Array,
    g_n: Array,
    calibration: Array,
    layout: Layout,
    segment: Index,
    sigma: Array,
    time: Array,
) -> Block:
    """C5, quasi-static: mean specific force (n, 3) at nodes `node`; rows [right, forward] m/s^2.

    `g_n` (3,) gravity, `segment` (n,) of each node, `sigma` (n,) m/s^2, `time` (n,).
    """
    n = len(node)
    bias = layout.slices["accel_bias"]
    up_b = so3.mtv(R[node], -g_n)
    J, J_c = np.zeros((n, 2, NODE_DIM)), np.zeros((n, 2, layout.dim))
    J[:, :, ROTATION] = -so3.skew(up_b)[:, :2]
    J_c[:, :, bias] = -np.eye(3)[:2]
    residual = (force_b - calibration[segment, bias] - up_b)[:, :2]
    both = np.repeat(sigma[:, None], 2, axis=1)
    terms = (Term("x", node, J), Term("c", segment, J_c))
    return whitened("level", ("right", "forward"), time, residual, both, terms)


def wheel_speed(
    u_b: Array,
    R: Array,
    v: Array,
    calibration: Array,
    layout: Layout,
    segment: Index,
    sigma: Array,
    time: Array,
) -> Block:
    """Velocity of the body origin (N, 3) m/s at every node, at k_s = 1; `segment`, `sigma` (N,)."""
    n = len(u_b)
    at_k = layout.column("slip_coefficient")
    v_b = so3.mtv(R, v)
    J, J_c = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, layout.dim))
    J[:, :, ROTATION], J[:, :, VELOCITY] = so3.skew(v_b), so3.transpose(R)
    J_c[:, :, at_k] = -u_b
    residual = v_b - calibration[segment, at_k][:, None] * u_b
    terms = (Term("x", np.arange(n), J), Term("c", segment, J_c))
    all_axes = np.repeat(sigma[:, None], 3, axis=1)
    return whitened("wheel_speed", ("right", "forward", "up"), time, residual, all_axes, terms)


def unused_phase(phase: Array, time: Array) -> Block:
    """Holds the nodes' pulse phase, which a rover has no use for, at zero (N,)."""
    J = np.zeros((len(phase), 1, NODE_DIM))
    J[:, 0, -1] = 1.0
    term = Term("x", np.arange(len(phase)), J)
    return Block("phase", ("phase",), time, phase[:, None], (term,))


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
        "calibration_walk",
        names,
        time[1:],
        np.diff(calibration, axis=0) / gap,
        (Term("c", index, -across), Term("c", index + 1, across)),
    )
    to_mean = Block(
        "calibration_mean",
        names,
        time,
        (calibration - layout.prior) * pull,
        (Term("c", np.arange(K), np.eye(dim) * pull[:, :, None]),),
    )
    return [steps, to_mean]


def bounds(
    layout: Layout,
    name: str,
    low: float,
    high: float,
    sigma: float,
    calibration: Array,
    time: Array,
) -> Block:
    """Softly keeps a calibration within bounds (C6's clip): a row only where it lies outside."""
    at = layout.column(name)
    value = calibration[:, at]
    excess = np.where(value > high, value - high, np.where(value < low, value - low, 0.0))
    J = np.zeros((len(value), 1, layout.dim))
    J[:, 0, at] = (excess != 0) / sigma
    term = Term("c", np.arange(len(value)), J)
    return Block("bounds", (name,), time, (excess / sigma)[:, None], (term,))
