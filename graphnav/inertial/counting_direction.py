"""An odometer that counts the other way round from some moment on: a swapped plug, a lost phase.

At speed, forward turns into backward from one sample to the next, and the accelerometer feels
nothing of it. What is counted is as good as before but for its sign.
"""

from dataclasses import replace

import numpy as np

from factors.block import Index
from graphnav.common.run import Array, Imu, Odometer, Run
from graphnav.inertial.encoder import counted_anew

BESIDE_S, BESIDE = 0.3, 3  # s and samples, at least, to either side that tell the speed
DRIVING = 1.0  # m/s: slower, a vehicle turns round within a step
ALIKE = 0.5  # of the speed, by which both sides may differ: it changes meanwhile
FELT = 0.25  # of the change of velocity: less than that of a true one


def put_forward(run: Run, imu: Imu) -> tuple[Run, list[str]]:
    """The run with an odometer that counts throughout as it began, and what to say of it."""
    odometer = run.odometer
    at = np.zeros(0, np.int64) if odometer is None else turns(odometer, imu)
    if odometer is None or not len(at):
        return run, []
    begins = np.bincount(at, minlength=len(odometer.time))
    sign = 1.0 - 2.0 * (np.cumsum(begins) % 2)
    way = np.concatenate([[0.0], np.cumsum(np.diff(odometer.distance) * sign[1:])])
    mended = counted_anew(replace(odometer, distance=way, speed=odometer.speed * sign))
    sides = run.sides
    if sides is not None:
        there = np.interp(sides.time, odometer.time[at], np.arange(1, len(at) + 1), left=0.0)
        same = 1.0 - 2.0 * (np.floor(there) % 2)
        sides = replace(sides, left=sides.left * same, right=sides.right * same)
    when = ", ".join(f"{run.clock_start + t:.3f}" for t in odometer.time[at])
    said = (
        f"the odometer turns round at speed at {when}, of which the accelerometer feels nothing: "
        "it counts the other way round, read with its sign changed"
    )
    return replace(run, odometer=mended, sides=sides), [said]


def turns(odometer: Odometer, imu: Imu) -> Index:
    """Numbers of the first samples (n,) that count the other way round than those before."""
    time, moved = odometer.time, np.diff(odometer.distance)
    moves = np.flatnonzero(moved)
    k = np.flatnonzero(np.diff(np.sign(moved[moves])))
    # a coarse counter rests between two counts, and the one on the turn may have been left out
    last, first = time[moves[k] + 1], time[moves[k + 1]]
    usual = float(np.median(np.diff(time)))
    beside = max(BESIDE_S, BESIDE * usual)
    before = _pace(odometer, last - usual - beside, beside)
    after = _pace(odometer, first + usual, beside)
    change = np.abs(before - after)
    opposite = (np.abs(before + after) < ALIKE * change / 2) & (change > 2 * DRIVING)
    quiet = _felt(imu, (last + first) / 2, beside) < FELT * change
    number = moves[k + 1][opposite & quiet & (first - last < beside)] + 1
    # of speeds, the step on the turn is the mean of both
    return np.asarray(number - (odometer.speed[number - 1] * odometer.speed[number] > 0))


def _pace(odometer: Odometer, start: Array, over: float) -> Array:
    """Speed (n,) m/s from each start on."""
    way = [np.interp(t, odometer.time, odometer.distance) for t in (start, start + over)]
    return np.asarray((way[1] - way[0]) / over)


def _felt(imu: Imu, at: Array, beside: float) -> Array:
    """Change of velocity (n,) m/s felt about each moment, beyond the steady force beside it."""
    edge = np.concatenate([imu.time[:1] - imu.dt[:1], imu.time])
    gained = np.concatenate([np.zeros((1, 3)), np.cumsum(imu.accel * imu.dt[:, None], axis=0)])
    v = [
        np.stack([np.interp(at + k * beside, edge, axis) for axis in gained.T], -1)
        for k in (-2, -1, 1, 2)
    ]
    return np.asarray(np.linalg.norm((v[2] - v[1]) - (v[3] - v[2]) - (v[1] - v[0]), axis=1))
