"""An encoder's counts as they were meant: wraps undone, wrong counts left out, resets bridged."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array, Odometer

WIDTHS = tuple(2.0**bits for bits in (*range(7, 17), 20, 24, 31, 32))
DECADES = tuple(10.0**digits for digits in range(3, 10))
NEIGHBOURS = 6  # steps to either side that a wrap has to agree with
HALF = 0.5  # of the jump: what a step unlike its neighbours may keep once its wrap is undone
NEARLY_ALL = 0.9  # of the wraps agree, or the counter was reset
STANDS_OUT, COUNTS = 5.0, 3.0  # times its surroundings, and counts, by which a count is wrong
FASTEST = 150.0  # m/s: a counter that implies more was reset
ACCELERATION = 50.0  # m/s^2: no wheel gains speed faster


@dataclass(frozen=True)
class Counted:
    """A counter's readings as distance, and what had to be undone for it."""

    odometer: Odometer
    notes: tuple[str, ...]


def counted(time: Array, counts: Array, per_count: float, clock: float = 0.0) -> Counted:
    """The distance a counter read at `time` (N,) s means, `per_count` m each.  Source: B1.

    `clock` is the file's own at time 0, for what is told.
    """
    notes = []
    width = _width(counts)
    values = counts if width is None else unwrapped(time, counts, width)
    wrong = _wrong(time, values, per_count)
    if wrong.any():
        first = clock + float(time[wrong][0])
        notes.append(
            f"{int(wrong.sum())} wrong counts of the odometer, first at {first:.3f}: left out"
        )
        time, counts = time[~wrong], counts[~wrong]
        values = counts if width is None else unwrapped(time, counts, width)
    if width is not None:
        wraps = int((np.abs(np.diff(counts)) > width / 2).sum())
        notes.append(f"the odometer's counter wraps at {width:.0f}, {wraps} times: undone")
    gone = np.diff(time)
    moved = np.diff(values) * per_count
    reset = np.abs(moved) > FASTEST * np.maximum(gone, 0.1)
    for i in np.flatnonzero(reset)[:1]:
        notes.append(
            f"the odometer's counter jumps {int(reset.sum())} times, first by "
            f"{moved[i] / per_count:.0f} at {clock + time[i + 1]:.3f}: taken as a reset, the speed "
            "around it goes on"
        )
    speed = moved / gone
    if reset.any() and not reset.all():
        at = np.flatnonzero(reset)
        speed[at] = np.interp(time[at], time[:-1][~reset], speed[~reset])
    way = np.concatenate([[0.0], np.cumsum(speed * gone)])
    return Counted(Odometer(time, way, np.concatenate([speed[:1], speed]), per_count), tuple(notes))


def unwrapped(time: Array, counts: Array, width: float) -> Array:
    """Counts (N,) read at `time` (N,) with every step within half the width of what is usual there.

    What is usual is the rate around, over the step's own duration: a reading may be missing.
    """
    step, gone = np.diff(counts), np.diff(time)
    rate = (step - width * np.round(step / width)) / gone
    around = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    at = np.clip(np.arange(len(step))[:, None] + around, 0, len(step) - 1)
    usual = np.median(rate[at], axis=1) * gone
    folded = step - width * np.round((step - usual) / width)
    return np.concatenate([counts[:1], counts[0] + np.cumsum(folded)])


def _width(counts: Array) -> float | None:
    """The width at which the counter is seen to wrap, if any explains its jumps.

    A wrap's step, folded, is like the steps beside it; a reset's is not.
    """
    step = np.diff(counts)
    # a lone reading far from both its neighbours is no sign of the range
    lone = np.append(False, (step[:-1] * step[1:] < 0) & (np.abs(np.diff(step)) > np.abs(step[1:])))
    usual = counts[~np.append(lone, False)] if len(counts) > 2 else counts
    low, high = float(usual.min()), float(usual.max())
    own = high - low + 1.0
    for width in sorted({*WIDTHS, *DECADES}):
        signed = low < 0 and -width / 2 <= low and high < width / 2
        if (not signed and not (low >= 0 and high < width)) or own < width / 2:
            continue
        wraps = np.flatnonzero(np.abs(step) > width / 2)
        if not len(wraps):
            return None
        folded = step - width * np.round(step / width)
        twice = np.diff(wraps, prepend=-2) == 1  # a wrong count jumps there and back
        single = wraps[~(twice | np.append(twice[1:], False))]
        wraps = single if len(single) else wraps
        around = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
        beside = folded[np.clip(wraps[:, None] + around[around != 0], 0, len(step) - 1)]
        usual = np.median(beside, axis=1)
        spread = np.abs(beside - usual[:, None]).max(axis=1)
        like = np.abs(folded[wraps] - usual) <= 2 * spread + 0.02 * width
        nearer = np.abs(folded[wraps] - usual) < HALF * np.abs(step[wraps] - usual)
        if (like & nearer).mean() >= NEARLY_ALL:
            return float(width)
    return None


def _wrong(time: Array, counts: Array, per_count: float) -> NDArray[np.bool_]:
    """Readings (N,) that leave the way between their neighbours, to which the next comes back."""
    out = np.zeros(len(counts), bool)
    if len(counts) < 2 * NEIGHBOURS:
        return out
    gone = np.diff(time)
    share = gone[:-1] / (gone[:-1] + gone[1:])
    between = counts[:-2] + share * (counts[2:] - counts[:-2])
    away = np.abs(counts[1:-1] - between)
    back = np.abs(counts[2:] - counts[:-2]) * per_count < FASTEST * (gone[:-1] + gone[1:])
    able = ACCELERATION * (gone[:-1] + gone[1:]) ** 2 / 8 / per_count + COUNTS
    for i in np.flatnonzero((away > able) & back).tolist():
        near = np.arange(max(i - NEIGHBOURS, 0), min(i + NEIGHBOURS + 1, len(away)))
        near = near[np.abs(near - i) > 1]
        lone = i in (0, len(away) - 1) or away[i] >= max(away[i - 1], away[i + 1])
        if lone and away[i] > STANDS_OUT * np.median(away[near]) + COUNTS:
            out[i + 1] = True
    return out
