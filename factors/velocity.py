"""Non-holonomic velocity factor at a node: `[v_x, v_y, 0]` of the vehicle point (A5, A24, B3, D1).

    r = R_mb (R_nb^T v_n + w x l) - [v_x, v_y, 0]

with `w` the body's rate relative to the Earth. Without an odometer the forward row is left out
(its sigma infinite) and the rest is the plain non-holonomic constraint D1.
"""

import numpy as np

from factors import so3
from factors.block import NODE_DIM, ROTATION, VELOCITY, Array, Block, Index, Term, whitened
from factors.displacement import AXES, E_Y, Columns, mounting


def velocity(
    speed: Array,
    lateral: Array,
    sigma: Array,
    rate_b: Array,
    columns: Columns,
    roll: float,
    node: Index,
    R: Array,
    v: Array,
    c: Array,
    segment: Index,
    time: Array,
) -> Block:
    """Velocity factors at nodes `node` (n,).

    Args: `speed` (n,) m/s corrected odometer speed before the scale factor, `lateral` (n,) m/s,
    `sigma` (n, 3) m/s (inf leaves a row out), `rate_b` (n, 3) rad/s, `c` (n, dim) calibration.
    Returns a block of 3 rows [lateral, forward, vertical], whitened.
    """
    n = len(node)
    mount = mounting(c[:, columns.mounting : columns.mounting + 2], roll)
    R_mb = so3.transpose(mount.R_bm)
    lever = c[:, columns.lever : columns.lever + 3]
    v_b = so3.mtv(R[node], v[node])
    v_m = so3.mv(R_mb, v_b + so3.cross(rate_b, lever))
    r = v_m - ((1 + c[:, columns.scale]) * speed)[:, None] * E_Y
    r[:, 0] -= lateral

    J_x, J_c = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, c.shape[1]))
    J_x[:, :, ROTATION] = R_mb @ so3.skew(v_b)
    J_x[:, :, VELOCITY] = R_mb @ so3.transpose(R[node])
    J_c[:, 1, columns.scale] = -speed
    J_c[:, :, columns.mounting : columns.mounting + 2] = so3.skew(v_m) @ mount.jacobian
    J_c[:, :, columns.lever : columns.lever + 3] = R_mb @ so3.skew(rate_b)
    terms = (Term("x", node, J_x), Term("c", segment, J_c))
    return whitened("velocity", AXES, time, r, sigma, terms)
