"""Axes exchanged in mid-run."""

from dataclasses import replace

import numpy as np
import pytest

from graphnav.common.run import Imu, Odometer
from graphnav.inertial.exchanged_axes import ORDERS, exchanges, put_back

RATE, CHANGE = 50, 140.0


def drive(seed: int, spins: bool = False, seconds: float = 300.0) -> tuple[Imu, Odometer]:
    """Bends at 8 m/s, or turns on the spot; felt with noise and bumps."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, round(seconds * RATE) + 1) / RATE
    turn = 0.15 * np.sin(2 * np.pi * t / 25.0) * (1 if not spins else 3)
    speed = np.zeros(len(t)) if spins else 8.0 + 2.0 * np.sin(2 * np.pi * t / 40.0)
    gained = np.gradient(speed, t)
    gyro = rng.normal(0, 0.01, (len(t), 3)) + np.outer(turn, [0, 0, 1])
    accel = rng.normal(0, 0.5, (len(t), 3)) + np.stack([-speed * turn, gained, 9.8 + 0 * t], -1)
    distance = np.cumsum(speed) / RATE
    return Imu(t, np.full(len(t), 1 / RATE), gyro, accel), Odometer(t, distance, speed, 0.0)


def seen(imu: Imu) -> np.ndarray:
    return np.ones((len(imu.time), 2), bool)


@pytest.mark.parametrize("spins", [False, True])
def test_axes_that_stand_are_left_alone(spins: bool) -> None:
    for seed in range(3):
        imu, odometer = drive(seed, spins)
        assert exchanges(imu, odometer, seen(imu)) == []


@pytest.mark.parametrize("bias_deg_s", [-4.0, 4.0])
def test_a_bias_of_the_gyro_is_no_exchange(bias_deg_s: float) -> None:
    """Straight on it reads like a steady turn, and slow braking like what would push to the side
    in it, were sideways and forward exchanged.
    """
    t = np.arange(1, 300 * RATE + 1) / RATE
    speed = np.interp(t, [0, 60, 120, 240, 300], [0, 25, 25, 8, 25])
    rng = np.random.default_rng(1)
    gained = np.gradient(speed, t)
    accel = rng.normal(0, 0.3, (len(t), 3)) + np.stack([0 * t, gained, 9.8 + 0 * t], -1)
    gyro = rng.normal(0, 0.01, (len(t), 3)) + np.deg2rad(bias_deg_s)
    imu = Imu(t, np.full(len(t), 1 / RATE), gyro, accel)
    odometer = Odometer(t, np.cumsum(speed) / RATE, speed, 0.0)
    assert exchanges(imu, odometer, seen(imu)) == []


@pytest.mark.parametrize(
    ("sensor", "axes"), [(0, "x and z"), (0, "y and z"), (1, "x and z"), (1, "y and z")]
)
@pytest.mark.parametrize("spins", [False, True])
@pytest.mark.parametrize("until", [200.0, 1e9])
def test_exchanged_axes_are_found_and_put_back(
    sensor: int, axes: str, spins: bool, until: float
) -> None:
    imu, odometer = drive(5, spins)
    values = [imu.gyro.copy(), imu.accel.copy()]
    wrong = (imu.time > CHANGE) & (imu.time <= until)
    values[sensor][wrong] = values[sensor][wrong][:, ORDERS[axes]]
    spoilt = replace(imu, gyro=values[0], accel=values[1])
    (found,) = exchanges(spoilt, odometer, seen(imu))
    assert (found.sensor, found.axes) == (sensor, axes)
    assert not (found.mask & ~wrong).any()
    assert (found.mask | found.open)[wrong].all()
    assert found.open.sum() < 60 * RATE
    mended = put_back(spoilt, found)
    for one, other in ((mended.gyro, imu.gyro), (mended.accel, imu.accel)):
        np.testing.assert_array_equal(one[~found.open], other[~found.open])


def test_forward_and_sideways_exchanged() -> None:
    imu, odometer = drive(6)
    accel = imu.accel.copy()
    wrong = imu.time > CHANGE
    accel[wrong] = accel[wrong][:, [1, 0, 2]]
    (found,) = exchanges(replace(imu, accel=accel), odometer, seen(imu))
    assert (found.sensor, found.axes) == (1, "x and y")


def test_a_vehicle_that_falls_over_has_its_axes() -> None:
    """Gravity goes to the side, and the gyro felt the fall."""
    imu, odometer = drive(7, spins=True)
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    falls = (imu.time > CHANGE) & (imu.time <= CHANGE + 1)
    gyro[falls, 1] += np.pi / 2
    after = imu.time > CHANGE + 1
    accel[after] = accel[after][:, [2, 1, 0]] * [-1, 1, 1]
    gyro[after] = gyro[after][:, [2, 1, 0]] * [-1, 1, 1]
    assert exchanges(replace(imu, gyro=gyro, accel=accel), odometer, seen(imu)) == []
