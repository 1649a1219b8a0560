"""The sampling clock behind late, rounded, bursty and missing stamps."""

import numpy as np
import pytest

from graphnav.common.run import Array
from graphnav.inertial.sample_clock import sample_clock

Numbers = np.ndarray[tuple[int], np.dtype[np.int64]]


def late(number: Numbers, step: float, seed: int) -> Array:
    """Stamps late by up to milliseconds, in order."""
    noise = np.abs(np.random.default_rng(seed).normal(size=len(number))) * 1e-3
    return np.maximum.accumulate(number * step + noise) + 1e-8 * np.arange(len(number))


def burst(number: Numbers, step: float) -> Array:
    """Five samples stamped together, when the last of them has come."""
    return -(-number // 5) * 5 * step + (number % 5 - 5) % 5 * 1e-5


@pytest.mark.parametrize("rate", [10, 100, 1000])
@pytest.mark.parametrize("seed", [1, 2])
def test_late_stamps_hide_an_even_clock(rate: int, seed: int) -> None:
    number = np.arange(1, 120 * rate)
    clock = sample_clock(late(number, 1 / rate, seed))
    wrong = np.diff(clock.time) * rate - 1
    assert clock.even and abs(clock.step * rate - 1) < 1e-4
    assert (clock.steps - 1).sum() <= 2  # the last samples may be late for all anyone knows
    assert np.abs(wrong[: -2 * rate]).max() < 1e-3


@pytest.mark.parametrize("rate", [10, 100, 500])
@pytest.mark.parametrize("stamps", ["exact", "late", "burst"])
def test_lost_samples_are_whole_steps(rate: int, stamps: str) -> None:
    number = np.arange(1, 200 * rate)
    number = number[np.random.default_rng(rate).random(len(number)) > 0.01]
    step = 1 / rate
    stamped = {"exact": number * step, "late": late(number, step, 5), "burst": burst(number, step)}
    clock = sample_clock(stamped[stamps])
    found = int(clock.steps.sum() - 1)
    assert clock.even
    assert abs(found - int(number[-1] - number[0])) <= 2
    if stamps == "exact":
        np.testing.assert_array_equal(np.cumsum(clock.steps) - 1, number - number[0])


def test_rounded_stamps_that_repeat() -> None:
    number = np.arange(1, 30_000)
    clock = sample_clock(np.round(number / 128, 2))
    assert clock.even and abs(clock.step * 128 - 1) < 1e-5
    assert (clock.steps - 1).sum() <= 2


@pytest.mark.parametrize("spread", [0.05, 0.3])
@pytest.mark.parametrize("rate", [10, 100, 1000])
def test_uneven_samples_stay_as_they_are(rate: int, spread: float) -> None:
    rng = np.random.default_rng(rate)
    stamp = np.cumsum(rng.uniform(1 - spread, 1 + spread, 200 * rate)) / rate
    clock = sample_clock(stamp)
    assert not clock.even
    np.testing.assert_array_equal(clock.time, stamp)
    assert (clock.steps == 1).all()


def test_even_stamps_are_not_touched() -> None:
    stamp = np.arange(5000) * 0.01 * (1 + 3e-5)
    clock = sample_clock(stamp)
    np.testing.assert_array_equal(clock.time, stamp)
    assert clock.even and not clock.late.any()


def test_a_drifting_stamp_clock_is_followed() -> None:
    number = np.arange(60_000)
    drift = 1e-2 * np.sin(number / 60_000 * np.pi)
    rng = np.random.default_rng(3)
    clock = sample_clock(number * 0.01 + drift + rng.uniform(0, 1e-3, len(number)))
    wrong = clock.time - number * 0.01 - drift
    assert clock.even
    assert np.ptp(wrong) < 3e-4
