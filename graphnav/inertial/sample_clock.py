"""The IMU's own clock: samples come evenly, a host stamps them when it gets round to it.

A stamp is `t_k = t_0 + T n_k + late_k`: `n_k` counts the sampling steps, lost samples are whole
steps, and lateness never makes a stamp early. The count is the lower envelope of `t_k - T k`,
which climbs by T at every sample lost and comes down again after every late stamp.  Source: the
lower convex envelope of Moon, Skelly and Towsley 1999 (clock skew from one-way delays), by blocks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array

Steps = NDArray[np.int64]

BLOCK = 64  # samples whose earliest stamp tells the level of their lateness
FEWEST = 2 * BLOCK  # samples that tell a clock
KNOT_S, KNOT_SAMPLES = 10.0, 200  # at least, between the knots that follow the clock's drift
EVEN = 0.02  # of the step: stamps that scatter less follow each other evenly
CARRIED = 0.4  # scatter of whole blocks over that of single stamps: 0.2 of jitter, 1 of a wander
STALLED = 4.0  # steps: a stamp later than this is a stall
TRIED = 16_384  # samples that different steps are tried on
LOSS = 4.0  # steps of lateness that a lost sample has to explain
TRIALS = np.arange(-0.03, 0.02, 0.001)  # round a first guess, which lost samples make too long
WANDER = 1.75  # usual intervals: a longer one is a gap, where the intervals themselves vary
NARROW = 0.15  # scatter of the intervals, of the interval: their median is the step


@dataclass(frozen=True)
class SampleClock:
    """When the samples were taken, as far as their stamps tell."""

    time: Array  # (N,) s, end of each sample's interval
    steps: Steps  # (N,) sampling steps since the sample before; 1 where none was lost
    step: float  # s
    even: bool  # False: the intervals themselves vary, the stamps are believed
    late: Array  # (N,) s, how much later than `time` the stamp is

    @property
    def dt(self) -> Array:
        """Duration of one sampling step before each sample (N,) s."""
        gone = np.diff(self.time) / self.steps[1:]
        return np.concatenate([[np.median(gone)], gone])


def sample_clock(stamp: Array, step: float | None = None) -> SampleClock:
    """The clock behind the stamps (N,) s of an IMU's samples, which must not decrease.

    `step` s where it is known already.
    """
    gone = np.diff(stamp)
    usual = float(np.median(gone))
    ones, none = np.ones(len(stamp), np.int64), np.zeros(len(stamp))
    if np.abs(gone - usual).max() < 0.5 * EVEN * usual:
        return SampleClock(stamp, ones, usual, True, none)
    if len(stamp) >= FEWEST:
        step = step or _step(stamp)
        for _ in range(2):  # the second time with the step the first count tells
            number = _numbers(stamp, step)
            step = step + _slope(stamp - step * number, number)
        late = stamp - step * number
        drift = _drift(late, number, step)
        if _is_even(late - drift, step):
            return _even(stamp, number, step, late, drift)
    # where the intervals vary, only one beyond all usual ones is a gap
    usual = max(usual, float(gone.mean()) / 2)
    limit = WANDER * max(usual, float(np.quantile(gone, 0.99)))
    ones[1:][gone > limit] = np.round(gone[gone > limit] / usual).astype(np.int64)
    return SampleClock(stamp, ones, usual, False, none)


def _even(stamp: Array, number: Steps, step: float, late: Array, drift: Array) -> SampleClock:
    """Even samples; stamps that are even already stay as they are, to the last digit."""
    apart = late - drift
    steps = np.diff(number, prepend=number[0] - 1)
    if np.abs(apart).max() < 0.5 * EVEN * step:
        return SampleClock(stamp, steps, step, True, np.zeros(len(stamp)))
    earliest = float(np.quantile(apart, EVEN))
    return SampleClock(step * number + drift + earliest, steps, step, True, apart - earliest)


def _step(stamp: Array) -> float:
    """A first sampling step, s: the median interval, or the one that leaves least lateness."""
    gone = np.diff(stamp)
    usual, mean = float(np.median(gone)), float(stamp[-1] - stamp[0]) / len(gone)
    # the last sample of a burst waited least; what lies between two such is whole steps
    last = np.append(np.flatnonzero(gone > 0.5 * mean), len(gone))
    lag = min(max(3, round(BLOCK / 2 * len(last) / len(stamp))), len(last) - 1)
    between = float(
        np.median((stamp[last[lag:]] - stamp[last[:-lag]]) / (last[lag:] - last[:-lag]))
    )
    if np.median(np.abs(gone - usual)) < NARROW * usual and 0.9 * between < usual < 1.02 * between:
        return usual  # many samples lost: few stretches are whole, but the interval itself tells
    part = stamp[:TRIED]
    return float(min(between * (1 + TRIALS), key=lambda step: _left(part, float(step))))


def _left(stamp: Array, step: float) -> float:
    """Lateness, in steps, that a sampling step leaves; losses explain it, but not for nothing."""
    number = _numbers(stamp, step)
    late = stamp - step * number
    lost = float(number[-1] + 1 - len(number)) / len(number)
    return _spread(late - _drift(late, number, step), step) / step + LOSS * lost


def _numbers(stamp: Array, step: float) -> Steps:
    """The sampling step `n_k` of every stamp (N,), from 0, by the lower envelope."""
    count = len(stamp)
    blocks = -(-count // BLOCK)
    k = np.arange(blocks * BLOCK)
    above = np.full(blocks * BLOCK, np.inf)
    above[:count] = stamp - stamp[0] - step * k[:count]
    rows = above.reshape(blocks, BLOCK)
    low = rows.min(axis=1)
    climbs = np.round(np.diff(low, prepend=low[:1]) / step)
    level = np.cumsum(climbs)
    level = np.minimum.accumulate(level[::-1])[::-1]  # what comes down again was only late
    after = np.append(low[1:], np.inf)
    climbing = np.append(np.diff(level), np.inf)
    ahead = np.minimum.accumulate(rows[:, ::-1], axis=1)[:, ::-1]
    ahead = np.minimum(ahead, after[:, None])
    # a block that is late as a whole has the level of the earliest block after it
    floor = low - (np.cumsum(climbs) - level) * step
    inside = np.clip(np.round((ahead - floor[:, None]) / step), 0, climbing[:, None])
    lost = (level[:, None] + inside).ravel()[:count]
    return np.asarray(np.arange(count) + lost - lost[0], np.int64)


def _knots(number: Steps, step: float) -> NDArray[np.int64]:
    size = max(KNOT_SAMPLES, round(KNOT_S / step))
    return np.arange(0, max(len(number) - size // 2, 1), size)


def _medians(x: Array, first: NDArray[np.int64]) -> Array:
    return np.array([np.median(part) for part in np.split(x, first[1:])])


def _slope(late: Array, number: Steps) -> float:
    """What the step has to grow by, s: the median of the lateness's slopes between blocks."""
    size = 4 * BLOCK
    first = np.arange(0, max(len(late) - size // 2, 1), size)
    if len(first) < 2:
        return float(np.polyfit(number, late, 1)[0])
    level = _medians(late, first)
    return float(np.median(np.diff(level) / np.diff(_medians(number.astype(float), first))))


def _drift(late: Array, number: Steps, step: float) -> Array:
    """Slow part of the lateness (N,) s: the stamping clock's drift against the sampling clock."""
    first = _knots(number, step)
    at, level = _medians(number.astype(float), first), _medians(late, first)
    if len(first) < 2:
        return np.full(len(late), level[0])
    drift = np.interp(number, at, level)
    for end, (a, b) in ((number < at[0], (0, 1)), (number > at[-1], (-2, -1))):
        slope = (level[b] - level[a]) / (at[b] - at[a])
        drift[end] = level[a] + slope * (number[end] - at[a])
    return drift


def _is_even(apart: Array, step: float) -> bool:
    """Whether the lateness is jitter about an even clock, not a wander of uneven intervals.

    Jitter and bursts average out over a block; intervals that really vary add up to a wander which
    carries whole blocks along.
    """
    scatter = _spread(apart, step)
    blocks = np.array(
        [np.median(part) for part in np.split(apart, range(BLOCK, len(apart), BLOCK))]
    )
    return scatter < EVEN * step or _spread(blocks, step) < CARRIED * scatter


def _spread(x: Array, step: float) -> float:
    """Mean deviation from the median, rare stalls cut at a few steps."""
    return float(np.minimum(np.abs(x - np.median(x)), STALLED * step).mean())
