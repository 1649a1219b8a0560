"""Fixes and headings as they come: fixes by the time they are of, headings by their node."""

import numpy as np

from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, ExternalHeading, Gnss
from graphnav.graph.nodes import first_in_slot
from graphnav.graph.problem import HEADING_REACH_S


class Aiding:
    """What sensors other than IMU and odometer have said so far."""

    def __init__(self, use_gnss: bool) -> None:
        self._use_gnss = use_gnss
        self._fixes, self._headings = GrowingArray(7), GrowingArray(2)
        self._used = 0  # headings already at a node or past
        self._stops = (GrowingArray(), GrowingArray())  # times of them at which nodes are wanted

    def add_fixes(self, time: Array, place: Array, sd: Array) -> None:
        """Times (n,) s, places (n, 3) deg, deg, m, one sigma (n, 3) m."""
        self._fixes.append(np.column_stack([time, place, sd]))
        if self._use_gnss:
            self._ask(0, time)

    def add_headings(self, time: Array, heading: Array) -> None:
        """Times (n,) s and headings (n,) rad."""
        self._headings.append(np.column_stack([time, heading]))
        self._ask(1, time)

    def _ask(self, sensor: int, time: Array) -> None:
        """Nodes at the first of a sensor's times (n,) in every slot."""
        stops = self._stops[sensor]
        stops.append(time[first_in_slot(time, stops.rows[-1:])])

    def rewind(self) -> None:
        """Headings may find their nodes once more."""
        self._used = 0

    def until(self, time: float) -> tuple[Gnss | None, ExternalHeading | None]:
        """Everything up to a time."""
        headings = self._headings.rows
        fixes = self.fixes(-np.inf, np.inf, time, 0.0)
        return fixes, _heading(headings[headings[:, 0] <= time])

    def fixes(self, after: float, until: float, heard: float, delay: float) -> Gnss | None:
        """Fixes of the times after one and until another, heard by a third; they are stamped late
        by `delay` s, which is taken off.
        """
        rows = self._fixes.rows
        true = rows[:, 0] - delay
        on = slice(*np.searchsorted(true, [after, until], side="right").tolist())
        rows, true = rows[on], true[on]
        on_time = rows[:, 0] <= heard
        if not self._use_gnss or not on_time.any():
            return None
        lat, lon, height = rows[on_time, 1:4].T
        return Gnss(true[on_time], lat, lon, height, rows[on_time, 4:7])

    def between(self, after: float, until: float) -> Gnss | None:
        """Fixes in use, as stamped, after a time and until another, when they were heard."""
        return self.fixes(after, until, until, 0.0)

    def stops(self, after: float) -> Array:
        """Times after another at which nodes are wanted, sorted."""
        fixes, headings = (t.rows[int(np.searchsorted(t.rows, after)) :] for t in self._stops)
        return np.sort(np.concatenate([fixes, headings])) if len(headings) else fixes

    def heading_near(self, t: float) -> ExternalHeading | None:
        """The heading nearest to a node, if not used yet; all until t count as used."""
        heard, first = self._headings.rows, self._used
        time = heard[first:, 0]
        near = np.flatnonzero(np.abs(time - t) < HEADING_REACH_S)
        self._used = first + int(np.searchsorted(time, t, side="right"))
        if not len(near):
            return None
        best = first + int(near[np.abs(time[near] - t).argmin()])
        self._used = max(self._used, best + 1)
        return _heading(heard[best : best + 1])


def joined(headings: list[ExternalHeading | None]) -> ExternalHeading | None:
    """All headings of some nodes."""
    sensed = [h for h in headings if h is not None]
    if not sensed:
        return None
    times = np.concatenate([h.time for h in sensed])
    return ExternalHeading(times, np.concatenate([h.heading for h in sensed]))


def usual_fix(sd: float) -> Gnss:
    """A fix of a usual quality, for what must be known of fixes before one has come."""
    sigma = np.full((1, 3), sd)
    return Gnss(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), sigma)


def _heading(rows: Array) -> ExternalHeading | None:
    return ExternalHeading(rows[:, 0], rows[:, 1]) if len(rows) else None
