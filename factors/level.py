"""Quasi-static level: what is felt about a node is gravity and the accelerometer's bias e.

r = (f - e - R^T (-g_n))_x,y / sigma   (C5)
"""

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, Array, Block, Scope, Term, whitened
from factors.calibration import ACCEL_BIAS, Layout
from factors.estimate import Estimate


def level(
    force_b: Array, g_n: Array, sigma: Array, layout: Layout, scope: Scope, x: Estimate
) -> Block:
    """Level factors of mean forces (n, 3) m/s^2 at nodes: 2 rows [right, forward], whitened.

    `g_n` (3,) m/s^2 gravity, `sigma` (n, 2) m/s^2.
    """
    n, bias = len(scope.node), layout.slices[ACCEL_BIAS]
    up_b = so3.mtv(x.R_nb[scope.node], -g_n)
    J, J_c = np.zeros((n, 2, NODE_DIM)), np.zeros((n, 2, layout.dim))
    J[:, :, ROTATION] = -so3.skew(up_b)[:, :2]
    J_c[:, :, bias] = -np.eye(3)[:2]
    residual = (force_b - x.calibration[scope.segment, bias] - up_b)[:, :2]
    terms = (Term("x", scope.node, J), Term("c", scope.segment, J_c))
    return whitened(kinds.LEVEL, ("right", "forward"), scope.time, residual, sigma, terms)
