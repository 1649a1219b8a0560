"""Position fix with an antenna lever arm, at its true time between two nodes.

    r = (p_n(t) + R_nb(t) l - (d - d_0) v_a(t) + o_n - z_n) / sigma,   t = stamp - d_0

The path is carried from the nodes i, j on either side to t by the cubic that meets both (the mean
of white-noise acceleration between them; Source: Barfoot 2017, State Estimation for Robotics, 11.1)
and by what the accelerometers felt of unsteady force in between:

    p_n(t) = (1 - a) p_i + a p_j + e v_i + b v_j + R_i m_b
    a = s^2 (3 - 2 s),  b = T s^2 (s - 1),  e = t_s - T a - b,  s = t_s / T

Steady force, gravity and a bias drop out of `m_b`. `v_a` is the antenna's velocity, by which a fix
slides along the path when the receiver's delay `d` moves from the `d_0` it was carried with. Lever
arm `l`, delay `d` and the errors `o_n` that neighbouring fixes have in common are calibrations:
what the run cannot tell of them stays in the covariance.
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
from factors.calibration import ANTENNA, GNSS_DELAY, GNSS_OFFSET, Layout
from factors.estimate import Estimate

AXES = ("east", "north", "up")


@dataclass(frozen=True)
class Carried:
    """What carries the path from the node before a time, and the one after, to that time."""

    T: Array  # (n,) s, between the nodes
    share: Array  # (n,) of T that has gone by: s
    swing: Array  # (n, 3) m, unsteady force twice integrated, in the body at the node: m_b
    surge: Array  # (n, 3) m/s, the same once integrated
    turn: Array  # (n, 3, 3) body at the time to body at the node
    rate: Array  # (n, 3) rad/s, turn of the body relative to the Earth at the time


@dataclass(frozen=True)
class Fixes:
    """Fixes between nodes; those at rest turn and swing with nothing."""

    p_n: Array  # (n, 3) m
    sigma: Array  # (n, 3) m
    carried: Carried
    delay: float  # s, d_0, with which they were carried


def position(fixes: Fixes, layout: Layout, scope: Scope, x: Estimate) -> Block:
    """All fixes as one block of 3 rows [east, north, up], whitened; `scope.node` is the node before
    each. Without a delay in the layout it is held at d_0.
    """
    by, i, c = fixes.carried, scope.node, x.calibration[scope.segment]
    s, R = by.share, x.R_nb[i]
    lever, free = c[:, layout.slices[ANTENNA]], GNSS_DELAY in layout.slices
    late = c[:, layout.column(GNSS_DELAY)] - fixes.delay if free else np.zeros(len(i))
    a, b = s * s * (3 - 2 * s), by.T * s * s * (s - 1)
    e = by.T * (s - a) - b
    arm = by.swing + so3.mv(by.turn, lever)  # in the body at the node
    whirl = by.surge + so3.mv(by.turn, so3.cross(by.rate, lever))
    v_a = _per(1 - s) * x.v_n[i] + _per(s) * x.v_n[i + 1] + so3.mv(R, whirl)
    cubic = _per(1 - a) * x.p_n[i] + _per(a) * x.p_n[i + 1]
    cubic += _per(e) * x.v_n[i] + _per(b) * x.v_n[i + 1]
    r = cubic + so3.mv(R, arm) - _per(late) * v_a + c[:, layout.slices[GNSS_OFFSET]] - fixes.p_n

    J_i, J_j = np.zeros((len(i), 3, NODE_DIM)), np.zeros((len(i), 3, NODE_DIM))
    J_c, eye = np.zeros((len(i), 3, layout.dim)), np.eye(3)
    J_i[:, :, ROTATION] = -R @ so3.skew(arm - _per(late) * whirl)
    J_i[:, :, VELOCITY] = (e - late * (1 - s))[:, None, None] * eye
    J_j[:, :, VELOCITY] = (b - late * s)[:, None, None] * eye
    J_i[:, :, POSITION] = (1 - a)[:, None, None] * eye
    J_j[:, :, POSITION] = a[:, None, None] * eye
    J_c[:, :, layout.slices[ANTENNA]] = (
        R @ by.turn @ (eye - late[:, None, None] * so3.skew(by.rate))
    )
    J_c[:, :, layout.slices[GNSS_OFFSET]] = eye
    if free:
        J_c[:, :, layout.column(GNSS_DELAY)] = -v_a
    terms = (Term("x", i, J_i), Term("x", i + 1, J_j), Term("c", scope.segment, J_c))
    return whitened(kinds.GNSS, AXES, scope.time, r, fixes.sigma, terms)


def _per(x: Array) -> Array:
    """A number for each fix, to scale vectors by."""
    return x[:, None]
