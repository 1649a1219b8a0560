"""Where the vehicle stands, told from IMU and odometer."""

import numpy as np
import pytest

from factors.preintegration import Increments
from graphnav.common.run import Array, Gnss, Odometer
from graphnav.inertial.standstill import Mask, believable, rocking, spans, standing, unmoved

STEP = 0.05
REST = (20.0, 30.0)


def increments(
    noise_at_rest: float = 2e-3, noise_driving: float = 0.3, braking: float = 2.0
) -> Increments:
    """60 s; noise of force [m/s^2] and a tenth of it of rate [rad/s]; at rest from 20 to 30 s.

    Brakes from 16 s on and gathers way until 34 s, with `braking` m/s^2.
    """
    rng = np.random.default_rng(1)
    edge = np.arange(1201) * STEP
    at = edge[:-1]
    at_rest = (at >= REST[0]) & (at < REST[1])
    noise = np.where(at_rest, noise_at_rest, noise_driving)[:, None]
    force = noise * rng.normal(size=(1200, 3)) + [0, 0, 9.8]
    force[:, 1] += braking * (((at >= 30) & (at < 34)) * 1.0 - ((at >= 16) & (at < 20)))
    rate = 0.1 * noise * rng.normal(size=(1200, 3)) + np.where(at_rest, 0, 0.05)[:, None]
    velocity = force * STEP
    return Increments(edge, rate * STEP, velocity, velocity * STEP / 2, np.zeros(1200))


def odometer(rest: tuple[float, float] = REST, pulse: float = 0.0, ramp: float = 4.0) -> Odometer:
    """10 Hz; zero during `rest`, 8 m/s before and after, `ramp` s between."""
    time = np.arange(0, 60.05, 0.1)
    value = np.interp(time, [rest[0] - ramp, *rest, rest[1] + ramp], [8.0, 0.0, 0.0, 8.0])
    distance = np.concatenate([[0.0], np.cumsum(0.05 * (value[1:] + value[:-1]))])
    if pulse:
        distance = np.floor(distance / pulse) * pulse
    return Odometer(time, distance, value, pulse)


def ends(mask: Mask) -> Array:
    return spans(mask, increments().edge)


@pytest.mark.parametrize("pulse", [0.0, 0.0108, 0.2])
def test_a_stop_is_found_to_within_a_second(pulse: float) -> None:
    found = ends(standing(increments(), odometer(pulse=pulse)))
    assert found.shape == (1, 2)
    np.testing.assert_allclose(found[0], REST, atol=1.0)
    # never outside: a moving vehicle must not be held
    assert found[0, 0] >= REST[0] - STEP
    assert found[0, 1] <= REST[1] + STEP


def test_a_stop_is_found_without_odometer() -> None:
    found = ends(standing(increments(), None))
    assert found.shape == (1, 2)
    np.testing.assert_allclose(found[0], REST, atol=1.0)


def test_a_shaking_vehicle_does_not_stand_whatever_the_odometer_says() -> None:
    """The odometer is silent from 20 to 35 s (a blocked wheel), the IMU quiet until 30 s."""
    found = ends(standing(increments(), odometer((20.0, 35.0))))
    assert found.shape == (1, 2)
    assert found[0, 1] <= REST[1] + STEP


def test_a_counting_odometer_is_no_stop_however_quiet() -> None:
    quiet = increments(noise_driving=2e-3)
    assert not standing(quiet, odometer((70.0, 71.0))).any()


def test_a_stop_of_half_a_second_is_none() -> None:
    assert not standing(increments(), odometer((20.0, 20.5))).any()


def test_spans_of_a_mask() -> None:
    edge = np.arange(7.0)
    mask = np.array([True, True, False, False, True, False])
    np.testing.assert_array_equal(spans(mask, edge), [[0, 2], [4, 5]])
    assert spans(np.zeros(6, bool), edge).shape == (0, 2)
    np.testing.assert_array_equal(spans(np.ones(6, bool), edge), [[0, 6]])


def test_a_smooth_ride_is_no_rest_without_odometer() -> None:
    """The first rest is believed, a later one only where the reckoned speed may be zero."""
    time = np.arange(0.0, 121.0)
    speed = np.where((time > 10) & (time < 50), 15.0, 0.0)
    rests = np.array([[0.0, 8.0], [30.0, 40.0], [60.0, 70.0]])
    np.testing.assert_array_equal(believable(rests, time, speed), rests[[0, 2]])


def test_a_rest_without_a_standing_start_is_not_believed() -> None:
    time = np.arange(0.0, 100.0)
    assert believable(np.array([[30.0, 40.0]]), time, 0 * time).shape == (0, 2)


def test_rocking_is_the_angle_without_its_trend() -> None:
    """0.2 mrad at 1 Hz about x on a bias of 1 mrad/s about every axis."""
    edge = np.arange(601) * STEP
    angle = np.outer(edge, [1e-3, 1e-3, 1e-3])
    angle[:, 0] += 2e-4 * np.sqrt(2) * np.sin(2 * np.pi * edge)
    inc = Increments(edge, np.diff(angle, axis=0), np.zeros((600, 3)), np.zeros((600, 3)), edge[1:])
    found = rocking(inc, np.array([[0.0, 30.0]]), 0.0)
    np.testing.assert_allclose(found, [2e-4, 0, 0], atol=2e-6)
    np.testing.assert_array_equal(rocking(inc, np.zeros((0, 2)), 0.0), 0)


def test_a_locked_wheel_is_no_stop() -> None:
    """The odometer falls from 8 m/s to nothing, the IMU, quiet as at rest, feels no braking."""
    quiet = increments(noise_driving=2e-3, braking=0.0)
    assert not standing(quiet, odometer(ramp=0.1)).any()
    assert standing(increments(noise_driving=2e-3), odometer()).any()


@pytest.mark.parametrize(("speed", "kept"), [(0.0, 1), (8.0, 0)])
def test_fixes_that_move_along_contradict_a_rest(speed: float, kept: int) -> None:
    time = np.arange(0.0, 60.0)
    noise = 1.5 * np.random.default_rng(4).normal(size=(60, 2))
    north = (speed * time + noise[:, 0]) / 111_000
    gnss = Gnss(time, 45 + north, 10 + noise[:, 1] / 78_000, 0 * time, np.full((60, 3), 1.5))
    assert len(unmoved(np.array([REST]), gnss)) == kept
