"""Slip from the ground itself: what the front wheel climbs, the rear climbs a little later.

On one side the wheels follow each other over the same profile h. The linkage gives the height
differences D_1 = h(front) - h(middle) and D_2 = h(middle) - h(rear) as functions of the way s that
the wheels have rolled. With the axles' distances L_1 and L_2 known in metres and true way = k s,
differencing each over the other's length makes one and the same function of the ground:

    r = [D_1(s) - D_1(s - L_2/k)] - [D_2(s + L_1/k) - D_2(s)]

(both brackets are h differenced over L_1 and over L_2, seen L_1 of way apart). The only unknown is
k: no sun, gyro or turn is needed to see it. Not in the source (methods C); it complements C6, which
needs turns and a heading.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from factors.block import Block, Index, Term
from factors.calibration import SLIP_COEFFICIENT, Layout
from factors.estimate import Estimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """Height differences along one side's way, on a uniform grid."""

    step: float  # m
    front: Array  # (G,) m, D_1
    rear: Array  # (G,) m, D_2
    L_1: float  # m, front axle to middle axle
    L_2: float  # m, middle axle to rear axle

    @property
    def reach(self) -> float:
        """How far, m at k = 1, the residual looks to either side."""
        return max(self.L_1, self.L_2)


def arc_share(curvature: Array, length: float) -> Array:
    """How much shorter than `length` m the arc between two wheels is when driving a curve (n,) 1/m.

    The wheels stand on a straight line that touches the circle: arc = atan(c L) / c.
    """
    turned = np.abs(curvature) * length
    return np.where(turned < 1e-3, 1.0, np.arctan(turned) / np.maximum(turned, 1e-3))


def mismatch(profile: Profile, at: Array, k: Array, arc: Array) -> tuple[Array, Array]:
    """Residual r (n,) m at ways `at` (n,) m for slip coefficients `k` (n,), and its d/dk.

    `arc` (n,) is what curves shorten the axles' distances by (`arc_share`).
    """
    L_1, L_2 = profile.L_1, profile.L_2  # the offsets below are true metres
    parts = (
        (1.0, profile.front, 0.0),
        (-1.0, profile.front, -L_2),
        (-1.0, profile.rear, L_1),
        (1.0, profile.rear, 0.0),
    )
    grid = profile.step * np.arange(len(profile.front))
    r, dr = np.zeros_like(at), np.zeros_like(at)
    for sign, heights, offset in parts:
        reach = offset * arc
        where = at + reach / k
        r += sign * np.interp(where, grid, heights)
        slope = np.interp(where, grid, np.gradient(heights, profile.step))
        dr -= sign * slope * reach / k**2
    return r, dr


@dataclass(frozen=True)
class WheelTrack:
    """One side's profile and where along it the mismatch counts."""

    side: str
    profile: Profile
    at: Array  # (n,) m, ways at k = 1
    time: Array  # (n,) s
    segment: Index  # (n,)
    arc: Array  # (n,) shortening of the axles' distances in curves
    offset: Array  # (n,) m, how far the middle wheel runs beside the others' rut (turns)
    sigma: Array  # (n,) m


def terrain_slip(track: WheelTrack, layout: Layout, x: Estimate) -> Block:
    """One row per way along a side's track."""
    column = layout.column(SLIP_COEFFICIENT)
    r, dr = mismatch(track.profile, track.at, x.calibration[track.segment, column], track.arc)
    J = np.zeros((len(track.at), 1, layout.dim))
    J[:, 0, column] = dr / track.sigma
    term, residual = Term("c", track.segment, J), (r / track.sigma)[:, None]
    return Block(kinds.TERRAIN_SLIP, (track.side,), track.time, residual, (term,), robust=True)
