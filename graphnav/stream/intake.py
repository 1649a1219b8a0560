"""Sensors arriving piece by piece: increments, distances and speeds.

Causal but for `LOOK_AHEAD_S`: what is said of time t rests on what is known up to t + 0.5 s, which
the standstill window and the odometer's interpolation need, and on the IMU's samples of 0.4 s more,
which tell a measurement from a fault. The result does not depend on the sizes of the pieces.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from graphnav.common.errors import InputError
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, Odometer, SideSpeeds

LOOK_AHEAD_S = 0.5
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
