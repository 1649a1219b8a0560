"""How steady the IMU and the running gear are: what a standstill would look like."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from factors.preintegration import Increments
from graphnav.common.run import Array, Odometer, SideSpeeds
from graphnav.inertial.odometer_steps import heard

Mask = NDArray[np.bool_]

WINDOW_S = 1.0
SHORTEST_S = 1.0
REACH_S = 0.2  # beyond its samples an odometer's silence means nothing
STOPPED_SPEED = 0.05  # m/s, below which a noisy speed counts as zero


@dataclass(frozen=True)
class StandstillEvidence:
    """What IMU and running gear show about each increment, over `WINDOW_S`."""

    force_sd: Array  # (M,) m/s^2, standard deviation of the specific force, norm over axes
    rate_sd: Array  # (M,) rad/s, standard deviation of the rate, norm over axes
    rate: Array  # (M, 3) rad/s, mean rate
    gear_stopped: Mask  # (M,) whether the running gear shows no motion; True where there is none
    width: int  # increments in a window

    def over(self, on: slice) -> "StandstillEvidence":
        """That of some of the increments."""
        return StandstillEvidence(
            self.force_sd[on], self.rate_sd[on], self.rate[on], self.gear_stopped[on], self.width
        )


def standstill_evidence(
    inc: Increments, odometer: Odometer | None, sides: SideSpeeds | None = None
) -> StandstillEvidence:
    """Evidence of M increments. Where both sides of the running gear are there, both must be
    stopped: a vehicle that turns on the spot has a mean of zero.
    """
    dt = np.diff(inc.edge)
    width = max(3, round(WINDOW_S / float(np.median(dt))))
    force, rate = inc.velocity / dt[:, None], inc.rotation / dt[:, None]
    gear_stopped = np.ones(len(dt), bool)
    if odometer is not None:
        # one count may fall at standstill (rocking)
        limit = max(1.01 * odometer.pulse, STOPPED_SPEED * WINDOW_S)
        gear_stopped &= _stopped(inc, odometer.time, odometer.distance, limit)
    if sides is not None:
        for speed in (sides.left, sides.right):
            way = np.concatenate([[0], np.cumsum(0.5 * np.diff(sides.time) * _pairs(speed))])
            gear_stopped &= _stopped(inc, sides.time, way, STOPPED_SPEED * WINDOW_S)
    mean = uniform_filter1d(rate, width, axis=0)
    return StandstillEvidence(
        _deviation(force, width), _deviation(rate, width), mean, gear_stopped, width
    )


def spans(mask: Mask, edge: Array) -> Array:
    """Runs of True as (K, 2) start and end times, s."""
    change = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.stack([edge[np.flatnonzero(change == 1)], edge[np.flatnonzero(change == -1)]], -1)


def runs(mask: Mask) -> list[tuple[int, int, bool]]:
    """First and end index and value of each run of equal values."""
    first = np.flatnonzero(np.diff(mask, prepend=~mask[:1]))
    return [(a, b, bool(mask[a])) for a, b in pairwise([*first.tolist(), len(mask)])]


def within(edge: Array, inside: Array) -> Mask:
    """Whether each increment between `edge` (M + 1,) lies in one of the spans (K, 2) s, (M,)."""
    mask = np.zeros(len(edge) - 1, bool)
    for start, end in inside:
        mask |= (edge[:-1] >= start - 1e-9) & (edge[1:] <= end + 1e-9)
    return mask


def long_enough(mask: Mask, edge: Array) -> Mask:
    """The mask without runs shorter than `SHORTEST_S`."""
    found = spans(mask, edge)
    return mask & within(edge, found[found[:, 1] - found[:, 0] > SHORTEST_S - 1e-6])


def _pairs(x: Array) -> Array:
    return np.asarray(x[1:] + x[:-1])


def _deviation(x: Array, width: int) -> Array:
    """Standard deviation of a vector (M, 3) over a centred window, norm over axes, (M,)."""
    centred = x - x.mean(0)
    mean = uniform_filter1d(centred, width, axis=0)
    square = uniform_filter1d(centred**2, width, axis=0)
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0).sum(1)))


def _stopped(inc: Increments, time: Array, way: Array, limit: float) -> Mask:
    """Whether a way (n,) m moves less than `limit` within half a window of each increment."""
    mid, half = 0.5 * (inc.edge[1:] + inc.edge[:-1]), WINDOW_S / 2
    moved = np.interp(mid + half, time, way) - np.interp(mid - half, time, way)
    return heard(time, mid, mid, REACH_S) & (np.abs(moved) <= limit)
