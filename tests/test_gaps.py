"""Missing samples: bridged from both sides, doubted as the motion around them changes."""

import numpy as np
import pytest

from graphnav.common.run import Array, Imu
from graphnav.inertial.gaps import BEGINS_S, bridged
from graphnav.inertial.sample_clock import sample_clock

STEP = 0.01


def driven(seconds: float, seed: int) -> Imu:
    """Turns of seconds and vibration of 9 Hz, with noise."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(1, round(seconds / STEP) + 1)
    slow = np.stack([np.sin(2 * np.pi * t / p + rng.uniform(0, 6)) for p in (7.0, 11.0, 5.0)], -1)
    shake = np.stack([np.sin(2 * np.pi * 9 * t + q) for q in rng.uniform(0, 6, 3)], -1)
    gyro = 0.2 * slow + 0.05 * shake + rng.normal(0, 1e-4, (len(t), 3))
    accel = slow + 0.5 * shake + rng.normal(0, 1e-3, (len(t), 3)) + [0, 0, 9.8]
    return Imu(t, np.full(len(t), STEP), gyro, accel)


def without(imu: Imu, lost: Array) -> Imu:
    """The samples that are left, bridged."""
    keep = np.setdiff1d(np.arange(len(imu.time)), lost)
    cut = Imu(imu.time[keep], imu.dt[keep], imu.gyro[keep], imu.accel[keep])
    return bridged(cut, sample_clock(cut.time), np.ones((len(keep), 2), bool))


@pytest.mark.parametrize("length", [1, 2, 4, 8, 30, 100, 500])
def test_the_doubt_is_what_the_bridge_misses(length: int) -> None:
    """Over many gaps, error over its sigma is near one; never held, never certain."""
    ratio = []
    for seed in range(3):
        imu = driven(120.0, seed)
        for start in range(2500, 10_000, 3000):
            lost = np.arange(start, start + length)
            found = without(imu, lost)
            assert found.doubt is not None
            np.testing.assert_allclose(found.time, imu.time, atol=1e-9)
            for k, (a, b) in enumerate(((found.gyro, imu.gyro), (found.accel, imu.accel))):
                error = (a - b)[lost].sum(axis=0) * STEP
                sigma = np.sqrt((found.doubt[lost, k] ** 2).sum())
                assert sigma > 0
                ratio.append(np.abs(error).max() / sigma)
    rms = float(np.sqrt(np.mean(np.square(ratio))))
    assert rms < 2
    assert rms > 0.3 or length * STEP > BEGINS_S  # a manoeuvre may begin and end in a long one
    assert max(ratio) < 6


def test_vibration_goes_on_over_a_lost_sample() -> None:
    """Half the change to the neighbours would miss 0.02 rad/s of a 9 Hz shake."""
    imu = driven(60.0, 4)
    lost = np.arange(1000, 5000, 37)
    found = without(imu, lost)
    assert np.abs(found.gyro - imu.gyro)[lost].max() < 1e-3


def test_deep_in_a_long_gap_nothing_of_the_bend_is_left() -> None:
    imu = driven(300.0, 2)
    found = without(imu, np.arange(12_000, 18_000))
    middle = found.gyro[14_500:15_500]
    assert np.abs(middle - np.median(imu.gyro, axis=0)).max() < 0.02
    assert found.doubt is not None
    turned = np.sqrt((found.doubt[:, 0] ** 2).sum())
    missed = np.abs((found.gyro - imu.gyro).sum(axis=0)).max() * STEP
    assert missed < 3 * turned


def test_one_sensor_may_be_blind() -> None:
    imu = driven(30.0, 3)
    seen = np.ones((len(imu.time), 2), bool)
    seen[700:720, 0] = False
    found = bridged(imu, sample_clock(imu.time), seen)
    assert found.doubt is not None
    assert (found.doubt[700:720, 0] > 0).all() and not found.doubt[:, 1].any()
    np.testing.assert_array_equal(found.accel, imu.accel)
    np.testing.assert_array_equal(found.gyro[:700], imu.gyro[:700])


def test_nothing_missing_nothing_changed() -> None:
    imu = driven(10.0, 1)
    found = bridged(imu, sample_clock(imu.time), np.ones((len(imu.time), 2), bool))
    assert found.gyro is imu.gyro and found.doubt is None
