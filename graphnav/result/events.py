"""Episodes in which the vehicle broke its constraint: side slips, hops, wheel spin and lock.

A slip lasts; single doubtful intervals do not make one. An episode is a run of down-weighted
intervals of one axis, short pauses bridged, whose peak stands clear of the usual residual.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array

DOUBTED = 0.3  # weight below which an interval belongs to an episode
PAUSE_S = 2.0
EDGE_S = 1.0
LEAST_PEAK = 0.3  # m/s; below it an episode moves nobody
KINDS = ("side_slip", "", "hop")


@dataclass(frozen=True)
class Event:
    """One episode; `peak_velocity` in m/s along the axis, signed."""

    start: float
    end: float
    kind: str
    axis: str
    peak_velocity: float


def events(end: Array, weight: Array, slip: Array, duration: Array, edges: Array) -> list[Event]:
    """Episodes from intervals that end at `end` (n,) s and last `duration` (n,) s.

    `weight` (n, 3) of lateral, forward, vertical; `slip` (n, 3) m/s, the velocity the constraint
    does not explain: motion of the vehicle, but odometer minus motion forward; at `edges` (K,) s,
    of stops and motion states, the odometer changes its meaning and forward that is no episode.
    """
    found = []
    start = end - duration
    near = np.zeros(len(end), bool)
    for edge in edges:
        near |= (start < edge + EDGE_S) & (end > edge - EDGE_S)
    for row, axis in enumerate(("x", "y", "z")):
        doubted = weight[:, row] < DOUBTED
        if row == 1:
            doubted &= ~near
        for first, last in _runs(doubted, start, end):
            inside = slice(first, last + 1)
            peak = float(slip[inside, row][np.argmax(np.abs(slip[inside, row]))])
            if abs(peak) >= LEAST_PEAK:
                kind = KINDS[row] or ("wheel_spin" if peak > 0 else "wheel_lock")
                found.append(Event(float(start[first]), float(end[last]), kind, axis, peak))
    return sorted(found, key=lambda e: e.start)


def _runs(mask: NDArray[np.bool_], start: Array, end: Array) -> list[tuple[int, int]]:
    """First and last index of runs of True, pauses up to `PAUSE_S` bridged."""
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(mask):
        if runs and start[k] - end[runs[-1][1]] <= PAUSE_S:
            runs[-1] = (runs[-1][0], int(k))
        else:
            runs.append((int(k), int(k)))
    return runs
