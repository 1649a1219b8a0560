"""Velocity of the vehicle point at a node: the odometer's, and that it neither slides nor hops.

    r = v_m - [tau v_y psi_dot - kappa L psi_dot, f (1 + s) v_o - h |psi_dot| sign v_o, 0],
    v_m = R_mb (R_nb^T v_n + w x l)

(the forward row over `f (1 + s)`, in the odometer's own m/s)
with `w` the body's rate relative to the Earth at the node, `psi_dot` its third component and `v_o`
what the odometer shows at the node's time with the delay in force (A5, A17, A20, A23, A24, B3, D1).
It is the derivative of `factors.displacement`, for odometers too sparse to be summed. Without an
odometer the forward row is left out (its sigma infinite) and the rest is the plain non-holonomic
constraint D1. Down a side slope it drifts (`factors.side_slope`).
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, VELOCITY, Array, Block, Scope, Term, whitened
from factors.calibration import CORNERING, DELAY, LEVER, MOUNTING, SCALE, Layout
from factors.estimate import Estimate
from factors.mounting import E_X, E_Y, mounting
from factors.odometer_model import AXES, OdometerModel
from factors.side_slope import Attitude, slide_downhill


@dataclass(frozen=True)
class VelocityReading:
    """What is known of the vehicle point's velocity at n nodes."""

    speed: Array  # (n,) m/s, as the odometer shows it at the node's time and `delay`
    change: Array  # (n,) m/s^2, of it by the delay
    delay: float  # s, that `speed` was taken with
    pace: Array  # (n,) m/s, of the vehicle by the estimate, for its drift on a slope
    rate_b: Array  # (n, 3) rad/s, body relative to the Earth at the node
    model: OdometerModel
    sigma: Array  # (n, 3) m/s; very large leaves a row out


def velocity(reading: VelocityReading, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """Velocity factors at nodes: 3 rows [lateral, forward, vertical], whitened."""
    n, c = len(scope.node), x.calibration[scope.segment]
    rate_b, yaw_rate = reading.rate_b, reading.rate_b[:, 2]
    angles, arm = layout.slices[MOUNTING], layout.slices[LEVER]
    mount = mounting(c[:, angles], reading.model.roll)
    R_mb, R_nb = so3.transpose(mount.R_bm), x.R_nb[scope.node]
    v_b = so3.mtv(R_nb, x.v_n[scope.node])
    v_m = so3.mv(R_mb, v_b + so3.cross(rate_b, c[:, arm]))
    expected, J_c = _expected(reading, layout, c, v_m)

    J_x = np.zeros((n, 3, NODE_DIM))
    J_x[:, :, ROTATION] = R_mb @ so3.skew(v_b)
    J_x[:, :, VELOCITY] = R_mb @ so3.transpose(R_nb)
    J_c[:, :, angles] = so3.skew(v_m) @ mount.jacobian
    J_c[:, :, arm] = R_mb @ so3.skew(rate_b)
    if (cornering := layout.find(CORNERING)) is not None:  # the slip follows the speed
        slip = (c[:, cornering] * yaw_rate)[:, None]
        for J in (J_x[:, :, ROTATION], J_x[:, :, VELOCITY], J_c[:, :, angles], J_c[:, :, arm]):
            J[:, 0] -= slip * J[:, 1]
    r = v_m - expected
    slide_downhill(layout, c, reading.pace, Attitude(R_nb, mount), (r, J_x, J_c))
    reading.model.in_odometer_units(layout, c, r, (J_x, J_c))
    terms = (Term("x", scope.node, J_x), Term("c", scope.segment, J_c))
    return whitened(kinds.VELOCITY, AXES, scope.time, r, reading.sigma, terms)


def _expected(
    reading: VelocityReading, layout: Layout, c: Array, v_m: Array
) -> tuple[Array, Array]:
    """What running gear and odometer say of `v_m` (n, 3), and the residual's Jacobian (n, 3, dim)
    by the calibrations that only act there.
    """
    model, yaw_rate, speed = reading.model, reading.rate_b[:, 2], reading.speed
    J_c = np.zeros((len(c), 3, layout.dim))
    gain = model.gain(layout, c)
    if (delay := layout.find(DELAY)) is not None:
        speed = speed + (c[:, delay] - reading.delay) * reading.change
        J_c[:, 1, delay] = -gain.value * reading.change
    forward_speed = gain.value * speed - model.gauge * np.abs(yaw_rate) * np.sign(reading.speed)
    lateral = -model.lateral.value(c) * yaw_rate
    if (cornering := layout.find(CORNERING)) is not None:
        lateral = lateral + c[:, cornering] * v_m[:, 1] * yaw_rate
        J_c[:, 0, cornering] = -v_m[:, 1] * yaw_rate
    J_c[:, 1, layout.column(SCALE)] = -gain.factor * speed
    model.forward.add_to(J_c, -(gain.scale * speed)[:, None] * E_Y)
    model.lateral.add_to(J_c, yaw_rate[:, None] * E_X)
    return lateral[:, None] * E_X + forward_speed[:, None] * E_Y, J_c
