"""Skid steer: the difference of the two sides' speeds turns the vehicle, `r - l = B_eff phi_dot`.

Integrated over an interval, with `psi` the change of heading in the body,

    residual = (S_r - S_l) - B_eff psi_ij,    psi_ij = Log(R_i^T R_j)_z

`B_eff` is wider than the gauge because the sides slip; it is a calibration.
"""

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, Array, Block, Scope, between, whitened
from factors.calibration import TRACK_WIDTH, Layout
from factors.estimate import Estimate


def track_width(
    difference: Array, sigma: Array, layout: Layout, scope: Scope, x: Estimate
) -> Block:
    """Yaw-rate factors over intervals: 1 row, whitened.

    Args: `difference` (n,) m, right minus left distance; `sigma` (n,) m.
    """
    n, column = len(scope.node), layout.column(TRACK_WIDTH)
    turn = so3.log(so3.transpose(x.R_nb[scope.node]) @ x.R_nb[scope.node + 1])
    width = x.calibration[scope.segment, column]
    J_i, J_j = np.zeros((n, 1, NODE_DIM)), np.zeros((n, 1, NODE_DIM))
    J_c = np.zeros((n, 1, layout.dim))
    # Log(Exp(-a) E Exp(b)): left and right Jacobians at E's angle
    J_i[:, 0, ROTATION] = width[:, None] * so3.right_jacobian_inverse(-turn)[:, 2, :]
    J_j[:, 0, ROTATION] = -width[:, None] * so3.right_jacobian_inverse(turn)[:, 2, :]
    J_c[:, 0, column] = -turn[:, 2]
    residual = (difference - width * turn[:, 2])[:, None]
    terms = between(scope, J_i, J_j, J_c)
    return whitened(kinds.TRACK_WIDTH, ("yaw",), scope.time, residual, sigma[:, None], terms)
