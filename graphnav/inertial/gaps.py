"""What was not seen is not known: samples that are missing, bridged from both sides and doubted.

A missing stretch takes rates and forces that lead from what was seen before it to what was seen
after. How wrong that may be is asked of the run itself: the same bridge is laid over stretches of
the same length nearby that were seen, and the root mean square of what it would have missed there
is its doubt. So a doubt follows from how the motion around a gap changes, from one sample on.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array, Imu
from graphnav.inertial.sample_clock import SampleClock, Steps

Mask = NDArray[np.bool_]

ENDS_S = 0.05  # mean of the samples to either side that a bridge stands on, at most half the gap
FADES_S = 3.0  # a manoeuvre's memory: deep in a longer gap the run's usual rate and force hold
AROUND_S, AROUND, AROUND_GAPS = 1.0, 30, 10  # to either side the motion is asked: s, samples, gaps
SHORT, BESIDE = 8, 6  # samples of a short gap, and of its neighbours to either side
LEARNT = 10_000  # stretches a short gap's bridge is learnt from, at most
JOLT = 30.0  # times the usual: what a vehicle does once in a run teaches no bridge
RIDGE = 1e-13  # of the neighbours' power: well below any sensor's noise
CROWDED = 4.0  # times the doubt of a gap that has other gaps beside it
PASSES = 4  # over gaps that have gaps for neighbours
COARSE = 16  # stretches tried in the length of a long gap
# rad/s, m/s^2 and s: turns and brakes that may begin and end unseen, once there is time for them
BEGUN, BEGINS_S = (0.1, 0.7), 0.5
UNKNOWN = 1e3  # rad/s or m/s^2 times samples: what a gap hides where nothing else was seen
FAR = 0.25  # of the run: longer stretches are not tried, their doubt grows as of a random walk


def bridged(imu: Imu, clock: SampleClock, seen: Mask) -> Imu:
    """The samples on their own clock, one for every sampling step, those not `seen` (N, 2) bridged.

    `seen` is told of gyro and accelerometer; steps lost between two samples are seen by neither.
    """
    if seen.all() and (clock.steps == 1).all():
        return replace(imu, time=clock.time, dt=clock.dt)
    at = np.cumsum(clock.steps) - 1
    count = int(at[-1]) + 1
    dt = np.repeat(clock.dt, clock.steps)
    time = np.interp(np.arange(count), at, clock.time)
    values, doubts = [], []
    for column, raw in enumerate((imu.gyro, imu.accel)):
        known = np.zeros(count, bool)
        known[at] = seen[:, column]
        filled = np.zeros((count, 3))
        filled[at] = raw
        doubts.append(_bridge(filled, known, clock.step, BEGUN[column]))
        values.append(filled)
    return Imu(time, dt, values[0], values[1], np.stack(doubts, -1))


def stretches(mask: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and one past the last index of every run of True."""
    change = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def _bridge(x: Array, known: Mask, step: float, least: float) -> Array:
    """Fill `x` (N, 3) where not known; what the integral of each filled sample may miss (N,).

    `least`: one sigma of what a driver may begin in a long gap.
    """
    doubt = np.zeros(len(x))
    first, end = stretches(~known)
    if not len(first) or not known.any():
        return doubt
    usual = np.median(x[known], axis=0)
    x[~known] = usual
    for a, b in zip(first, end, strict=True):
        _lay(x, known, int(a), int(b), step, usual)
    lengths, ends = end - first, end == len(x)
    for length, last in sorted({*zip(lengths.tolist(), ends.tolist(), strict=True)}):
        on = (lengths == length) & (ends == last)
        tried, missed = None, None
        if length <= SHORT and not last:
            tried, missed = _interpolated(x, known, length)
        if tried is None or missed is None:
            tried, missed = _tried(x, length, step, usual, last)
        over = min(length, _longest(x))
        whole = _whole(known, tried, over)
        reach = max(AROUND_S / step, AROUND, AROUND_GAPS * length) if not last else len(x)
        lost = _near(tried[whole], missed[whole], first[on], reach) / np.sqrt(over)
        share = step * np.maximum(lost, _driven(length, step, least))
        share = share * np.where(_alone(known, first[on], length), 1.0, CROWDED)
        for start, one in zip(first[on], share, strict=True):
            doubt[start : start + length] = one
    return doubt


def _lay(x: Array, known: Mask, a: int, b: int, step: float, usual: Array) -> None:
    """Bridge samples a to b - 1 of `x`, in place, from the means of those on either side."""
    width = _ends(b - a, step)
    ends = [_mean(x, known, a - width, a), _mean(x, known, b, b + width)]
    before, after = (usual if e is None else e for e in ends)
    share = _shares(b - a, width, step)
    x[a:b] = usual + share[::-1, None] * (before - usual) + share[:, None] * (after - usual)


def _interpolated(x: Array, known: Mask, length: int) -> tuple[Steps | None, Array | None]:
    """Fill short gaps of a length by what the run itself shows to follow from `BESIDE` neighbours.

    Least squares over stretches that were seen (a Wiener interpolator: vibration is carried on).
    Returns where it was tried (n,) and the largest of what three sums missed there (n,).
    """
    a = np.arange(BESIDE, len(x) - BESIDE - length + 1)
    a = a[:: max(1, len(a) // LEARNT)]
    learn = a[_whole(known, a, length)]
    if len(learn) < 20 * BESIDE:
        return None, None
    beside = np.concatenate([np.arange(-BESIDE, 0), length + np.arange(BESIDE)])
    first, end = stretches(~known)
    gaps = first[(end - first == length) & (first >= BESIDE) & (end <= len(x) - BESIDE)]
    missed = np.zeros(len(a))
    for k in range(3):
        level = float(np.mean(x[:, k]))
        seen = x[:, k] - level
        weights = _weights(seen[learn[:, None] + beside], seen[learn[:, None] + np.arange(length)])
        wrong = seen[a[:, None] + np.arange(length)] - seen[a[:, None] + beside] @ weights
        missed = np.maximum(missed, np.abs(wrong.sum(axis=1)))
        for _ in range(PASSES):  # a neighbour may be a bridge itself
            around = seen[gaps[:, None] + beside]
            low, high = around.min(axis=1)[:, None], around.max(axis=1)[:, None]
            laid = np.clip(around @ weights, 2 * low - high, 2 * high - low)
            seen[gaps[:, None] + np.arange(length)] = laid
        x[gaps[:, None] + np.arange(length), k] = level + seen[gaps[:, None] + np.arange(length)]
    return a, np.minimum(missed, JOLT * np.median(missed))


def _ends(length: int, step: float) -> int:
    """Samples to either side whose mean a bridge stands on."""
    return max(1, min(int(length) // 2, round(ENDS_S / step)))


def _mean(x: Array, known: Mask, a: int, b: int) -> Array | None:
    a, b = max(a, 0), min(b, len(x))
    on = known[a:b]
    return x[a:b][on].mean(axis=0) if on.any() else None


def _shares(length: int, width: int, step: float) -> Array:
    """Share of what follows in each sample of a gap, (length,); of what went before: reversed.

    The mean of an Ornstein-Uhlenbeck process between two known values: a straight line across a
    short gap, deep in a long one neither end.
    """
    reach = (width - 1) / 2  # from the gap's edge to the middle of the end samples
    fade = FADES_S / step
    whole = (length + 1 + 2 * reach) / fade
    at = (np.arange(length) + 1 + reach) / fade
    return np.asarray(np.exp(at - whole) * np.expm1(-2 * at) / np.expm1(-2 * whole))


def _weights(beside: Array, inside: Array) -> Array:
    """Least squares from neighbours (n, 12) to samples (n, m), jolts left out, (12, m)."""
    usual = np.ones(len(beside), bool)
    for _ in range(3):
        X, Y = beside[usual], inside[usual]
        square = X.T @ X
        ridge = RIDGE * np.trace(square) + np.finfo(float).tiny  # of an axis that never moves
        weights = np.linalg.solve(square + ridge * np.eye(len(square)), X.T @ Y)
        wrong = np.abs(inside - beside @ weights).max(axis=1)
        usual = wrong <= JOLT * np.median(wrong)
    return np.asarray(weights)


def _tried(
    x: Array, length: int, step: float, usual: Array, one_sided: bool
) -> tuple[Steps, Array]:
    """Where a long bridge was tried (n,) and the largest of what three sums missed there (n,).

    `one_sided`: nothing has been seen after it yet.
    """
    count = len(x)
    tried = min(length, _longest(x))
    width = _ends(tried, step)
    a = np.arange(width, count - tried - width + 1, max(1, tried // COARSE))
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(x - usual, axis=0)])
    ends = (total[a] - total[a - width]) / width
    if not one_sided:
        ends += (total[a + tried + width] - total[a + tried]) / width
    wrong = total[a + tried] - total[a] - float(_shares(tried, width, step).sum()) * ends
    return a, np.asarray(np.abs(wrong).max(axis=1))


def _longest(x: Array) -> int:
    """Samples of the longest bridge that is tried."""
    return max(1, int(FAR * len(x)))


def _driven(length: int, step: float, least: float) -> float:
    """What a manoeuvre may add in a gap, per root of its samples: a random walk once begun."""
    begun = max(length * step - BEGINS_S, 0.0)
    return least * float(np.sqrt(FADES_S * begun / length)) / step


def _whole(known: Mask, a: Steps, length: int) -> Mask:
    """Whether everything a bridge from `a` (n,) over `length` samples stands on was seen, (n,)."""
    dark = np.concatenate([[0], np.cumsum(~known)])
    low = np.maximum(a - BESIDE, 0)
    high = np.minimum(a + length + BESIDE, len(known))
    return np.asarray(dark[high] == dark[low])


def _alone(known: Mask, first: Steps, length: int) -> Mask:
    """Whether gaps from `first` (n,) have nothing but what was seen beside them, (n,)."""
    dark = np.concatenate([[0], np.cumsum(~known)])
    high = np.minimum(first + length + BESIDE, len(known))
    return np.asarray(dark[high] - dark[np.maximum(first - BESIDE, 0)] == length)


def _near(a: Steps, missed: Array, at: Steps, reach: float) -> Array:
    """Root mean square of `missed` (n,), found at `a`, within `reach` samples of `at` (k,)."""
    if not len(a):
        return np.full(len(at), UNKNOWN)
    sums = np.concatenate([[0.0], np.cumsum(missed**2)])
    low, high = np.searchsorted(a, at - reach), np.searchsorted(a, at + reach, side="right")
    found = high - low
    near = (sums[high] - sums[low]) / np.maximum(found, 1)
    return np.asarray(np.sqrt(np.where(found > 0, near, sums[-1] / len(a))))
