"""External heading (sun or star sensor, dual antenna): direction of the body's forward axis.

r = wrap(atan2(f_e, f_n) - heading) / sigma,   f = R_nb e_y,  clockwise from north   (C5, C6)
"""

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, Array, Block, Scope, Term
from factors.displacement import E_Y
from factors.estimate import Estimate


def heading(value: Array, sigma: Array, scope: Scope, x: Estimate) -> Block:
    """Headings `value` (n,) rad with `sigma` (n,) rad at nodes; 1 row, whitened."""
    node, R = scope.node, x.R_nb[scope.node]
    forward = R @ E_Y
    east, north = forward[:, 0], forward[:, 1]
    error = np.arctan2(east, north) - value
    residual = (error + np.pi) % (2 * np.pi) - np.pi
    gradient = np.stack([north, -east, np.zeros(len(node))], -1) / (east**2 + north**2)[:, None]
    J = np.zeros((len(node), 1, NODE_DIM))
    # d(R e_y) = -R [e_y]x theta
    J[:, 0, ROTATION] = np.einsum("ni,nij->nj", gradient, -R @ so3.skew(E_Y))
    term = Term("x", node, J / sigma[:, None, None])
    residual = (residual / sigma)[:, None]
    return Block(kinds.HEADING, ("heading",), scope.time, residual, (term,), robust=True)
