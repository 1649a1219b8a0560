"""Scenario `rover`: the linkage follows the ground, wheels roll as they must, sensors fit."""

import numpy as np
import pytest

from factors import rocker_bogie as rb
from factors import so3
from graphnav.simulation import rover, rover_ground
from graphnav.simulation.rover_sensors import GEAR_DT, Conditions, Motion

CLEAN = Conditions(
    duration=400.0, slip=0.0, slip_spread=0.0, side_slip=0.0, side_slip_spread=0.0, episodes=0
)
MOVING = 0.03  # m/s


@pytest.fixture(scope="module")
def clean() -> Motion:
    return rover.drive(np.random.default_rng(5), CLEAN)


@pytest.fixture(scope="module")
def simulated() -> rover.Simulated:
    return rover.simulate(5, Conditions(duration=900.0, gyro=True))


def test_all_wheels_touch_the_ground_and_the_linkage_flexes() -> None:
    rng = np.random.default_rng(1)
    surface = rover_ground.terrain(rng, 0.12)
    en, heading = rng.uniform(-50, 50, (200, 2)), rng.uniform(-np.pi, np.pi, 200)
    pose = rover_ground.settle(rover.LINKAGE, surface, en, heading)
    np.testing.assert_allclose(
        pose.wheels_n[..., 2], surface.value(pose.wheels_n[..., :2]), atol=1e-9
    )
    p_b = rb.wheel_positions(rover.LINKAGE, pose.joints)
    np.testing.assert_allclose(
        pose.wheels_n, pose.p_n[:, None] + so3.mv(pose.R_nb[:, None], p_b), atol=1e-12
    )
    np.testing.assert_allclose(pose.p_n[:, :2], en)
    assert pose.joints.rocker.std() > 0.02 and pose.joints.bogie.std() > 0.03
    assert abs(pose.R_nb[:, 2, 1]).max() < 0.5


def test_on_a_plane_the_linkage_stays_at_zero_and_the_body_tilts() -> None:
    slope = rover_ground.RandomField(
        np.array([[1e-4, 0.0]]), np.zeros(1), np.array([1e3])
    )  # 0.1 east
    heading = np.array([np.pi / 2, 0.0])  # up the slope, along it
    pose = rover_ground.settle(rover.LINKAGE, slope, np.zeros((2, 2)), heading)
    np.testing.assert_allclose(pose.joints.rocker, 0, atol=1e-6)
    np.testing.assert_allclose(pose.joints.bogie, 0, atol=1e-6)
    np.testing.assert_allclose(np.arcsin(pose.R_nb[0, 2, 1]), np.arctan(0.1), atol=1e-6)  # nose up
    roll = np.arctan2(-pose.R_nb[1, 2, 0], pose.R_nb[1, 2, 2])
    np.testing.assert_allclose(roll, -np.arctan(0.1), atol=1e-6)  # right side up: negative


def test_wheels_without_slip_carry_the_rover_along_its_true_path(clean: Motion) -> None:
    """Kinematics of the recorded joints and rates, integrated, against the true displacement."""
    rates = rb.Joints(
        np.zeros_like(clean.joints.steer),
        np.gradient(clean.joints.rocker, clean.time),
        np.gradient(clean.joints.bogie, clean.time, axis=0),
    )
    motion = rb.body_motion(rover.LINKAGE, clean.wheel, clean.joints, rates)
    v_n = so3.mv(clean.pose.R_nb, motion.v_b)
    foot = clean.pose.wheels_n.mean(axis=1)
    walked = np.cumsum(v_n[:-1] * GEAR_DT, axis=0)
    way = float(np.linalg.norm(np.diff(foot, axis=0), axis=1).sum())
    error = np.linalg.norm((foot[1:] - foot[0]) - walked, axis=1)
    assert way > 20 and error.max() < 0.01 * way
    turned = np.cumsum(motion.w_z[:-1] * GEAR_DT)
    R = clean.pose.R_nb
    yaw = np.cumsum(so3.log(so3.transpose(R[:-1]) @ R[1:])[:, 2])  # about the body's own axis
    assert np.degrees(np.abs(turned - yaw).max()) < 1.5 and np.ptp(yaw) > 1.0


def test_slip_makes_wheels_turn_faster_than_they_roll(clean: Motion) -> None:
    slippery = Conditions(**{**vars(CLEAN), "slip": 0.2})
    motion = rover.drive(np.random.default_rng(5), slippery)
    k = motion.slip_coefficient
    assert k.min() >= 0.8 and k.max() <= 1.0 and np.ptp(k) > 0.05
    speed, _ = rb.mean_motion(rover.LINKAGE, clean.wheel, clean.joints)
    faster, _ = rb.mean_motion(rover.LINKAGE, motion.wheel, clean.joints)
    on = speed[:, 1] > MOVING
    np.testing.assert_allclose(faster[on, 1] * k[on], speed[on, 1], rtol=0.02)


def test_layout_rates_and_speeds(simulated: rover.Simulated) -> None:
    run, truth = simulated.run, simulated.truth
    assert (np.diff(run["time"]) > 0).all()
    gear = run.dropna(subset=["wheel_1"])
    assert np.allclose(np.diff(gear["time"]), 0.1) and gear.filter(regex="steer|bogie").notna().all(
        axis=None
    )
    speed = np.hypot(truth["v_e"], truth["v_n"])
    assert 0.15 < speed.max() < 0.21
    assert set(truth["state"]) == {"stop", "moving"}
    level = run.dropna(subset=["accel_z"])[["accel_x", "accel_y", "accel_z"]].to_numpy()
    assert abs(np.linalg.norm(level.mean(axis=0)) - 9.8) < 0.1


def test_sun_is_seen_half_of_the_time_with_gaps(simulated: rover.Simulated) -> None:
    seen = simulated.run.dropna(subset=["heading_deg"])
    assert 0.48 < len(seen) / 900 < 0.52
    assert (np.diff(seen["time"]) > 20).any()
    true = np.interp(
        seen["time"],
        simulated.truth["time"],
        np.unwrap(simulated.truth["heading_deg"], period=360),
    )
    error = (seen["heading_deg"] - true + 180) % 360 - 180
    assert 0.2 < error.std() < 0.45 and abs(error.mean()) < 0.1


def test_gyro_turns_as_the_truth_does_and_is_absent_unless_fitted(
    simulated: rover.Simulated,
) -> None:
    rate = simulated.run.dropna(subset=["gyro_z"])
    turned = np.degrees(np.cumsum(rate["gyro_z"]) * 0.05)
    heading = np.unwrap(simulated.truth["heading_deg"], period=360)
    at = np.interp(simulated.truth["time"][1:], rate["time"], turned)
    assert np.corrcoef(at, -heading[1:])[0, 1] > 0.99
    bare = rover.simulate(5, Conditions(duration=120.0))
    assert not any(name.startswith("gyro") for name in bare.run)
    assert "gyro" not in bare.vehicle


def test_the_same_seed_gives_the_same_run() -> None:
    short = Conditions(duration=150.0)
    first, second = rover.simulate(3, short), rover.simulate(3, short)
    assert first.run.equals(second.run) and first.vehicle == second.vehicle
    assert not rover.simulate(4, short).run.equals(first.run)
