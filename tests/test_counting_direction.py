"""An odometer that counts the other way round from some moment on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graphnav.common.run import Imu, Odometer, Run, SideSpeeds
from graphnav.inertial.counting_direction import put_forward

AT = 40.0


def drive(pulse: float, rate_hz: int, braking: float = 0.0) -> Run:
    """80 s at 3 to 7 m/s; with a `braking` in s, from forward to backward at AT."""
    t = np.arange(1, 8001) / 100
    v = 5 + 2 * np.sin(t / 7)
    if braking:
        v *= -np.tanh(4 * (t - AT) / braking)
    force = np.stack([0 * t, np.gradient(v, t) - 0.2, np.full(len(t), 9.8)], -1)
    way = np.cumsum(v) / 100
    on = np.arange(0, len(t), 100 // rate_hz)
    count = np.round(way[on] / pulse) * pulse if pulse else way[on]
    imu = Imu(t, np.full(len(t), 0.01), np.zeros((len(t), 3)), force)
    odometer = Odometer(t[on], count, v[on], pulse)
    return Run(Path("run.csv"), 0.0, 80.0, imu, odometer, None, None, None, None)


def reversed_from(run: Run, *moments: float) -> Run:
    assert run.odometer is not None
    o = run.odometer
    sign = (-1.0) ** sum((o.time > at).astype(int) for at in moments)
    way = np.concatenate([[0.0], np.cumsum(np.diff(o.distance) * sign[1:])])
    speed = o.speed * sign
    sides = SideSpeeds(o.time, 0.9 * speed, 1.1 * speed)
    return replace(run, odometer=replace(o, distance=way, speed=speed), sides=sides)


@pytest.mark.parametrize(("pulse", "rate_hz"), [(0.02, 100), (0.1, 10), (0.0, 100), (0.0, 10)])
@pytest.mark.parametrize("moments", [(AT,), (AT, AT + 20)])
def test_it_is_read_as_it_began(pulse: float, rate_hz: int, moments: tuple[float, ...]) -> None:
    run = drive(pulse, rate_hz)
    assert run.imu is not None and run.odometer is not None
    mended, said = put_forward(reversed_from(run, *moments), run.imu)
    assert mended.odometer is not None and mended.sides is not None
    np.testing.assert_array_less(0.0, mended.odometer.speed)
    np.testing.assert_array_less(0.0, mended.sides.left)
    gone = mended.odometer.distance[-1] - mended.odometer.distance[0]
    assert gone == pytest.approx(np.ptp(run.odometer.distance), abs=1.0)
    assert len(said) == 1 and f"{AT:.0f}." in said[0]


def test_a_vehicle_that_turns_round_is_felt() -> None:
    run = drive(0.0, 100, braking=0.3)
    assert run.imu is not None
    assert put_forward(run, run.imu) == (run, [])
    whole = drive(0.02, 100)
    assert put_forward(whole, run.imu) == (whole, [])
