"""An encoder that failed: dead, stuck or out of its mind, dropped from where it failed.

A wheel that stops without the vehicle braking, or that keeps one speed to the last digit while all
else moves, tells nothing any more. What the IMU feels decides, so fixes are not needed.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from graphnav.common.run import Imu, Odometer
from graphnav.inertial.gaps import Mask, stretches

FASTEST, ACCELERATION = 150.0, 50.0  # m/s, m/s^2: no wheel does more
JUMP_S, JUMPS, OFTEN_S = 0.25, 4, 3.0  # s over which speed is told, jumps, and s they come within
APART_S = 30.0  # between two fits of jumping
LEAST_S = 3.0  # a failure lasts longer
DRIVING = 1.0  # m/s before it: slower, and the brakes are not felt
STOPS_S = 1.5  # about the end of counting, in which the brakes are felt
FELT = 0.5  # of the speed lost that the accelerometer has to feel
BRIDGED = 0.1  # of the samples: what was felt is not known
LEVEL_S = 5.0  # to either side that tell which way down is
REPEATS = 20  # samples of one speed
LONGER, SELDOM = 4.0, 3  # times as long as all but a few other repetitions of the run
NEIGHBOURS = 4  # samples to either side of a wrong speed
STANDS_OUT = 5.0  # times its surroundings


@dataclass(frozen=True)
class Failure:
    """Samples of the odometer that tell nothing."""

    what: str
    mask: Mask  # (M,)


def failures(odometer: Odometer, imu: Imu, felt: bool = True) -> list[Failure]:
    """Where the odometer failed, by what happened to it; without accelerometers brakes are not
    `felt`.
    """
    if len(odometer.time) < REPEATS:
        return []
    found = [
        Failure("counted what no wheel does", _wild(odometer)),
        Failure("jumps about", _jumping(odometer)),
        Failure("stuck at one speed", _stuck(odometer)),
    ]
    if felt:
        dead = _dead(odometer, imu)
        found.insert(2, Failure("died: it stopped without the vehicle braking", dead))
    return [f for f in found if f.mask.any()]


def without(odometer: Odometer, failed: Mask) -> Odometer | None:
    """The odometer without its failed samples; silent where they were."""
    keep = ~failed
    if keep.sum() < 2:
        return None
    time, distance, speed = (x[keep] for x in (odometer.time, odometer.distance, odometer.speed))
    return counted_anew(replace(odometer, time=time, distance=distance, speed=speed))


def counted_anew(odometer: Odometer) -> Odometer:
    """The odometer after its samples or their times changed: speeds integrated again."""
    if odometer.pulse:
        return odometer
    speed = odometer.speed
    steps = np.diff(odometer.time) * (speed[1:] + speed[:-1]) / 2
    return replace(odometer, distance=np.append(0.0, np.cumsum(steps)))


def _wild(odometer: Odometer) -> Mask:
    """Single speeds (M,) far from those around them; a counter's are looked at where it is read."""
    v, time = odometer.speed, odometer.time
    out = ~(np.abs(v) < FASTEST)
    if odometer.pulse or len(v) < 4 * NEIGHBOURS:
        return out & (odometer.pulse == 0)
    v = np.where(out, 0.0, v)
    gone = np.diff(time)
    away = np.minimum(np.abs(v[1:-1] - v[:-2]), np.abs(v[1:-1] - v[2:]))
    for i in np.flatnonzero(away > ACCELERATION * np.minimum(gone[:-1], gone[1:])).tolist():
        near = np.arange(max(i + 1 - NEIGHBOURS, 0), min(i + 2 + NEIGHBOURS, len(v)))
        others = v[near[near != i + 1]]
        spread = float(np.median(np.abs(others - np.median(others))))
        out[i + 1] |= abs(v[i + 1] - float(np.median(others))) > STANDS_OUT * spread + DRIVING
    return out


def _jumping(odometer: Odometer) -> Mask:
    """Samples (M,) among speeds that jump again and again as no wheel can, and those between."""
    time = odometer.time
    grid = np.arange(time[0], time[-1], JUMP_S)
    out = np.zeros(len(time), bool)
    if len(grid) < 4:
        return out
    speed = np.diff(np.interp(grid, time, odometer.distance)) / JUMP_S
    at = grid[1:-1][np.abs(np.diff(speed)) > ACCELERATION * JUMP_S]
    often = np.searchsorted(at, at + OFTEN_S, side="right") - np.arange(len(at)) >= JUMPS
    begins, ends = at[often], at[np.flatnonzero(often) + JUMPS - 1]
    for a, b in zip(begins, ends, strict=True):
        out[(time > a - JUMP_S) & (time < b + JUMP_S)] = True
    if out.any():  # what it counts between two fits is no better
        bad = time[out]
        for a, b in pairwise(bad.tolist()):
            if b - a < APART_S:
                out[(time > a) & (time < b)] = True
    return out


def _dead(odometer: Odometer, imu: Imu) -> Mask:
    """Samples (M,) of zero speed that began without the vehicle braking."""
    out = np.zeros(len(odometer.time), bool)
    time, moved = odometer.time, np.diff(odometer.distance)
    first, end = stretches(moved == 0)
    forward = np.concatenate([[0.0], np.cumsum(imu.accel[:, 1] * imu.dt)])
    edge = np.concatenate([imu.time[:1] - imu.dt[:1], imu.time])
    for a, b in zip(first.tolist(), end.tolist(), strict=True):
        start, stop = float(time[a]), float(time[b])
        before = start - STOPS_S / 2
        if stop - start < LEAST_S or before - LEVEL_S < edge[0]:
            continue
        speed = _speed(odometer, before)
        if abs(speed) < DRIVING or abs(_speed(odometer, start - 0.2)) < 0.5 * abs(speed):
            continue
        at = [before - LEVEL_S, before, start + STOPS_S / 2, start + STOPS_S / 2 + LEVEL_S]
        v = np.interp(np.minimum(at, edge[-1]), edge, forward)
        if imu.doubt is not None and _doubted(imu, at[0], at[-1]):
            continue
        # which way is down: before the stop the odometer's own speed is taken off
        gained = speed - _speed(odometer, at[0])
        level = (v[1] - v[0] - gained) / LEVEL_S
        felt = v[2] - v[1] - level * STOPS_S
        if -felt * np.sign(speed) < FELT * abs(speed):
            out[a + 1 : b + (b == len(moved))] = True
            if b == len(moved):
                out[b] = True
    return out


def _doubted(imu: Imu, start: float, end: float) -> bool:
    """Whether the accelerometer's samples in a span s are bridges for a good part."""
    assert imu.doubt is not None
    on = (imu.time > start) & (imu.time <= end)
    return bool((imu.doubt[on, 1] > 0).mean() > BRIDGED)


def _speed(odometer: Odometer, at: float) -> float:
    """Speed over half a second about a time, m/s."""
    d = np.interp([at - 0.25, at + 0.25], odometer.time, odometer.distance)
    return float(d[1] - d[0]) / 0.5


def _stuck(odometer: Odometer) -> Mask:
    """Samples (M,) that repeat a speed, not zero, for far longer than the sensor otherwise does."""
    out = np.zeros(len(odometer.time), bool)
    if odometer.pulse:
        return out
    first, end = stretches((np.diff(odometer.speed) == 0) & (odometer.speed[1:] != 0))
    lasted = odometer.time[end] - odometer.time[first]
    for a, b, s in zip(first.tolist(), end.tolist(), lasted, strict=True):
        if s > LEAST_S and b - a > REPEATS and (lasted > s / LONGER).sum() <= SELDOM:
            out[a + 1 : b + 1] = True
    return out
