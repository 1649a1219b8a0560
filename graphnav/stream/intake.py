"""Sensors arriving piece by piece: increments, standstill and where the next node belongs.

Causal but for `LOOK_AHEAD_S`: what is said of time t rests on what is known up to t + 0.5 s, which
the standstill window and the odometer's interpolation need, and on the IMU's samples of 0.4 s more,
which tell a measurement from a fault. The result does not depend on the sizes of the pieces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from graphnav.common.errors import InputError
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, Odometer, SideSpeeds
from graphnav.graph.nodes import REST_INTERVAL_S, room_of
from graphnav.inertial.standstill import QUIET_FORCE, QUIET_RATE, SHORTEST_S, Mask, quietness, spans
from graphnav.stream.inertial_intake import Inertial

LOOK_AHEAD_S = 0.5
FRAME = 20  # increments after which the usual quietness is measured anew
REMEMBERED = 1200  # increments of standstill it is the median of
MARGIN_S, MARGIN_SAMPLES = 1.0, 3  # of the odometer before an interval


def sound(sensor: str, time: ArrayLike, values: Sequence[ArrayLike | None]) -> list[Array]:
    """Times (n,) and values (n, ...) of the samples in which every number is one.

    Raises InputError where their sizes differ.
    """
    t, *columns = (np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (time, *values))
    keep = np.isfinite(t)
    for x in columns:
        if not x.size and not len(t):
            return [t, *columns]
        if len(x) != len(t) or (x.ndim == 2 and x.shape[1] != 3):
            raise InputError(f"{sensor}: values of shape {x.shape} for {len(t)} times")
        keep &= np.isfinite(x.reshape(len(t), -1)).all(axis=1)
    return [x[keep] for x in (t, *columns)]


class Distance:
    """Odometer samples as they come."""

    def __init__(self, pulse: float = 0.0) -> None:
        """`pulse` m per count; 0 when speeds come."""
        self.pulse = pulse
        self._tape = GrowingArray(3)  # time, distance, speed
        self._count = np.nan  # newest counter reading

    def __len__(self) -> int:
        return len(self._tape)

    def add_speed(self, time: Array, speed: Array) -> None:
        """Speeds (n,) m/s, integrated by trapezoids."""
        if not len(time):
            return
        old = self._tape.rows[-1:]
        t, v = np.append(old[:, 0], time), np.append(old[:, 2], speed)
        step = 0.5 * np.diff(t) * (v[1:] + v[:-1])
        step = step if len(old) else np.append(0.0, step)
        start = float(old[0, 1]) if len(old) else 0.0
        self._tape.append(np.column_stack([time, start + np.cumsum(step), speed]))

    def add_pulses(self, time: Array, pulses: Array, fastest: float) -> None:
        """Counter readings (n,); a step faster than `fastest` m/s is a reset and counts nothing."""
        if not len(time):
            return None
        old = self._tape.rows[-1:]
        if not len(old):
            self._tape.push(np.array([time[0], 0.0, 0.0]))
            self._count = float(pulses[0])
            return self.add_pulses(time[1:], pulses[1:], fastest) if len(time) > 1 else None
        gap = np.diff(time, prepend=old[0, 0])
        moved = np.diff(pulses, prepend=self._count) * self.pulse
        moved = np.where(np.abs(moved) > fastest * np.maximum(gap, 0.1), 0.0, moved)
        self._count = float(pulses[-1])
        self._tape.append(np.column_stack([time, old[0, 1] + np.cumsum(moved), moved / gap]))
        return None

    def around(self, start: float, end: float) -> Odometer | None:
        """The samples that matter between two times, or None when fewer than two came yet."""
        part = self._tape.rows[_around(self._tape.rows[:, 0], start, end)]
        if len(part) < 2:
            return None
        return Odometer(part[:, 0], part[:, 1], part[:, 2], self.pulse)


class Sides:
    """Speeds of both sides as they come."""

    def __init__(self) -> None:
        self._tape = GrowingArray(3)  # time, left, right

    def add(self, time: Array, left: Array, right: Array) -> None:
        """Times (n,) s and speeds (n,) m/s."""
        self._tape.append(np.column_stack([time, left, right]))

    def around(self, start: float, end: float) -> SideSpeeds | None:
        """The samples that matter between two times, or None when fewer than two came yet."""
        part = self._tape.rows[_around(self._tape.rows[:, 0], start, end)]
        return SideSpeeds(part[:, 0], part[:, 1], part[:, 2]) if len(part) > 1 else None


def _around(t: Array, start: float, end: float) -> slice:
    """Which samples at times t (n,) matter between two times."""
    first = max(int(np.searchsorted(t, start - MARGIN_S)) - MARGIN_SAMPLES, 0)
    return slice(first, int(np.searchsorted(t, end + LOOK_AHEAD_S, side="right")))


class Rest:
    """Which increments are at standstill, as `standstill.standing` has it but without the future:
    quiet for a second already, compared with the standstills so far.
    """

    def __init__(self) -> None:
        self.still = GrowingArray()  # 0 or 1 by increment
        self._usual = GrowingArray(2)  # deviations while the odometer was silent
        self._limit = np.full(2, np.inf)
        self._quiet_s = 0.0  # how long it has been quiet

    def advance(self, inertial: Inertial, odometer: Distance, ready: int) -> None:
        """Judge the increments up to `ready`, which must have their look-ahead."""
        done = len(self.still)
        if ready <= done:
            return
        before = max(done - 2 * FRAME, 0)
        inc = inertial.between(before, len(inertial))
        there = odometer.around(inc.edge[0], inc.edge[-1])
        shake, turn, slow, silent = quietness(inc, there)
        deviation, dt = np.column_stack([shake, turn]), np.diff(inc.edge)
        frames = np.arange(done - done % FRAME + FRAME, ready, FRAME)
        for a, b in pairwise([done, *frames.tolist(), ready]):
            on = slice(a - before, b - before)
            if not len(odometer):
                quiet = (deviation[on] < (QUIET_FORCE, QUIET_RATE)).all(1) & slow[on]
            else:
                quiet = silent[on] & (deviation[on] < self._limit).all(1)
                self._usual.append(deviation[on][silent[on]])
            self.still.append(self._lasting(quiet, dt[on]))
            if b % FRAME == 0 and len(self._usual):
                usual = np.median(self._usual.rows[-REMEMBERED:], axis=0)
                self._limit = 4 * usual + (1e-3, 1e-6)

    def _lasting(self, quiet: Mask, dt: Array) -> Array:
        """Quiet increments that end at least `SHORTEST_S` of quiet."""
        lasted = np.cumsum(dt)
        broken = np.maximum.accumulate(np.where(quiet, -self._quiet_s, lasted))
        lasted = np.where(quiet, lasted - broken, 0.0)
        self._quiet_s = float(lasted[-1])
        return (lasted > SHORTEST_S - 1e-6).astype(np.float64)

    def spans(self, edge: Array, until: int) -> Array:
        """Standstills among the first `until` increments, (K, 2) s."""
        return spans(self.still.rows[:until] > 0, edge)


@dataclass(frozen=True)
class Sensors:
    """What a stream has heard of the vehicle's own motion."""

    inertial: Inertial = field(default_factory=Inertial)
    rest: Rest = field(default_factory=Rest)
    odometer: Distance = field(default_factory=Distance)
    sides: Sides = field(default_factory=Sides)


def next_node(
    last: int, edge: Array, still: Array, aids: Array, start: float, interval: float
) -> int | None:
    """Edge number of the node after edge `last`, or None while that is open.

    Nodes stand where standstill begins or ends, at `aids` (sorted times of fixes), else at every
    `interval` s since `start`, at rest every ten. `still` covers the increments that are judged,
    `aids` reach `LOOK_AHEAD_S` further.
    """
    ready, t = len(still), float(edge[last])
    if last >= ready:
        return None
    resting, half = still[last] > 0, 0.5 * float(edge[last + 1] - t)
    if resting:
        target = t + REST_INTERVAL_S
    else:
        room = room_of(interval)
        target = start + np.floor((t - start + room) / interval + 1) * interval
        k = int(np.searchsorted(aids, t + room))
        if k < len(aids) and aids[k] < target + room:
            target = float(aids[k])
    # an edge may not be the last of the judged ones: a change of standstill is seen after it
    found = max(int(np.searchsorted(edge[:ready], target - half)), last + 1)
    changes = np.flatnonzero(np.diff(still[last : found + 1])) + last + 1
    if len(changes):
        return int(min(changes[0], found))
    return found if found < ready else None
