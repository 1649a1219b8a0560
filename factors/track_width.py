"""Skid steer: the difference of the two sides' speeds turns the vehicle, `r - l = B_eff phi_dot`.

Integrated over an interval, with `psi` the change of heading in the body,

    residual = (S_r - S_l) - B_eff psi_ij,    psi_ij = Log(R_i^T R_j)_z

`B_eff` is wider than the gauge because the sides slip; it is a calibration.
"""

import numpy as np

from factors import so3
from factors.block import NODE_DIM, ROTATION, Array, Block, Index, Term, whitened


def track_width(
    difference: Array,
    sigma: Array,
    column: int,
    node: Index,
    R: Array,
    c: Array,
    segment: Index,
    time: Array,
) -> Block:
    """Yaw-rate factors over the intervals that start at nodes `node` (n,).

    Args: `difference` (n,) m, right minus left distance; `sigma` (n,) m; `column` of B_eff in the
    calibration `c` (n, dim) in force, of segment `segment`. Returns 1 row, whitened.
    """
    n = len(node)
    turn = so3.log(so3.transpose(R[node]) @ R[node + 1])
    width = c[:, column]
    J_i, J_j = np.zeros((n, 1, NODE_DIM)), np.zeros((n, 1, NODE_DIM))
    J_c = np.zeros((n, 1, c.shape[1]))
    # Log(Exp(-a) E Exp(b)): left and right Jacobians at E's angle
    J_i[:, 0, ROTATION] = width[:, None] * so3.right_jacobian_inverse(-turn)[:, 2, :]
    J_j[:, 0, ROTATION] = -width[:, None] * so3.right_jacobian_inverse(turn)[:, 2, :]
    J_c[:, 0, column] = -turn[:, 2]
    residual = (difference - width * turn[:, 2])[:, None]
    terms = (Term("x", node, J_i), Term("x", node + 1, J_j), Term("c", segment, J_c))
    return whitened("track_width", ("yaw",), time, residual, sigma[:, None], terms)
