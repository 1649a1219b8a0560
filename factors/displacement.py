"""Displacement factor: the odometer's corrected motion between two nodes (B4 with A17-A24).

With `C_k` the gyro-integrated rotation since node i and `d_k` the odometer's distance steps, the
vehicle point moves, in the body frame of node i,

    D = (f (1 + s) [sum C_k d_k] - h [sum C_k |dpsi_k| sign d_k]) R_bm e_y
      - (kappa L [sum C_k dpsi_k] - tau [sum C_k d_k psi_dot_k]) R_bm e_x

(forward: A20, A23; lateral: A17 for tracks, and for tyres the slip angle they need to hold a
bend, `v_x = tau v_y psi_dot` outwards; both drift down a side slope, `factors.side_slope`). The
residual is

    r = R_i^T (p_j - p_i) + (R_i^T R_j - I) l - D,

told in the vehicle frame at the middle of the interval so that its rows are lateral, forward and
vertical, the forward one over `f (1 + s)`, in the odometer's own metres. Divided by the interval it
is the mean velocity of B4. A pulse counter is wrong by its phase q (less than a pulse) at every
node, the same error for the interval before and the one after: q is a state of the node, so
quantisation is bounded and anticorrelated as it is in truth.
"""

from dataclasses import dataclass, replace

import numpy as np

from factors import kinds, so3
from factors.block import (
    NODE_DIM,
    PHASE,
    POSITION,
    ROTATION,
    Array,
    Block,
    Index,
    Scope,
    Term,
    between,
    whitened,
)
from factors.calibration import (
    CORNERING,
    DELAY,
    GYRO_BIAS,
    GYRO_SCALE,
    LEVER,
    MOUNTING,
    SCALE,
    Layout,
)
from factors.estimate import Estimate
from factors.mounting import E_X, E_Y, Mounting, mounting
from factors.odometer_model import AXES, Gain, OdometerModel
from factors.side_slope import Attitude, slide_downhill


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
    rate: Array  # (n, 3) rad/s, mean sensed rate, for the gyro's scale factors
    delay: float  # s, delay and
    drift: Array  # (n, 3) rad/s, gyro errors (less the Earth's rate) the sums were made with

    @property
    def way(self) -> Array:
        """(n,) m, as counted."""
        return np.asarray(np.linalg.norm(self.distance[:, :, 1], axis=1))

    def of(self, on: Index) -> "OdometerSums":
        """The sums of some intervals."""
        arrays = {k: v[on] for k, v in self.__dict__.items() if k != "delay"}
        return OdometerSums(**arrays, delay=self.delay)


@dataclass(frozen=True)
class DisplacementReading:
    """What the odometer counted over n intervals and how it is to be read."""

    sums: OdometerSums
    model: OdometerModel
    sigma: Array  # (n, 3) m, one sigma of lateral, forward, vertical


def displacement(reading: DisplacementReading, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """Displacement factors: 3 rows [lateral, forward, vertical], whitened."""
    c = x.calibration[scope.segment]
    D = _read(reading, layout, c)
    R_i, R_j = x.R_nb[scope.node], x.R_nb[scope.node + 1]
    R_ij = so3.transpose(R_i) @ R_j
    moved = so3.mtv(R_i, x.p_n[scope.node + 1] - x.p_n[scope.node])
    lever = c[:, layout.slices[LEVER]]
    arm = so3.mv(R_ij, lever)
    # vectors in the frame of node i, turned into the vehicle frame at mid-interval at the end
    to_m = so3.transpose(reading.sums.R_mid @ D.mount.R_bm)
    r = so3.mv(to_m, moved + arm - lever - D.total)
    J_c = _calibration_columns(reading, layout, D, to_m, r)
    J_c[:, :, layout.slices[LEVER]] = to_m @ (R_ij - np.eye(3))

    n = len(scope.node)
    J_i, J_j = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, NODE_DIM))
    J_i[:, :, ROTATION] = to_m @ so3.skew(moved + arm)
    J_j[:, :, ROTATION] = -to_m @ R_ij @ so3.skew(lever)
    J_j[:, :, POSITION] = to_m @ so3.transpose(R_i)
    J_i[:, :, POSITION] = -J_j[:, :, POSITION]
    at_mid = replace(D.mount, R_bm=reading.sums.R_mid @ D.mount.R_bm)
    slide_downhill(layout, c, reading.sums.way, Attitude(R_i, at_mid), (r, J_i, J_c))
    reading.model.in_odometer_units(layout, c, r, (J_i, J_j, J_c))
    r[:, 1] += x.phase[scope.node + 1] - x.phase[scope.node]
    J_i[:, 1, PHASE], J_j[:, 1, PHASE] = -1.0, 1.0
    terms = between(scope, J_i, J_j, J_c)
    return whitened(kinds.DISPLACEMENT, AXES, scope.time, r, reading.sigma, terms)


@dataclass(frozen=True)
class _Read:
    """D and its parts, all in the body frame of node i."""

    total: Array  # (n, 3) m
    mount: Mounting
    gain: Gain
    distance: Array  # (n, 3, 3) sum C_k d_k with the delay in force
    sideways: Array  # (n, 3, 3) what acts along -R_bm e_x
    travel: Array  # (n, 3) distance along R_bm e_y
    swerve: Array  # (n, 3) whose cross product with the gyro's drift is the way's turn


def _read(reading: DisplacementReading, layout: Layout, c: Array) -> _Read:
    """The odometer's displacement with the calibrations `c` (n, dim) in force."""
    sums, model = reading.sums, reading.model
    mount, gain = mounting(c[:, layout.slices[MOUNTING]], model.roll), model.gain(layout, c)
    ex, ey = mount.R_bm @ E_X, mount.R_bm @ E_Y
    sideways = model.lateral.value(c)[:, None, None] * sums.turn
    if (cornering := layout.find(CORNERING)) is not None:
        sideways = sideways - c[:, cornering, None, None] * sums.bend
    distance = sums.distance
    if (delay := layout.find(DELAY)) is not None:
        late = c[:, delay] - sums.delay
        distance = distance + late[:, None, None] * sums.distance_rate
    travel = so3.mv(distance, ey)
    swerve = gain.value[:, None] * so3.mv(sums.distance_late, ey)
    D = gain.value[:, None] * travel - model.gauge[:, None] * so3.mv(sums.turn_abs, ey)
    drift = c[:, layout.slices[GYRO_BIAS]] - sums.drift
    if GYRO_SCALE in layout.slices:
        drift = drift + c[:, layout.slices[GYRO_SCALE]] * sums.rate
    D = D - so3.mv(sideways, ex) + so3.cross(swerve, drift)
    return _Read(D, mount, gain, distance, sideways, travel, swerve)


def _calibration_columns(
    reading: DisplacementReading, layout: Layout, D: _Read, to_m: Array, r: Array
) -> Array:
    """Jacobian (n, 3, dim) by all calibrations but the lever; `r` (n, 3) without the phase."""
    sums, model, R_bm, gain = reading.sums, reading.model, D.mount.R_bm, D.gain.value
    ex, ey = R_bm @ E_X, R_bm @ E_Y
    J_c = np.zeros((*r.shape, layout.dim))

    def in_m(x: Array) -> Array:
        return so3.mv(to_m, x)

    by_drift = -to_m @ so3.skew(D.swerve)
    J_c[:, :, layout.slices[GYRO_BIAS]] = by_drift
    if GYRO_SCALE in layout.slices:
        J_c[:, :, layout.slices[GYRO_SCALE]] = by_drift * sums.rate[:, None, :]
    J_c[:, :, layout.column(SCALE)] = -in_m(D.gain.factor[:, None] * D.travel)
    model.forward.add_to(J_c, -in_m(D.gain.scale[:, None] * D.travel))
    if (delay := layout.find(DELAY)) is not None:
        J_c[:, :, delay] = -in_m(gain[:, None] * so3.mv(sums.distance_rate, ey))
    if (cornering := layout.find(CORNERING)) is not None:
        J_c[:, :, cornering] = -in_m(so3.mv(sums.bend, ex))
    tilt = gain[:, None, None] * D.distance @ R_bm @ so3.skew(E_Y)
    tilt = tilt - model.gauge[:, None, None] * sums.turn_abs @ R_bm @ so3.skew(E_Y)
    tilt = tilt - D.sideways @ R_bm @ so3.skew(E_X)
    # D turns with R_bm, and so do the axes the residual is told in; the counter's phase does not
    J_c[:, :, layout.slices[MOUNTING]] = (to_m @ tilt + so3.skew(r)) @ D.mount.jacobian
    model.lateral.add_to(J_c, in_m(so3.mv(sums.turn, ex)))
    return J_c


def phase_prior(pulse: float, time: Array, x: Estimate) -> Block:
    """Every node's counter phase, uniform within a pulse: `q / (pulse / sqrt(12))`, 1 row."""
    n = len(x.phase)
    sd = max(pulse / np.sqrt(12), 1e-5)  # a recorded speed has no phase: the state is held at zero
    jacobian = np.zeros((n, 1, NODE_DIM))
    jacobian[:, 0, PHASE] = 1 / sd
    term = Term("x", np.arange(n), jacobian)
    return Block(kinds.PHASE, ("phase",), time, x.phase[:, None] / sd, (term,))
