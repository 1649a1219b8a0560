"""Counters of any width, wrong counts and encoders that fail."""

import numpy as np
import pytest

from graphnav.common.run import Array, Imu, Odometer
from graphnav.inertial.encoder import failures, without
from graphnav.reading.counter import counted

PULSE = 0.02


def speed(t: Array) -> Array:
    """Rest, drive, rest, reverse."""
    cycle = np.interp(t % 120, [0, 10, 30, 80, 95, 120], [0, 0, 12, 11, 0, 0])
    return np.asarray(cycle * np.where(t // 120 % 3 == 2, -0.3, 1.0))


def counts(interval: float) -> tuple[Array, Array]:
    """Times and whole counts since the start."""
    t = np.arange(0, 600, interval)
    return t, np.floor(np.cumsum(speed(t)) * interval / PULSE)


@pytest.mark.parametrize("bits", [8, 12, 16, 24, 32])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("wrong", [0, 3])
def test_wraps_are_undone(bits: int, signed: bool, wrong: int) -> None:
    t, count = counts(0.1)
    width = 2.0**bits
    raw = (count + width / (1 + signed) - 1000) % width
    raw = np.where(signed & (raw >= width / 2), raw - width, raw)
    at = np.random.default_rng(bits).integers(100, len(t) - 100, wrong)
    raw[at] += width / 3 * np.where(raw[at] > 0, -1, 1)
    found = counted(t, raw, PULSE)
    way = np.interp(t, found.odometer.time, found.odometer.distance)
    np.testing.assert_allclose(np.delete(way - count * PULSE, at), 0, atol=0.1)
    assert any("wraps" in note for note in found.notes)


def test_a_reset_is_no_wrap_and_the_speed_goes_on() -> None:
    t, count = counts(0.1)
    raw = count.copy()
    raw[3000:] -= raw[3000]
    found = counted(t, raw, PULSE)
    assert any("reset" in note for note in found.notes) and len(found.notes) == 1
    np.testing.assert_allclose(found.odometer.distance, count * PULSE, atol=0.1)


def test_a_counter_that_only_counts_is_left_alone() -> None:
    t, count = counts(0.1)
    found = counted(t, count, PULSE)
    assert found.notes == ()
    np.testing.assert_allclose(found.odometer.distance, count * PULSE, atol=1e-9)


def vehicle(noise: float = 0.02) -> tuple[Odometer, Imu]:
    """An odometer's speeds and what the accelerometer feels of them."""
    t = np.arange(1, 60_001) * 0.01
    v = speed(t)
    rng = np.random.default_rng(1)
    accel = np.stack([0 * t, np.gradient(v, 0.01) + 0.3, 0 * t + 9.8], -1)
    accel += rng.normal(0, 0.05, accel.shape)
    at = slice(9, None, 10)
    read = v[at] + noise * rng.normal(size=len(v[at])) * (v[at] != 0)
    way = np.concatenate([[0.0], np.cumsum(0.05 * (read[1:] + read[:-1]))])
    return Odometer(t[at], way, read, 0.0), Imu(t, np.full(len(t), 0.01), 0 * accel, accel)


def remade(odometer: Odometer, read: Array) -> Odometer:
    way = np.concatenate([[0.0], np.cumsum(0.05 * (read[1:] + read[:-1]))])
    return Odometer(odometer.time, way, read, 0.0)


def test_a_sound_odometer_is_left_alone() -> None:
    assert failures(*vehicle()) == []


def test_wheels_that_stop_without_braking_are_dead() -> None:
    odometer, imu = vehicle()
    read = np.where((odometer.time > 160) & (odometer.time < 500), 0.0, odometer.speed)
    (found,) = failures(remade(odometer, read), imu)
    assert "died" in found.what
    at = odometer.time[found.mask]
    assert at[0] == pytest.approx(160.1, abs=0.3) and at[-1] == pytest.approx(500, abs=0.3)
    left = without(odometer, found.mask)
    assert left is not None and np.diff(left.time).max() > 339


@pytest.mark.parametrize("held", ["stuck", "jumping", "one"])
def test_stuck_and_jumping_speeds_are_dropped(held: str) -> None:
    odometer, imu = vehicle()
    read, on = odometer.speed.copy(), (odometer.time > 160) & (odometer.time < 190)
    if held == "stuck":
        read[on] = read[on][0]
    elif held == "jumping":
        read[on] = np.random.default_rng(2).uniform(-30, 60, on.sum())
    else:
        on = np.arange(len(read)) == 1700
        read[on] += 40.0
    mask = np.any([f.mask for f in failures(remade(odometer, read), imu)], axis=0)
    assert (mask & on).sum() > 0.95 * on.sum() - 2
    assert (mask & ~on).sum() < 20
