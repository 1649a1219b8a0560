"""Field scenarios: every effect is there, can be left out, and is told with its true amount."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from graphnav.simulation import DRIVES, Options, imu, simulate
from graphnav.simulation.drive import Driven
from graphnav.simulation.field import EFFECTS
from graphnav.simulation.grades import DEG_SQRT_H, GRADES, IMPERFECTIONS
from graphnav.simulation.stamps import jittered, kept

CAR, SKID = "field-wheeled", "field-skid"


@pytest.fixture(scope="module")
def car() -> Driven:
    return DRIVES[CAR](Options(3, duration=200.0))


@pytest.fixture(scope="module")
def skid() -> Driven:
    return DRIVES[SKID](Options(3, duration=300.0))


def across(driven: Driven) -> np.ndarray:
    """Velocity (N + 1, 2) m/s of the vehicle point across m's forward axis, from the truth."""
    from scipy.spatial.transform import Rotation

    truth, setup = driven.truth, driven.setup
    v_b = np.einsum("nji,nj->ni", truth.R_nb, truth.v_n)[1:]
    v_b += np.cross(truth.gyro_end, setup.lever)
    return Rotation.from_rotvec(setup.mount_deg, degrees=True).inv().apply(v_b)[:, [0, 2]]


def test_bumps_break_the_constraint_and_can_be_left_out(car: Driven) -> None:
    flat = DRIVES[CAR](Options(3, duration=200.0, without=("bumps", "hills")))
    tyres = 0.005 * car.commands.speed * car.commands.yaw_rate
    sideways = across(car)[:, 0] - tyres[4::4]
    assert np.abs(across(car)[:, 1]).max() > 0.1 and np.abs(sideways).max() > 0.008
    assert np.abs(across(flat)[:, 1]).max() < 0.01
    assert np.abs(across(flat)[:, 0] - tyres[4::4]).max() < 0.01
    assert np.abs(car.truth.accel).max() < 30  # and yet nothing that breaks an axle


def test_a_skid_steered_robot_turns_on_the_spot_on_a_wider_track(skid: Driven) -> None:
    width = skid.constants["track_width_m"][2][0]
    speed, rate = skid.commands.speed, skid.commands.yaw_rate
    assert width > 1.3 * 1.08
    pivot = (np.abs(rate) > 0.2) & (speed == 0)
    left, right = skid.odometer_speed[pivot].T
    assert pivot.sum() > 1000 and np.all(left * right < 0)
    clean = DRIVES[SKID](Options(3, duration=300.0, without=("slip",)))
    sides = clean.odometer_speed * clean.constants["side_scale"][2]
    np.testing.assert_allclose(np.diff(sides, axis=1)[:, 0], width * rate, atol=1e-12)
    np.testing.assert_allclose(sides.mean(1), speed, atol=1e-12)


def test_the_sides_slip_unlike_each_other_and_not_at_rest(skid: Driven) -> None:
    clean = DRIVES[SKID](Options(3, duration=300.0, without=("slip",))).odometer_speed
    moving = np.abs(clean).min(1) > 0.3
    slip = 1 - clean[moving] / skid.odometer_speed[moving]
    assert np.all(slip.std(0) > 0.015)
    assert np.diff(slip, axis=1).std() > 0.02
    assert np.all(skid.odometer_speed[(clean == 0).all(1)] == 0)


def test_vibration_grows_with_speed_and_aliases_when_sampled(car: Driven) -> None:
    from graphnav.simulation.vibration import vibration

    speed = np.abs(car.commands.speed)[4::4]
    accel = vibration(car, Options(3))[1]
    sd = [accel[(speed > a) & (speed <= b)].std() for a, b in ((0.5, 5), (5, 9), (9, 17))]
    assert np.all(np.diff(sd) > 0) and 0.1 < sd[-1] < 1.5
    assert accel[speed == 0].std() < 0.05
    doubled = vibration(car, Options(3, vibration=2.0))[1]
    np.testing.assert_allclose(doubled, 2 * accel)
    # where means take in what an instant misses, less of it is left after 1 s
    far = [np.abs(x.reshape(-1, 100, 3).mean(1)).mean() for x in (
        vibration(car, Options(3))[1], vibration(car, Options(3, sampled=True))[1],
    )]  # fmt: skip
    assert far[1] > 1.2 * far[0]


@pytest.mark.parametrize("rate_hz", [10, 30, 104, 250, 1000])
def test_any_rate_keeps_the_drive_and_the_other_sensors(tmp_path: Path, rate_hz: int) -> None:
    chosen = {"duration": 40.0, "rate_hz": rate_hz, "gnss": True}
    out = simulate(SKID, tmp_path / "run", 4, without=("jitter", "losses"), **chosen)
    run, truth = pd.read_csv(out / "run.csv.gz"), pd.read_csv(out / "truth.csv.gz")
    assert len(run) == 40 * rate_hz
    sides = run.dropna(subset=["odo_left"])
    assert len(sides) == 40 * min(rate_hz, 20) and run["gnss_lat"].notna().sum() == 40
    assert np.abs(np.diff(truth["time"]) - 0.1).max() < 1 / rate_hz
    other = DRIVES[SKID](Options(4, duration=40.0)).truth
    lat = np.interp(truth["time"], other.time, other.lla[:, 0])
    assert np.abs(lat - truth["lat"]).max() * 1.11e5 < 0.02


def test_noise_told_is_the_noise_given(tmp_path: Path) -> None:
    bare = tuple(e for e in EFFECTS if e not in ("hills", "bumps"))
    out = simulate(CAR, tmp_path / "run", 3, duration=300.0, without=bare, noise=30.0)
    noise = json.loads((out / "truth_calibration.json").read_text())["noise"]
    sheet = GRADES["mems"]
    for moving in ("standing", "driving"):
        gyro, accel = noise[moving]["gyro_deg_sqrt_h"], noise[moving]["accel_mg_sqrt_hz"]
        np.testing.assert_allclose(gyro["0.1"], 30 * sheet.gyro_noise_deg_sqrt_h, rtol=0.1)
        np.testing.assert_allclose(accel["0.1"], 30 * sheet.accel_noise_mg_sqrt_hz, rtol=0.1)


def test_noise_told_is_that_of_means_and_tells_colour() -> None:
    rng = np.random.default_rng(0)
    white = DEG_SQRT_H * 10 * rng.standard_normal((200_000, 3))  # 1 deg/sqrt(h) at 100 Hz
    everywhere = np.ones(len(white), bool)
    found = imu.levels(white, everywhere, 0.01, DEG_SQRT_H)
    for level in found.values():
        np.testing.assert_allclose(level, 1.0, rtol=0.2)
    coloured = imu.levels(np.diff(white, axis=0), everywhere[1:], 0.01, DEG_SQRT_H)
    assert np.all(np.array(coloured["1"]) < 0.4 * np.array(coloured["0.1"]))


def test_imu_axes_are_off_by_what_the_truth_says(car: Driven) -> None:
    quiet = tuple(e for e in EFFECTS if e not in ("scale", "misalignment"))
    still = DRIVES[CAR](Options(3, duration=200.0, without=quiet, noise=0.0))
    found = imu.sensed(still, Options(3, duration=200.0, without=quiet, noise=0.0))
    off = found.imu.gyro - found.imu.gyro_bias - still.truth.gyro @ found.gyro_axes.T
    assert np.abs(off).max() < 1e-12
    factors = np.diag(found.accel_axes) - 1
    assert 0 < np.abs(factors).max() < 4 * IMPERFECTIONS["mems"].accel_scale


def test_stamps_jitter_about_even_times_and_keep_their_order() -> None:
    even = 0.01 * np.arange(1, 50_001)
    late = jittered(np.random.default_rng(1), even, 0.01) - even
    assert np.all(np.diff(late + even) > 0)
    assert abs(late.mean()) < 1e-4 and 0.5e-3 < late.std() < 2e-3 and late.max() > 4e-3
    arrives = kept(np.random.default_rng(1), even)
    assert 0.0005 < 1 - arrives.mean() < 0.01 and arrives[0] and arrives[-1]


def test_the_vehicle_file_states_what_a_user_knows(tmp_path: Path) -> None:
    out = simulate(SKID, tmp_path / "run", 4, duration=40.0)
    vehicle = tomllib.loads((out / "vehicle.toml").read_text())
    known = json.loads((out / "truth_calibration.json").read_text())
    assert vehicle["vehicle"] | {"kind": "tracked"} == vehicle["vehicle"]
    assert vehicle["imu"]["grade"] == "mems" and "column" not in vehicle["odometer"]
    assert set(known["effects"]) == set(EFFECTS)
    assert {"gyro_scale", "accel_misalignment", "track_width_m"} <= set(known["calibration"])
