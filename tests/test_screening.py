"""Samples that are no measurement, and those that only look odd."""

from dataclasses import replace

import numpy as np
import pytest
from runs import shared

from graphnav.common.run import Array, Imu
from graphnav.inertial.screening import screened

RATES = [10, 100, 1000]


def driven(rate: int, noise: float, seed: int, seconds: float = 60.0) -> Imu:
    """Turns, grades of noise, and a rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, round(seconds * rate) + 1) / rate
    moves = np.clip((t - 10) / 2, 0, 1)
    slow = np.stack([np.sin(2 * np.pi * t / p + rng.uniform(0, 6)) for p in (7.0, 11.0, 5.0)], -1)
    shake = rng.normal(0, noise, (2, len(t), 3)) * (0.1 + moves[:, None])
    gyro = 0.2 * slow * moves[:, None] + 0.1 * shake[0]
    accel = slow * moves[:, None] + shake[1] + [0, 0, 9.8]
    return Imu(t, np.full(len(t), 1 / rate), gyro, accel)


def touched(imu: Imu, at_standstill: Array | None = None) -> dict[tuple[int, str], list[int]]:
    """Samples by sensor and fault."""
    at_standstill = np.zeros(len(imu.time), bool) if at_standstill is None else at_standstill > 0
    found = screened(imu, float(imu.dt[0]), at_standstill)
    return {(f.sensor, f.what): np.flatnonzero(f.mask).tolist() for f in found}


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", [1e-4, 0.02, 2.0])
def test_clean_samples_are_left_alone(rate: int, noise: float) -> None:
    assert touched(driven(rate, noise, rate)) == {}


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", [1e-3, 0.1])
def test_a_spike_is_found_on_any_axis(rate: int, noise: float) -> None:
    for axis in range(6):
        for size in (20.0, 100.0):
            imu = driven(rate, noise, 7)
            k = 40 * rate + axis
            values = (imu.gyro, imu.accel)[axis // 3]
            slope = float(np.abs(np.diff(values[:, axis % 3])).max())
            values[k, axis % 3] += size * max(slope, noise)
            assert (axis // 3, "a spike") in (found := touched(imu)), (axis, size)
            assert found[axis // 3, "a spike"] == [k]


def test_a_jolt_of_the_vehicle_is_no_spike() -> None:
    """The wheels lock: one sample of 200 m/s^2, another level and another roughness after it."""
    imu = driven(100, 0.05, 3)
    imu.accel[3000, 1] -= 200.0
    imu.accel[3001:, :] += np.random.default_rng(0).normal(0, 0.5, (len(imu.time) - 3001, 3))
    imu.accel[3001:, 1] += 1.5
    assert touched(imu) == {}


def test_absurd_numbers_are_no_samples() -> None:
    imu = driven(100, 0.05, 3)
    imu.gyro[1234, 1], imu.accel[2345] = 1e300, -np.inf
    assert touched(imu) == {(0, "out of any range"): [1234], (1, "out of any range"): [2345]}


def test_another_unit_is_no_fault_of_samples() -> None:
    imu = driven(100, 0.05, 3)
    assert (0, "out of any range") not in touched(Imu(imu.time, imu.dt, imu.gyro * 1e4, imu.accel))


@pytest.mark.parametrize("value", ["held", "zero"])
@pytest.mark.parametrize("axis", [0, 2, slice(None)])
def test_a_stuck_sensor_is_found(value: str, axis: int | slice) -> None:
    imu = driven(100, 0.05, 5)
    imu.gyro[3000:4000, axis] = imu.gyro[3000, axis] if value == "held" else 0.0
    found = touched(imu)[0, "stuck"]
    assert set(range(3001, 4000)) <= set(found) <= set(range(3000, 4000))


def test_coarse_samples_at_rest_are_not_stuck() -> None:
    imu = driven(100, 0.02, 6)
    coarse = Imu(imu.time, imu.dt, np.round(imu.gyro, 2), np.round(imu.accel, 1))
    assert touched(coarse, (imu.time < 10).astype(float)) == {}


def test_an_axis_that_was_not_recorded_is_not_stuck() -> None:
    imu = driven(100, 0.05, 5)
    imu.gyro[:, :2] = 0.0
    assert touched(imu) == {}


def test_clipped_samples_are_found() -> None:
    imu = driven(100, 0.3, 5)
    high = imu.accel[:, 1] > 1.4
    imu.accel[high, 1] = 1.4
    assert touched(imu)[1, "clipped"] == np.flatnonzero(high).tolist()


@pytest.mark.parametrize("name", ["sim_tracked", "sim_rlg", "sim_mimu", "kingston2008", "husky"])
def test_recorded_and_simulated_runs_are_left_alone(name: str) -> None:
    """Fewer than one sample in a million of clean runs, jolts of locking wheels among them."""
    from graphnav.inertial.measured import measured
    from graphnav.reading.read import read_run
    from graphnav.reading.vehicle_file import load_vehicle

    path = shared(name)
    run = read_run(path, load_vehicle(None, path))
    assert measured(run) is run


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("where", [0, -1])
def test_at_the_ends_a_last_jolt_is_no_spike(rate: int, where: int) -> None:
    """The run ends in a half sample; what no jolt of the run comes to is a spike even there."""
    imu = driven(rate, 1e-4, 2)
    imu.gyro[where] /= 2
    imu.accel[where, :2] /= 2
    assert touched(imu) == {}
    imu.accel[where, 1] += 900.0
    assert touched(imu) == {(1, "a spike"): [range(len(imu.time))[where]]}


@pytest.mark.parametrize("rate", RATES)
def test_samples_filled_with_the_one_before_are_found(rate: int) -> None:
    imu = driven(rate, 1e-3, 4)
    at = np.sort(np.random.default_rng(1).choice(np.arange(50, len(imu.time), 7), 8, False))
    imu.gyro[at], imu.accel[at] = imu.gyro[at - 1], imu.accel[at - 1]
    what = "a repeat of the sample before"
    assert touched(imu) == {(0, what): at.tolist(), (1, what): at.tolist()}


def test_a_sensor_polled_faster_than_it_measures_is_left_alone() -> None:
    imu = driven(100, 1e-3, 4)
    measured = np.floor(np.arange(len(imu.time)) * 0.93).astype(int)
    assert touched(replace(imu, gyro=imu.gyro[measured], accel=imu.accel[measured])) == {}


def test_coarse_samples_repeat_by_chance() -> None:
    imu = driven(100, 0.02, 4)
    coarse = replace(imu, gyro=np.round(imu.gyro, 2), accel=np.round(imu.accel, 1))
    assert not any(what.startswith("a repeat") for _, what in touched(coarse))


LINE = "a straight line from one sample to another"


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("by_stamp", [False, True])
def test_stretches_filled_by_interpolation_are_found(rate: int, by_stamp: bool) -> None:
    """As a converter closes the gaps of a log (KITTI 2011_10_03_0027 as gtsam ships it)."""
    imu = driven(rate, 1e-3, 4)
    rng = np.random.default_rng(rate)
    stamp = imu.time + rng.uniform(0, 0.3 / rate, len(imu.time))
    gone = np.zeros(len(stamp), bool)
    for a, b in ((15.0, 16.6), (30.0, 30.4), (40.0, 40.0 + 1 / rate)):
        gone |= (imu.time >= a) & (imu.time < b - 1e-9)
    scale = stamp if by_stamp else np.arange(len(stamp))
    for values in (imu.gyro, imu.accel):
        for k in range(3):
            values[gone, k] = np.interp(scale[gone], scale[~gone], values[~gone, k])
    found = touched(replace(imu, time=stamp))
    assert found == {(s, LINE): np.flatnonzero(gone).tolist() for s in (0, 1)}


def test_data_interpolated_throughout_are_left_alone() -> None:
    slow, t = driven(50, 1e-3, 4), np.arange(2, 6000) / 100
    up = [np.stack([np.interp(t, slow.time, x) for x in v.T], -1) for v in (slow.gyro, slow.accel)]
    assert touched(Imu(t, np.full(len(t), 0.01), up[0], up[1])) == {}


@pytest.mark.parametrize("digits", [1, 2, 3])
def test_coarse_samples_run_straight_by_chance(digits: int) -> None:
    imu = driven(100, 0.02, 4)
    coarse = replace(imu, gyro=np.round(imu.gyro, digits), accel=np.round(imu.accel, digits))
    assert not any(what == LINE for _, what in touched(coarse))
