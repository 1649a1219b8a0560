"""A heading from outside (stated, sun or star sensor, dual antenna), clockwise from north.

    r = wrap(atan2(f_e, f_n) - heading) / sigma   (C5, C6)

f is the direction of the body's forward axis, `R_nb e_y`, or of the vehicle's, `R_nb R_bm e_y` with
the mounting a calibration (B2).
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, Array, Block, Scope, Term
from factors.calibration import MOUNTING, Layout
from factors.estimate import Estimate
from factors.mounting import E_Y, mounting


@dataclass(frozen=True)
class Bearing:
    """Headings and whose they are."""

    value: Array  # (n,) rad
    sigma: Array  # (n,) rad
    roll: float | None = None  # rad, of the vehicle's mounting; None: the body's own headings
    kind: str = kinds.HEADING


def heading(bearing: Bearing, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """Headings at nodes; 1 row, whitened."""
    node, R, sigma = scope.node, x.R_nb[scope.node], bearing.sigma
    ahead_b = np.broadcast_to(E_Y, (len(node), 3))
    if bearing.roll is not None:
        c = x.calibration[scope.segment]
        mount = mounting(c[:, layout.slices[MOUNTING]], bearing.roll)
        ahead_b = mount.R_bm @ E_Y
    forward = so3.mv(R, ahead_b)
    east, north = forward[:, 0], forward[:, 1]
    error = np.arctan2(east, north) - bearing.value
    residual = (error + np.pi) % (2 * np.pi) - np.pi
    gradient = np.stack([north, -east, np.zeros(len(node))], -1) / (east**2 + north**2)[:, None]
    J = np.zeros((len(node), 1, NODE_DIM))
    # d(R f_b) = -R [f_b]x theta
    J[:, 0, ROTATION] = np.einsum("ni,nij->nj", gradient, -R @ so3.skew(ahead_b))
    terms = [Term("x", node, J / sigma[:, None, None])]
    if bearing.roll is not None:
        J_c = np.zeros((len(node), 1, c.shape[1]))
        turned = -R @ mount.R_bm @ so3.skew(E_Y) @ mount.jacobian
        J_c[:, 0, layout.slices[MOUNTING]] = np.einsum("ni,nij->nj", gradient, turned)
        terms.append(Term("c", scope.segment, J_c / sigma[:, None, None]))
    residual = (residual / sigma)[:, None]
    return Block(
        bearing.kind, ("heading",), scope.time, residual, tuple(terms), True, sigma[:, None]
    )
