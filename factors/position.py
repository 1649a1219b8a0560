"""Position fix with an antenna lever arm, at a time close to a node.

    r = (p_n + v_n dt + R_nb l + o_n - z_n) / sigma,   dt = fix time - node time

The lever arm `l` and the constant offset `o_n` of all fixes (datum, orbit and multipath errors that
do not average out) are calibrations: what the run cannot tell of them stays in the covariance.
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import (
    NODE_DIM,
    POSITION,
    ROTATION,
    VELOCITY,
    Array,
    Block,
    Scope,
    Term,
    whitened,
)
from factors.calibration import ANTENNA, GNSS_OFFSET, Layout
from factors.estimate import Estimate

AXES = ("east", "north", "up")


@dataclass(frozen=True)
class Fixes:
    """Fixes close to nodes."""

    p_n: Array  # (n, 3) m
    sigma: Array  # (n, 3) m
    late: Array  # (n,) s after its node


def position(fixes: Fixes, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """All fixes as one block of 3 rows [east, north, up], whitened."""
    n, node = len(scope.node), scope.node
    antenna, offset = layout.slices[ANTENNA], layout.slices[GNSS_OFFSET]
    c, R = x.calibration[scope.segment], x.R_nb[node]
    lever = c[:, antenna]
    r = x.p_n[node] + x.v_n[node] * fixes.late[:, None] + so3.mv(R, lever) + c[:, offset]
    r -= fixes.p_n
    J, J_c = np.zeros((n, 3, NODE_DIM)), np.zeros((n, 3, layout.dim))
    J[:, :, ROTATION] = -R @ so3.skew(lever)
    J[:, :, VELOCITY] = fixes.late[:, None, None] * np.eye(3)
    J[:, :, POSITION] = np.eye(3)
    J_c[:, :, antenna] = R
    J_c[:, :, offset] = np.eye(3)
    terms = (Term("x", node, J), Term("c", scope.segment, J_c))
    return whitened(kinds.GNSS, AXES, scope.time, r, fixes.sigma, terms)
