"""Jumps of the recording's clock, told from pauses of the recorder."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graphnav.common.earth import Origin
from graphnav.common.run import Gnss, Imu, Odometer, Run
from graphnav.inertial.clock_jumps import without_jumps

ORIGIN = Origin(0.7, 0.2, 100.0)
AT = 60.0


def drive(counter: bool, fixes: bool, pause: float = 0.0) -> Run:
    """Two minutes at about 10 m/s in gentle bends; `pause` s of all sensors are missing."""
    rng = np.random.default_rng(1)
    t = np.arange(1, 12001) / 100
    speed = 10 + np.sin(t / 9)
    heading = 0.5 * np.sin(t / 15)
    p = np.cumsum(speed[:, None] * np.stack([np.sin(heading), np.cos(heading)], -1), axis=0) / 100
    way = np.cumsum(speed) / 100
    imu = Imu(t, np.full(len(t), 0.01), np.zeros((len(t), 3)), np.zeros((len(t), 3)))
    odo, gps = np.arange(9, len(t), 10), np.arange(99, len(t), 100)
    count = np.round(way[odo] / 0.02) * 0.02 if counter else way[odo]
    odometer = Odometer(t[odo], count, speed[odo], 0.02 if counter else 0.0)
    at = np.concatenate([p[gps] + rng.normal(0, 1.5, (len(gps), 2)), np.zeros((len(gps), 1))], 1)
    lat, lon, height = ORIGIN.geodetic(at)
    gnss = Gnss(t[gps], np.rad2deg(lat), np.rad2deg(lon), height, np.full((len(gps), 3), 1.5))
    run = Run(Path("run.csv"), 0.0, 120.0, imu, odometer, None, gnss if fixes else None, None, None)
    return paused(run, pause) if pause else run


def paused(run: Run, pause: float) -> Run:
    """The run without what all sensors said in a span."""
    return _each(run, lambda time: (time <= AT) | (time > AT + pause))


def _each(run, keep):  # type: ignore[no-untyped-def]
    changed = {}
    for name in ("imu", "odometer", "gnss"):
        if (sensor := getattr(run, name)) is not None:
            on = keep(sensor.time)
            parts = {k: v[on] for k, v in vars(sensor).items() if isinstance(v, np.ndarray)}
            changed[name] = replace(sensor, **parts)
    return replace(run, **changed)


def jumped(run: Run, jump: float) -> Run:
    """The run with a clock that jumps."""
    changed = {}
    for name in ("imu", "odometer", "gnss"):
        if (sensor := getattr(run, name)) is not None:
            time = np.where(sensor.time > AT, sensor.time + jump, sensor.time)
            changed[name] = replace(sensor, time=time)
    return replace(run, **changed, end=run.end + jump)


@pytest.mark.parametrize(("counter", "fixes"), [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("jump", [1.5, 20.0, 1000.0])
def test_a_jump_is_taken_back(counter: bool, fixes: bool, jump: float) -> None:
    run = drive(counter, fixes)
    mended = without_jumps(jumped(run, jump))
    assert run.imu is not None and mended.imu is not None and mended.odometer is not None
    np.testing.assert_allclose(mended.imu.time, run.imu.time, atol=1e-9)
    assert run.odometer is not None
    np.testing.assert_allclose(mended.odometer.time, run.odometer.time, atol=1e-9)
    assert mended.end == pytest.approx(run.end)
    assert len(mended.notes) == 1 and f"jumps by {jump:.3g} s" in mended.notes[0]


@pytest.mark.parametrize(("counter", "fixes"), [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("pause", [0.5, 1.5, 20.0])
def test_a_pause_stays_a_gap(counter: bool, fixes: bool, pause: float) -> None:
    run = drive(counter, fixes, pause)
    assert without_jumps(run) is run


def test_what_nothing_tells_stays_a_gap() -> None:
    run = jumped(drive(counter=False, fixes=False), 20.0)
    assert without_jumps(run) is run


@pytest.mark.parametrize("stall", [0.4, 2.0])
def test_a_stall_of_the_host_is_no_jump(stall: float) -> None:
    """All that was sampled meanwhile is stamped when the host goes on."""
    run, end = drive(counter=True, fixes=True), AT + stall
    changed = {}
    for name in ("imu", "odometer", "gnss"):
        sensor = getattr(run, name)
        late = (sensor.time > AT) & (sensor.time < end)
        waited = end + 1e-6 * (np.cumsum(late) - late.sum())
        changed[name] = replace(sensor, time=np.where(late, waited, sensor.time))
    stalled = replace(run, **changed)
    assert without_jumps(stalled) is stalled
