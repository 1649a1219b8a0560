"""Non-holonomic velocity factor at a node: `[v_x, v_y, 0]` of the vehicle point (A5, A24, B3, D1).

    r = R_mb (R_nb^T v_n + w x l) - [v_x, v_y, 0]

with `w` the body's rate relative to the Earth. Without an odometer the forward row is left out
(its sigma infinite) and the rest is the plain non-holonomic constraint D1.
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, VELOCITY, Array, Block, Scope, Term, whitened
from factors.calibration import LEVER, MOUNTING, SCALE, Layout
from factors.displacement import AXES, E_Y, mounting
from factors.estimate import Estimate


@dataclass(frozen=True)
class VelocityReading:
    """What is known of the vehicle point's velocity at n nodes."""

    speed: Array  # (n,) m/s, corrected odometer speed before the scale factor
    lateral: Array  # (n,) m/s
    rate_b: Array  # (n, 3) rad/s, body relative to the Earth
    sigma: Array  # (n, 3) m/s; very large leaves a row out
    roll: float  # rad, of the mounting


def velocity(reading: VelocityReading, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """Velocity factors at nodes: 3 rows [lateral, forward, vertical], whitened."""
    n, c = len(scope.node), x.calibration[scope.segment]
    speed, rate_b = reading.speed, reading.rate_b
    scale, angles, arm = layout.column(SCALE), layout.slices[MOUNTING], layout.slices[LEVER]
    mount = mounting(c[:, angles], reading.roll)
    R_mb, R_nb = so3.transpose(mount.R_bm), x.R_nb[scope.node]
    v_b = so3.mtv(R_nb, x.v_n[scope.node])
    v_m = so3.mv(R_mb, v_b + so3.cross(rate_b, c[:, arm]))
    r = v_m - ((1 + c[:, scale]) * speed)[:, None] * E_Y
    r[:, 0] -= reading.lateral

    J_x, J_c = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, layout.dim))
    J_x[:, :, ROTATION] = R_mb @ so3.skew(v_b)
    J_x[:, :, VELOCITY] = R_mb @ so3.transpose(R_nb)
    J_c[:, 1, scale] = -speed
    J_c[:, :, angles] = so3.skew(v_m) @ mount.jacobian
    J_c[:, :, arm] = R_mb @ so3.skew(rate_b)
    terms = (Term("x", scope.node, J_x), Term("c", scope.segment, J_c))
    return whitened(kinds.VELOCITY, AXES, scope.time, r, reading.sigma, terms)
