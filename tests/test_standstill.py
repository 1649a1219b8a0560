"""Where the vehicle stands, told from IMU and odometer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from factors.preintegration import Increments
from graphnav.common.run import Array, Gnss, Odometer, Run, SideSpeeds
from graphnav.inertial.carried_standstill import moved_along, moving_standstills
from graphnav.inertial.standstill import Standstill, believable, find_standstill, rocking
from graphnav.inertial.standstill_evidence import Mask, spans
from graphnav.inertial.standstill_rate import standstill_rate

STEP = 0.05
REST = (20.0, 30.0)


def increments(
    noise_at_standstill: float = 2e-3, noise_driving: float = 0.3, braking: float = 2.0
) -> Increments:
    """60 s; noise of force [m/s^2] and a tenth of it of rate [rad/s]; at rest from 20 to 30 s.

    Brakes from 16 s on and gathers way until 34 s, with `braking` m/s^2.
    """
    rng = np.random.default_rng(1)
    edge = np.arange(1201) * STEP
    at = edge[:-1]
    at_standstill = (at >= REST[0]) & (at < REST[1])
    noise = np.where(at_standstill, noise_at_standstill, noise_driving)[:, None]
    force = noise * rng.normal(size=(1200, 3)) + [0, 0, 9.8]
    force[:, 1] += braking * (((at >= 30) & (at < 34)) * 1.0 - ((at >= 16) & (at < 20)))
    rate = 0.1 * noise * rng.normal(size=(1200, 3)) + np.where(at_standstill, 0, 0.05)[:, None]
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


def standing_of(inc: Increments, odometer: Odometer | None) -> Mask:
    """Where a run of these sensors stands."""
    run = Run(Path("run.csv"), 0.0, float(inc.edge[-1]), None, odometer, None, None, None, None)
    return find_standstill(inc, run, None, 1e-3).at_standstill


def ends(mask: Mask) -> Array:
    return spans(mask, increments().edge)


@pytest.mark.parametrize("pulse", [0.0, 0.0108, 0.2])
def test_a_stop_is_found_to_within_a_second(pulse: float) -> None:
    found = ends(standing_of(increments(), odometer(pulse=pulse)))
    assert found.shape == (1, 2)
    np.testing.assert_allclose(found[0], REST, atol=1.0)
    # never outside: a moving vehicle must not be held
    assert found[0, 0] >= REST[0] - STEP
    assert found[0, 1] <= REST[1] + STEP


def test_a_stop_is_found_without_odometer() -> None:
    found = ends(standing_of(increments(), None))
    assert found.shape == (1, 2)
    np.testing.assert_allclose(found[0], REST, atol=1.0)


def test_a_shaking_vehicle_does_not_stand_whatever_the_odometer_says() -> None:
    """The odometer is silent from 20 to 35 s (a blocked wheel), the IMU quiet until 30 s."""
    found = ends(standing_of(increments(), odometer((20.0, 35.0))))
    assert found.shape == (1, 2)
    assert found[0, 1] <= REST[1] + STEP


def test_a_counting_odometer_is_no_stop_however_quiet() -> None:
    quiet = increments(noise_driving=2e-3)
    assert not standing_of(quiet, odometer((70.0, 71.0))).any()


def test_a_stop_of_half_a_second_is_none() -> None:
    assert not standing_of(increments(), odometer((20.0, 20.5))).any()


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
    standstills = np.array([[0.0, 8.0], [30.0, 40.0], [60.0, 70.0]])
    np.testing.assert_array_equal(believable(standstills, time, speed), standstills[[0, 2]])


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
    assert not standing_of(quiet, odometer(ramp=0.1)).any()
    assert standing_of(increments(noise_driving=2e-3), odometer()).any()


@pytest.mark.parametrize(("speed", "moves"), [(0.0, False), (8.0, True)])
def test_fixes_that_move_along_contradict_a_rest(speed: float, moves: bool) -> None:
    time = np.arange(0.0, 60.0)
    noise = 1.5 * np.random.default_rng(4).normal(size=(60, 2))
    north = (speed * time + noise[:, 0]) / 111_000
    gnss = Gnss(time, 45 + north, 10 + noise[:, 1] / 78_000, 0 * time, np.full((60, 3), 1.5))
    assert (len(moved_along(np.array([REST]), gnss)) > 0) == moves


def manoeuvre(turn: Array, push: Array, gear_stopped: Array, sides: bool = False) -> Standstill:
    """Where a vehicle stands that turns about z at `turn` [rad/s] and accelerates ahead and upwards
    by `push` (1200, 2) m/s^2, at 20 Hz; the odometer counts where it is not `gear_stopped`.
    """
    rng = np.random.default_rng(7)
    edge = np.arange(1201) * STEP
    shaking = np.where(gear_stopped, 2e-3, 0.3)[:, None]
    force = shaking * rng.normal(size=(1200, 3)) + [0, 0, 9.8]
    force[:, 1:] += push
    rate = 0.1 * shaking * rng.normal(size=(1200, 3)) + 1e-4
    rate[:, 2] += turn
    inc = Increments(edge, rate * STEP, force * STEP, force * STEP**2 / 2, np.zeros(1200))
    speed = np.where(gear_stopped, 0.0, 1.0)
    odo = Odometer(edge, np.append(0, np.cumsum(speed * STEP)), np.append(speed, 0), 0.0)
    both = None
    if sides:
        reach = 0.5 * np.append(turn, 0)
        both = SideSpeeds(edge, np.append(speed, 0) - reach, np.append(speed, 0) + reach)
    run = Run(Path("run.csv"), 0.0, 60.0, None, odo, both, None, None, None)
    return find_standstill(inc, run, None, 1e-3)


AT = np.arange(1200) * STEP
SILENT = (AT < 5) | (AT >= 20)
LEVEL = np.zeros((1200, 2))


@pytest.mark.parametrize("rate", [0.05, 0.3, 1.5])
@pytest.mark.parametrize("sides", [False, True])
def test_a_steady_turn_on_the_spot_is_no_rest(rate: float, sides: bool) -> None:
    turning = (AT >= 25) & (AT < 55)
    found = manoeuvre(np.where(turning, rate, 0.0), LEVEL, SILENT, sides)
    assert not found.at_standstill[(AT >= 25.5) & (AT < 54.5)].any()
    assert found.at_standstill[(AT > 1) & (AT < 4)].all()
    assert found.at_standstill[AT > 57].all()


def test_a_bias_far_beyond_its_sigma_is_no_turn() -> None:
    """0.017 rad/s (1 deg/s) at every rest and while driving, 17 sigma."""
    found = manoeuvre(np.full(1200, 0.017), LEVEL, SILENT)
    assert found.at_standstill[(AT > 22) & (AT < 59)].all()


def test_turns_alone_are_no_rest() -> None:
    """Quiet only while turning: what is seen while driving contradicts the bias it would be."""
    assert standstill_rate(np.full((50, 3), 0.3), np.zeros((50, 3)), 1e-4, 1e-3) is None
    assert standstill_rate(np.full((50, 3), 0.3), np.zeros((0, 3)), 1e-4, 1e-3) is not None


@pytest.mark.parametrize(("column", "speed"), [(0, 0.3), (1, 0.5)])
def test_what_moves_between_two_rests_is_carried(column: int, speed: float) -> None:
    """A crawl below the wheel sensor's threshold; a lift."""
    push = LEVEL.copy()
    push[(AT >= 30) & (AT < 31), column] = speed
    push[(AT >= 45) & (AT < 46), column] = -speed
    found = manoeuvre(np.zeros(1200), push, SILENT)
    riding = (AT >= 32) & (AT < 44)
    assert found.carried[riding, column].all()
    assert not found.carried[riding, 1 - column].any()
    assert not found.carried[(AT > 47) | (AT < 29)].any()


def test_a_fix_set_aside_at_once_moves_nobody() -> None:
    time = np.arange(0.0, 60.0)
    aside = np.where((time > 22) & (time < 27), 30.0, 0.0) + np.where(time > 40, 20.0, 0.0)
    gnss = Gnss(time, 45 + aside / 111_000, 10 + 0 * time, 0 * time, np.full((60, 3), 1.5))
    assert not len(moved_along(np.array([[10.0, 58.0]]), gnss))
    gnss = replace(gnss, lat_deg=45 + 0.5 * time / 111_000)
    assert len(moved_along(np.array([[0.0, 58.0]]), gnss))


def test_moving_rests_needs_two_rests_of_a_silence() -> None:
    assert moving_standstills(increments(), np.array([[20.0, 30.0]]), np.array([REST])).shape == (
        0,
        4,
    )
