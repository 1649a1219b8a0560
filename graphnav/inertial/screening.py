"""Samples that are no measurement: absurd, spikes, stuck, zeroed, clipped or filled stretches.

Each test names the samples of one sensor, gyro or accelerometer, that did not measure the motion;
what they hide is then a gap like any other. A test compares the data with themselves: a spike with
its neighbours, a repeated value with how often the sensor repeats itself, a ceiling with the values
below it. So it knows no grade, and leaves vibration and hops alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array, Imu
from graphnav.inertial.gaps import Mask, stretches

ABSURD = (100.0, 5000.0)  # rad/s, m/s^2: beyond any gyro and any accelerometer of a vehicle
FEW = 0.01  # of the samples: a larger share is another unit or another sensor, not a fault
BLOCK = 64  # samples whose median step tells how much the signal moves from one to the next
STEP = 8.0  # median steps: a larger one is looked at
WAITED = 4  # samples after it, where they are yet to come
CONTEXT = 12  # samples to either side that a suspect is compared with
LONGEST, LONGEST_S = 5, 0.05  # samples and s of a spike
STANDS_OUT = 3.0  # over the largest second difference of its context, about 15 sigma
ALIKE = 6.0  # times as rough before as after, or after as before: a vehicle that starts or stops
RETURNS = 3.0  # largest steps of its context: a level that changed by more is a jolt, no spike
RETURNED = 2  # samples at least on the level before and after a spike
REPEATS, REPEATS_S = 5, 0.05  # samples and s that a stuck stretch lasts at least
CHANCE = 1e-4  # of such a stretch anywhere in the run
COARSE = 0.2  # of the samples repeat the one before: a sensor that does so is never stuck
THEREABOUTS = 500  # samples to either side that tell how often a channel repeats itself
REGULAR, SPACED = 0.5, 8  # scatter of the spacing, of the spacing: 1 at random; spacings that tell
OWN_SHARE = 0.5  # of the run: a value held since its start for longer was not recorded
CEILING = 3  # samples at exactly the largest value
PILED = 5.0  # times as many as at the values just below it
TINY = 1e-12  # of a channel that never moves
BENT = 2.0  # quanta that rounding bends a straight line, at most
LEADS = 8.0  # quanta between a filled stretch's ends, in one channel at least
NAMES = ("gyro", "accelerometer")


@dataclass(frozen=True)
class Screened:
    """Samples of one sensor that one test found."""

    sensor: int  # 0 gyro, 1 accelerometer
    what: str
    mask: Mask  # (N,)


def screened(imu: Imu, step: float, at_standstill: Mask, causal: bool = False) -> list[Screened]:
    """What the samples of an IMU hold that is no measurement; `step` s between samples.

    `at_standstill` (N,) where the vehicle is heard to stand: a sensor may repeat itself there.
    `causal`: few samples after a spike are waited for.
    """
    absurd = [_absurd(x, most) for x, most in zip((imu.gyro, imu.accel), ABSURD, strict=True)]
    sound = [_carried(x, bad) for x, bad in zip((imu.gyro, imu.accel), absurd, strict=True)]
    spikes = _spikes(np.concatenate(sound, axis=1), step, WAITED if causal else CONTEXT)
    held = _held(np.concatenate(sound, axis=1))
    filled = _filled(np.concatenate(sound, axis=1), imu.time)
    found: list[Screened] = []
    for sensor in (0, 1):
        own = spikes[:, 3 * sensor : 3 * sensor + 3].any(axis=1) & ~absurd[sensor]
        found += [
            Screened(sensor, "out of any range", absurd[sensor]),
            Screened(sensor, "a spike", own),
            Screened(sensor, "stuck", stuck := _stuck(sound[sensor], step, at_standstill)),
            Screened(sensor, "a repeat of the sample before", held & ~stuck),
            Screened(sensor, "a straight line from one sample to another", filled),
            Screened(sensor, "clipped", _clipped(sound[sensor])),
        ]
    return [f for f in found if f.mask.any()]


def _absurd(values: Array, most: float) -> Mask:
    """Samples (N,) no sensor measures; all of them sound where they are too many for a fault."""
    absurd = ~(np.abs(values) < most).all(axis=1)
    return np.asarray(absurd & (absurd.mean() < FEW))


def _carried(values: Array, bad: Mask) -> Array:
    """Values with the bad ones taken from the sample before."""
    if not bad.any():
        return values
    good = np.maximum.accumulate(np.where(bad, -1, np.arange(len(bad))))
    good[good < 0] = int(np.flatnonzero(~bad)[0])
    return values[good]


def _spikes(x: Array, step: float, later: int) -> Mask:
    """Which samples of six channels (N, 6) leave the level of their neighbours and come back to it.

    `later` samples after it are looked at. A jolt of the vehicle leaves another level or roughness
    in one of the channels, a spike none.
    """
    out = np.zeros(x.shape, bool)
    if len(x) < 4 * CONTEXT:
        return out
    moved = np.abs(np.diff(x, axis=0))
    quantum = np.array([_quantum(m) for m in moved.T])
    suspects = np.flatnonzero((moved > STEP * _usual(moved, quantum)).any(axis=1))
    if not len(suspects):
        return out
    span = np.ptp(x[RETURNED:-RETURNED], axis=0)
    pad = CONTEXT + LONGEST + 1
    y = np.pad(x, ((pad, pad), (0, 0)), mode="reflect")
    for length in range(1, max(1, min(LONGEST, int(LONGEST_S / step))) + 1):
        first = np.unique(np.concatenate([suspects + 1, suspects + 1 - length]))
        first = first[(first >= 0) & (first + length <= len(x))]
        before = y[first[:, None] + pad + np.arange(-CONTEXT, 0)]
        inside = y[first[:, None] + pad + np.arange(length)]
        after = y[first[:, None] + pad + length + np.arange(later)]
        spiked, sides = _stand_out(before, inside, after, quantum)
        # with nothing after it, or before, no return is seen: only what the run never comes near
        ends = (first < RETURNED) | (first + length > len(x) - RETURNED)
        spiked &= ~ends[:, None] | (sides > RETURNS * span)
        for k in range(length):
            out[first + k] |= spiked
    return out


def _stand_out(before: Array, inside: Array, after: Array, quantum: Array) -> tuple[Mask, Array]:
    """Which candidates (n, 6) leave the level of what comes before and after them (n, ., 6), where
    that is one; and by how much their sides step (n, 6). `quantum` (6,): the channels' resolution.
    """
    length = inside.shape[1]
    a, b = before[:, -2:].mean(axis=1), after[:, :2].mean(axis=1)
    share = ((np.arange(length) + 1) / (length + 1))[:, None]
    away = np.abs(inside - a[:, None] - (b - a)[:, None] * share).min(axis=1)
    sides = np.abs([inside[:, 0] - before[:, -1], inside[:, -1] - after[:, 0]]).min(axis=0)
    rough = [_largest(part, 2) + quantum for part in (before, after)]
    usual = [_scatter(part) + quantum for part in (before, after)]
    level = [_largest(part, 1) + quantum for part in (before, after)]
    same = np.maximum(usual[0] / usual[1], usual[1] / usual[0]) < ALIKE
    same &= np.abs(b - a) < (RETURNS + length) * np.maximum(*level)
    spiked = away > STANDS_OUT * np.maximum(*rough)
    spiked &= (away > RETURNS * np.abs(b - a)) & (sides > RETURNS * np.maximum(*level))
    spiked &= np.asarray(same.all(axis=1))[:, None]
    return spiked, sides


def _largest(x: Array, order: int) -> Array:
    """Largest difference of an order among samples (n, CONTEXT, 6), (n, 6)."""
    return np.asarray(np.abs(np.diff(x, order, axis=1)).max(axis=1))


def _scatter(x: Array) -> Array:
    """Root mean square second difference of samples (n, CONTEXT, 6), (n, 6)."""
    return np.asarray(np.sqrt((np.diff(x, 2, axis=1) ** 2).mean(axis=1)))


def _usual(moved: Array, quantum: Array) -> Array:
    """How much six channels (N, 6) usually move from sample to sample, about each step."""
    size = min(BLOCK, len(moved))
    whole = len(moved) // size * size
    local = np.median(moved[:whole].reshape(-1, size, moved.shape[1]), axis=1)
    local = np.maximum(local, np.median(local, axis=0)) + quantum
    block = np.minimum(np.arange(len(moved)) // size, len(local) - 1)
    return np.asarray(local[block])


def _quantum(moved: Array) -> float:
    """The least the signal moves when it does."""
    few = moved[: 100 * BLOCK]
    few = few[few > 0]
    return float(few.min()) if len(few) else TINY


def _stuck(values: Array, step: float, at_standstill: Mask) -> Mask:
    """Samples (N,) that repeat the one before for longer than the sensor ever would by chance."""
    same = np.diff(values, axis=0) == 0
    out = np.zeros(len(values), bool)
    for repeated in (same.all(axis=1), *same.T):
        if repeated.sum() < REPEATS:
            continue
        first, end = stretches(repeated)
        length = end - first
        long = length >= max(REPEATS, round(REPEATS_S / step))
        usual = (len(repeated) - length[long].sum() + 1) or 1
        by_chance = (repeated.sum() - length[long].sum() + 1) / usual
        if by_chance >= COARSE:
            continue
        for a, b in zip(first[long].tolist(), end[long].tolist(), strict=True):
            likely = len(values) * by_chance ** (b - a)
            never = a == 0 and b > OWN_SHARE * len(values)  # not recorded, from the beginning
            if likely < CHANCE and not never and at_standstill[a : b + 1].mean() <= 0.5:
                out[a + 1 : b + 1] = True
    return out


def _held(x: Array) -> Mask:
    """Samples (N,) that a logger filled with the one before: all six channels (N, 6) repeat.

    Not by chance, from how often each channel repeats itself thereabouts; and not regularly, as of
    a sensor that is polled faster than it measures.
    """
    same = np.diff(x, axis=0, prepend=x[:1] + 1) == 0
    held = same.all(axis=1)
    at = np.flatnonzero(held)
    if not len(at) or held.mean() >= COARSE:
        return np.zeros(len(x), bool)
    apart = np.diff(at[np.diff(at, prepend=-2) > 1])
    polled = len(apart) >= SPACED and np.std(apart) < REGULAR * np.mean(apart)
    out = np.zeros(len(x), bool)
    out[at] = (len(x) * _chance(same, held, at) < CHANCE) & (not polled)
    return out


def _filled(x: Array, time: Array) -> Mask:
    """Samples (N,) that somebody interpolated: all six channels (N, 6) run straight between two.

    To the last digit, over their stamps (N,) s or their count; not by chance, from how often each
    channel does so thereabouts. Data resampled as a whole are left alone.
    """
    quantum = np.array([_quantum(m) for m in np.abs(np.diff(x, axis=0)).T])
    gone = np.diff(time)
    by_stamp = (gone[:-1] / np.maximum(time[2:] - time[:-2], TINY))[:, None]
    straight = np.zeros(x.shape, bool)
    for share in (0.5, by_stamp):
        bend = np.abs(x[1:-1] - x[:-2] - share * (x[2:] - x[:-2]))
        straight[1:-1] |= bend <= BENT * quantum
    filled = np.asarray(straight.all(axis=1))
    if not filled.any() or filled.mean() >= COARSE:
        return np.zeros(len(x), bool)
    first, end = stretches(filled)
    leads = (np.abs(x[end] - x[first - 1]) > LEADS * quantum).any(axis=1)
    likely = len(x) * _chance(straight, filled, first) ** (end - first)
    out = np.zeros(len(x), bool)
    for a, b in zip(first[leads & (likely < CHANCE)], end[leads & (likely < CHANCE)], strict=True):
        out[a:b] = True
    return out


def _chance(so: NDArray[np.bool_], all_so: Mask, at: NDArray[np.intp]) -> Array:
    """How likely all six channels are so by chance at samples `at` (n,), as often as each is so
    alone thereabouts, (n,); `so` (N, 6) by channel.
    """
    low, high = np.maximum(at - THEREABOUTS, 0), np.minimum(at + THEREABOUTS, len(so))
    alone = np.concatenate([np.zeros((1, 6), int), np.cumsum(so & ~all_so[:, None], axis=0)])
    rows = np.concatenate([[0], np.cumsum(~all_so)])
    count, of = alone[high] - alone[low], rows[high] - rows[low]
    return np.asarray(((count + 1) / (of + 1)[:, None]).prod(axis=1))


def _clipped(values: Array) -> Mask:
    """Samples (N,) at a ceiling that the data pile up at."""
    out = np.zeros(len(values), bool)
    for x in values.T:
        for side in (x, -x):
            top = float(side.max())
            at = side == top
            if at.sum() < CEILING or at.mean() > FEW**0.5:
                continue
            reach = top - float(np.median(side))
            below = np.unique(side[(side < top) & (side > top - 0.2 * reach)], return_counts=True)[
                1
            ]
            if at.sum() > PILED * (below[-5:].mean() if len(below) else 1.0):
                out |= at
    return out
