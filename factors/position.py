"""Position fix with an antenna lever arm, at a time close to a node.

    r = (p_n + v_n dt + R_nb l + o_n - z_n) / sigma,   dt = fix time - node time

The lever arm `l` and the constant offset `o_n` of all fixes (datum, orbit and multipath errors that
do not average out) are calibrations: what the run cannot tell of them stays in the covariance.
"""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Array, Block, Index, Term

AXES = ("east", "north", "up")


@dataclass(frozen=True)
class Fixes:
    """Fixes close to nodes."""

    p_n: Array  # (n, 3) m
    sigma: Array  # (n, 3) m
    late: Array  # (n,) s after its node
    node: Index  # (n,)
    segment: Index  # (n,) calibration segment
    time: Array  # (n,) s


def position(
    fixes: Fixes, antenna: int, offset: int, R: Array, v: Array, p: Array, c: Array
) -> Block:
    """All fixes as one block of 3 rows [east, north, up], whitened.

    `antenna` and `offset` are the first calibration columns of lever arm and offset; `c` (K, dim)
    the calibration chain, `R` (N, 3, 3), `v`, `p` (N, 3) the nodes.
    """
    n, node = len(fixes.node), fixes.node
    here = c[fixes.segment]
    lever, shift = here[:, antenna : antenna + 3], here[:, offset : offset + 3]
    r = p[node] + v[node] * fixes.late[:, None] + so3.mv(R[node], lever) + shift - fixes.p_n
    J, J_c = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, c.shape[1]))
    J[:, :, ROTATION] = -R[node] @ so3.skew(lever)
    J[:, :, VELOCITY] = fixes.late[:, None, None] * np.eye(3)
    J[:, :, POSITION] = np.eye(3)
    J_c[:, :, antenna : antenna + 3] = R[node]
    J_c[:, :, offset : offset + 3] = np.eye(3)
    white = 1 / fixes.sigma[:, :, None]
    terms = (Term("x", node, J * white), Term("c", fixes.segment, J_c * white))
    return Block("gnss", AXES, fixes.time, r / fixes.sigma, terms, robust=True, sigma=fixes.sigma)
