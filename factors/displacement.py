"""Displacement factor: the odometer's corrected motion between two nodes (B4 with A17-A24).

With `C_k` the gyro-integrated rotation since node i and `d_k` the odometer's distance steps, the
vehicle point moves, in the body frame of node i,

    D = (f (1 + s) [sum C_k d_k] - h [sum C_k |dpsi_k| sign d_k]) R_bm e_y
      - (kappa L [sum C_k dpsi_k] - tau [sum C_k d_k psi_dot_k]) R_bm e_x

(forward: A19/A20/A23; lateral: A17 for tracks, and for tyres the slip angle they need to hold a
bend, `v_x = tau v_y psi_dot` outwards). The residual is

    r = R_i^T (p_j - p_i) + (R_i^T R_j - I) l - D,

told in the vehicle frame at the middle of the interval so that its rows are lateral, forward and
vertical. Divided by the interval it is the mean velocity of B4. A pulse counter is wrong by its
phase q (less than a pulse) at every node, the same error for the interval before and the one after:
q is a state of the node, so quantisation is bounded and anticorrelated as it is in truth.
"""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.block import NODE_DIM, PHASE, POSITION, ROTATION, Array, Block, Index, Term, whitened

AXES = ("lateral", "forward", "vertical")
E_X, E_Y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])


@dataclass(frozen=True)
class OdometerSums:
    """`sum C_k (.)` over each interval, (n, 3, 3) each; accumulated once per relinearisation."""

    distance: Array  # of d_k [m]
    distance_rate: Array  # d/d(delay) of it [m/s]
    distance_late: Array  # of t_k d_k [m s], for the gyro bias
    turn: Array  # of dpsi_k [rad]
    turn_abs: Array  # of |dpsi_k| sign(d_k) [rad]
    bend: Array  # of d_k psi_dot_k [m rad/s]
    R_mid: Array  # (n, 3, 3) mean rotation since node i, orthonormal
    delay: float  # s, delay and
    bias: Array  # (n, 3) rad/s, gyro bias (less the Earth's rate) the sums were made with

    def of(self, on: Index) -> "OdometerSums":
        """The sums of some intervals."""
        arrays = {k: v[on] for k, v in self.__dict__.items() if k != "delay"}
        return OdometerSums(**arrays, delay=self.delay)


@dataclass(frozen=True)
class Correction:
    """How the odometer is to be read in each interval; columns are -1 where not calibrated."""

    forward: Array  # (n,) f where it is not calibrated
    gauge: Array  # (n,) h [m]
    lateral: Array  # (n,) kappa L [m] where it is not calibrated
    forward_column: Index  # (n,) calibration column of f
    lateral_column: Index  # (n,) calibration column of kappa L
    sigma: Array  # (n, 3) m, one sigma of lateral, forward, vertical


@dataclass(frozen=True)
class Columns:
    """Calibration columns the factor uses; -1 leaves a quantity out."""

    scale: int
    mounting: int  # pitch, heading
    lever: int
    delay: int
    cornering: int = -1  # tau [s]


@dataclass(frozen=True)
class Mounting:
    """The vehicle frame in the body: `R_bm = Exp([pitch, roll, heading])`, roll fixed."""

    R_bm: Array  # (n, 3, 3)
    jacobian: Array  # (n, 3, 2) right perturbation of R_bm per pitch and heading


def mounting(pitch_heading: Array, roll: float) -> Mounting:
    """Mounting rotations of (n, 2) pitch and heading angles [rad] (B2)."""
    vector = np.stack(
        [pitch_heading[:, 0], np.full(len(pitch_heading), roll), pitch_heading[:, 1]], -1
    )
    return Mounting(so3.exp(vector), so3.right_jacobian(vector)[:, :, [0, 2]])


def displacement(
    sums: OdometerSums,
    correction: Correction,
    columns: Columns,
    roll: float,
    node: Index,
    R: Array,
    p: Array,
    phase: Array,
    c: Array,
    segment: Index,
    time: Array,
) -> Block:
    """Displacement factors over the intervals that start at nodes `node` (n,).

    Args: `R` (N, 3, 3), `p` (N, 3), `phase` (N,) of all nodes; `c` (n, dim) the calibration in
    force in each interval, from segment `segment` (n,); `time` (n,) s, ends of the intervals.
    Returns a block of 3 rows [lateral, forward, vertical], whitened by `correction.sigma`.
    """
    n = len(node)
    mount = mounting(c[:, columns.mounting : columns.mounting + 2], roll)
    lever = c[:, columns.lever : columns.lever + 3]
    ex, ey = mount.R_bm @ E_X, mount.R_bm @ E_Y
    forward = _calibrated(c, correction.forward_column, correction.forward)
    lateral = _calibrated(c, correction.lateral_column, correction.lateral)
    gain = forward * (1 + c[:, columns.scale])
    sideways = lateral[:, None, None] * sums.turn
    if columns.cornering >= 0:
        sideways = sideways - c[:, columns.cornering, None, None] * sums.bend
    distance = sums.distance
    if columns.delay >= 0:
        late = c[:, columns.delay] - sums.delay
        distance = distance + late[:, None, None] * sums.distance_rate
    travel = so3.mv(distance, ey)
    swerve = gain[:, None] * so3.mv(sums.distance_late, ey)
    turned = so3.mv(sums.turn, ex)
    # vectors in the frame of node i, turned into the vehicle frame at mid-interval at the end
    D = gain[:, None] * travel - correction.gauge[:, None] * so3.mv(sums.turn_abs, ey)
    D = D - so3.mv(sideways, ex) + so3.cross(swerve, c[:, 0:3] - sums.bias)
    R_i, R_j = R[node], R[node + 1]
    R_ij = so3.transpose(R_i) @ R_j
    moved = so3.mtv(R_i, p[node + 1] - p[node])
    to_m = so3.transpose(sums.R_mid @ mount.R_bm)
    arm = so3.mv(R_ij, lever)
    r = so3.mv(to_m, moved + arm - lever - D)
    r[:, 1] += phase[node + 1] - phase[node]

    J_i, J_j, J_c = (
        np.zeros((n, 3, NODE_DIM)),
        np.zeros((n, 3, NODE_DIM)),
        np.zeros((n, 3, c.shape[1])),
    )
    J_i[:, :, ROTATION] = to_m @ so3.skew(moved + arm)
    J_j[:, :, ROTATION] = -to_m @ R_ij @ so3.skew(lever)
    J_j[:, :, POSITION] = to_m @ so3.transpose(R_i)
    J_i[:, :, POSITION] = -J_j[:, :, POSITION]
    J_i[:, 1, PHASE], J_j[:, 1, PHASE] = -1.0, 1.0

    def in_m(x: Array) -> Array:
        return so3.mv(to_m, x)

    J_c[:, :, 0:3] = -to_m @ so3.skew(swerve)
    J_c[:, :, columns.scale] = -in_m(forward[:, None] * travel)
    if columns.delay >= 0:
        J_c[:, :, columns.delay] = -in_m(gain[:, None] * so3.mv(sums.distance_rate, ey))
    if columns.cornering >= 0:
        J_c[:, :, columns.cornering] = -in_m(so3.mv(sums.bend, ex))
    tilt = gain[:, None, None] * distance @ mount.R_bm @ so3.skew(E_Y)
    tilt = tilt - correction.gauge[:, None, None] * sums.turn_abs @ mount.R_bm @ so3.skew(E_Y)
    tilt = tilt - sideways @ mount.R_bm @ so3.skew(E_X)
    # D turns with R_bm, and so do the axes the residual is told in
    axes_turn = so3.skew(r - _phase_row(phase, node))
    J_c[:, :, columns.mounting : columns.mounting + 2] = (to_m @ tilt + axes_turn) @ mount.jacobian
    J_c[:, :, columns.lever : columns.lever + 3] = to_m @ (R_ij - np.eye(3))
    _scatter(J_c, correction.forward_column, -in_m((1 + c[:, columns.scale])[:, None] * travel))
    _scatter(J_c, correction.lateral_column, in_m(turned))

    terms = (Term("x", node, J_i), Term("x", node + 1, J_j), Term("c", segment, J_c))
    return whitened("displacement", AXES, time, r, correction.sigma, terms)


def _calibrated(c: Array, column: Index, otherwise: Array) -> Array:
    """Each factor's own calibration column, (n,), or the fixed value where it has none."""
    return np.where(column >= 0, c[np.arange(len(c)), column], otherwise)


def _phase_row(phase: Array, node: Index) -> Array:
    """The counter's part of the residual, (n, 3): it does not turn with the mounting."""
    row = np.zeros((len(node), 3))
    row[:, 1] = phase[node + 1] - phase[node]
    return row


def _scatter(J: Array, column: Index, value: Array) -> None:
    """Add (n, 3) derivatives to each factor's own calibration column; -1 is left out."""
    on = np.flatnonzero(column >= 0)
    J[on, :, column[on]] += value[on]


def phase_prior(phase: Array, time: Array, pulse: float) -> Block:
    """Every node's counter phase, uniform within a pulse: `q / (pulse / sqrt(12))`, 1 row."""
    n = len(phase)
    sd = max(pulse / np.sqrt(12), 1e-5)  # a recorded speed has no phase: the state is held at zero
    jacobian = np.zeros((n, 1, NODE_DIM))
    jacobian[:, 0, PHASE] = 1 / sd
    term = Term("x", np.arange(n), jacobian)
    return Block("phase", ("phase",), time, phase[:, None] / sd, (term,))
