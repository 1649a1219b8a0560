"""Position fix with an antenna lever arm, at a time close to a node.

    r = (p_n + v_n dt + R_nb l - z_n) / sigma,   dt = fix time - node time
"""

import numpy as np
from numpy.typing import NDArray

from factors import so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Block, Index, Term

Array = NDArray[np.float64]

AXES = ("east", "north", "up")


def position(
    fix_n: Array,
    sigma: Array,
    lever_b: Array,
    dt: Array,
    node: Index,
    R: Array,
    v: Array,
    p: Array,
    time: Array,
) -> Block:
    """Fixes `fix_n` (n, 3) m with `sigma` (n, 3) m seen at nodes `node`, `dt` (n,) s after them."""
    n = len(node)
    r = p[node] + v[node] * dt[:, None] + R[node] @ lever_b - fix_n
    J = np.zeros((n, 3, NODE_DIM))
    J[:, :, ROTATION] = -R[node] @ so3.skew(lever_b)
    J[:, :, VELOCITY] = dt[:, None, None] * np.eye(3)
    J[:, :, POSITION] = np.eye(3)
    term = Term("x", node, J / sigma[:, :, None])
    return Block("gnss", AXES, time, r / sigma, (term,), robust=True)
