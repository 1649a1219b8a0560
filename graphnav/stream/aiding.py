"""Fixes and headings as they come, until each has found its node."""

from dataclasses import dataclass

import numpy as np

from graphnav.common.earth import Origin
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, ExternalHeading, Gnss
from graphnav.graph.nodes import FIX_SPACING_S
from graphnav.graph.problem import FIX_REACH_S


@dataclass(frozen=True)
class Aid:
    """What a sensor other than IMU and odometer says near a node."""

    gnss: Gnss | None = None  # one fix
    fix_n: Array | None = None  # (1, 3) m
    heading: ExternalHeading | None = None  # one


class Aiding:
    """Fixes and external headings, each used at most once, at the node nearest to it."""

    def __init__(self, use_gnss: bool) -> None:
        self._use_gnss = use_gnss
        self._fixes, self._headings = GrowingArray(7), GrowingArray(2)
        self._used = [0, 0]  # fixes and headings already at a node or past
        self._stops = (GrowingArray(), GrowingArray())  # times of them at which nodes are wanted

    def add_fixes(self, time: Array, place: Array, sd: Array) -> None:
        """Times (n,) s, places (n, 3) deg, deg, m, one sigma (n, 3) m."""
        self._fixes.append(np.column_stack([time, place, sd]))
        if self._use_gnss:
            _thin(self._stops[0], time)

    def add_headings(self, time: Array, heading: Array) -> None:
        """Times (n,) s and headings (n,) rad."""
        self._headings.append(np.column_stack([time, heading]))
        _thin(self._stops[1], time)

    def until(self, time: float) -> tuple[Gnss | None, ExternalHeading | None]:
        """Everything up to a time."""
        fixes, headings = self._fixes.rows, self._headings.rows
        gnss = _gnss(fixes[fixes[:, 0] <= time]) if self._use_gnss else None
        return gnss, _heading(headings[headings[:, 0] <= time])

    def stops(self, after: float) -> Array:
        """Times after another at which nodes are wanted, sorted."""
        fixes, headings = (t.rows[int(np.searchsorted(t.rows, after)) :] for t in self._stops)
        return np.sort(np.concatenate([fixes, headings])) if len(headings) else fixes

    def near(self, time: float, origin: Origin) -> Aid:
        """The fix and the heading nearest to a node, of those not used yet; now they are."""
        fix, heading = (self._nearest(k, time) for k in (0, 1))
        gnss = _gnss(fix) if self._use_gnss else None
        if gnss is None:
            return Aid(heading=_heading(heading))
        fix_n = origin.local(np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg), gnss.height)
        return Aid(gnss, fix_n, _heading(heading))

    def _nearest(self, sensor: int, t: float) -> Array:
        """The sample nearest to t, (1, d) or (0, d); all until t count as used."""
        tape, first = (self._fixes, self._headings)[sensor], self._used[sensor]
        time = tape.rows[first:, 0]
        near = np.flatnonzero(np.abs(time - t) < FIX_REACH_S)
        self._used[sensor] = first + int(np.searchsorted(time, t, side="right"))
        if not len(near):
            return tape.rows[:0]
        best = first + int(near[np.abs(time[near] - t).argmin()])
        self._used[sensor] = max(self._used[sensor], best + 1)
        return tape.rows[best : best + 1]


def joined(aids: list[Aid]) -> tuple[Gnss | None, Array, ExternalHeading | None]:
    """All fixes of some nodes, in degrees and in n (F, 3) m, and all headings."""
    fixes = [a.gnss for a in aids if a.gnss is not None]
    fixes_n = [a.fix_n for a in aids if a.fix_n is not None]
    sensed = [a.heading for a in aids if a.heading is not None]
    gnss = heading = None
    if fixes:
        names = ("time", "lat_deg", "lon_deg", "height", "sd_enu")
        gnss = Gnss(*(np.concatenate([getattr(f, name) for f in fixes]) for name in names))
    if sensed:
        times = np.concatenate([h.time for h in sensed])
        heading = ExternalHeading(times, np.concatenate([h.heading for h in sensed]))
    return gnss, np.concatenate(fixes_n or [np.zeros((0, 3))]), heading


def _thin(stops: GrowingArray, time: Array) -> None:
    """Add the first of the times (n,) in every slot of `FIX_SPACING_S`."""
    slot = np.floor(np.append(stops.rows[-1:], time) / FIX_SPACING_S)
    fresh = np.diff(slot, prepend=np.nan)[len(slot) - len(time) :] != 0
    stops.append(time[fresh])


def usual_fix(sd: float) -> Gnss:
    """A fix of a usual quality, for what must be known of fixes before one has come."""
    sigma = np.full((1, 3), sd)
    return Gnss(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), sigma)


def _gnss(rows: Array) -> Gnss | None:
    """Fixes from rows of time, latitude, longitude, height and standard deviations."""
    if not len(rows):
        return None
    return Gnss(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], rows[:, 4:7])


def _heading(rows: Array) -> ExternalHeading | None:
    return ExternalHeading(rows[:, 0], rows[:, 1]) if len(rows) else None
