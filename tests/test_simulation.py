"""The simulator: truth that inertial navigation returns to, sensors and odometer as declared."""

import gzip
import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from graphnav.common.errors import InputError
from graphnav.simulation import DRIVES, GRADES, Options, Truth, simulate, simulate_truth
from graphnav.simulation.drive import INTERNAL_HZ, Driven, stream
from graphnav.simulation.grades import DEG_H, MG, disturb
from graphnav.simulation.recording import record, scale_curve
from graphnav.simulation.tracked import CONTACT, GAUGE, LOW_GEAR

RATE_HZ, EVERY = 100, INTERNAL_HZ // 100
FLIP = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])  # RFU <-> FRD, ENU <-> NED


@pytest.fixture(scope="module")
def tracked() -> Driven:
    return DRIVES["tracked"](Options(7, duration=1500.0))


@pytest.fixture(scope="module")
def truck() -> Driven:
    return DRIVES["wheeled"](Options(7, duration=1200.0))


@pytest.fixture(scope="module")
def car() -> Driven:
    return DRIVES["slip"](Options(7))


def navigated(truth: Truth) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors of pyins' strapdown navigation: position m, velocity m/s, attitude arcsec (N, 3)."""
    strapdown = pytest.importorskip("pyins.strapdown")
    transform = pytest.importorskip("pyins.transform")
    dt = 1 / RATE_HZ
    means = np.concatenate([truth.gyro @ FLIP, truth.accel @ FLIP], axis=1) * dt
    names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
    imu = pd.DataFrame(np.concatenate([means[:1], means]), truth.time, names)
    v_ned, names = truth.v_n @ FLIP, ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch"]
    start = np.concatenate([truth.lla[0], v_ned[0], truth.angles_deg[0]])
    integrator = strapdown.Integrator(pd.Series(start, [*names, "heading"]))
    got = integrator.integrate(strapdown.compute_increments_from_imu(imu, "increment"))
    position = transform.compute_lla_difference(got[["lat", "lon", "alt"]].values, truth.lla)
    velocity = got[["VN", "VE", "VD"]].values - v_ned
    angles = got[["roll", "pitch", "heading"]].values
    R = Rotation.from_euler("xyz", angles, degrees=True)
    turned = (R * Rotation.from_matrix(FLIP @ truth.R_nb @ FLIP).inv()).as_rotvec()
    return position, velocity, np.degrees(turned) * 3600


@pytest.mark.parametrize("scenario", sorted(DRIVES))
def test_strapdown_navigation_returns_to_the_truth(scenario: str) -> None:
    position, velocity, attitude = navigated(simulate_truth(scenario, 11, duration=600.0))
    assert np.hypot(position[:, 0], position[:, 1]).max() < 0.15
    assert np.abs(velocity).max() < 2e-3
    # on bumps the axes of rotation turn within a sample: its mean rate cannot tell that
    assert np.abs(attitude).max() < (0.1 if scenario.startswith("field-") else 0.02)


def test_truth_drives_turns_climbs_and_shakes(tracked: Driven) -> None:
    truth = tracked.truth
    moving = np.linalg.norm(truth.v_n, axis=1)[1:] > 5
    assert truth.v_n.shape == truth.lla.shape == (150001, 3)
    assert truth.R_nb.shape == (150001, 3, 3) and truth.gyro.shape == truth.accel.shape
    assert np.abs(truth.angles_deg[:, 1]).max() > 2 and truth.accel[moving, 2].std() > 0.5
    assert np.ptp(np.unwrap(truth.angles_deg[:, 2], period=360)) > 90


def test_a_standing_imu_feels_gravity_and_the_turning_earth(truck: Driven) -> None:
    truth, rest = truck.truth, slice(0, 8000)
    assert np.abs(truth.v_n[rest]).max() < 1e-14
    up = np.linalg.norm(truth.accel[rest], axis=1)
    lat = np.radians(truth.lla[0, 0])
    gravity = 9.7803253359 * (1 + 0.00193185265241 * np.sin(lat) ** 2)
    gravity /= np.sqrt(1 - 6.6943799901413e-3 * np.sin(lat) ** 2)
    np.testing.assert_allclose(up, gravity - 3.086e-6 * truth.lla[0, 2], atol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(truth.gyro[rest], axis=1), 7.292115e-5, atol=1e-10)
    north = truth.R_nb[0] @ truth.gyro[0]
    np.testing.assert_allclose(
        north, 7.292115e-5 * np.array([0, np.cos(lat), np.sin(lat)]), atol=1e-11
    )


def vehicle_point(driven: Driven) -> np.ndarray:
    """Mean velocity (N, 3) of the odometer point in m over samples, from the IMU's truth alone."""
    truth, setup = driven.truth, driven.setup
    lat = np.radians(truth.lla[0, 0])
    earth_n = 7.292115e-5 * np.array([0, np.cos(lat), np.sin(lat)])
    w_b = truth.gyro - np.einsum("nji,j->ni", truth.R_nb[1:], earth_n)
    v_b = np.einsum("nji,nj->ni", truth.R_nb, truth.v_n)
    v_b = 0.5 * (v_b[1:] + v_b[:-1]) + np.cross(w_b, setup.lever)
    return Rotation.from_rotvec(setup.mount_deg, degrees=True).inv().apply(v_b)


def mean(nodes: np.ndarray) -> np.ndarray:
    """Means over samples (N,) of internal nodes (N * EVERY + 1,)."""
    return (0.5 * (nodes[1:] + nodes[:-1])).reshape(-1, EVERY).mean(1)


def smoothed(x: np.ndarray) -> np.ndarray:
    return np.convolve(x, np.full(100, 0.01), "same")


def interior(driven: Driven, state: str) -> np.ndarray:
    """Samples of a state, more than 1.2 s from its ends."""
    inside = driven.commands.state_at(driven.truth.time[1:]) == state
    return np.convolve(inside, np.ones(241), "same") == 241


def test_odometer_obeys_every_state_of_the_papers_table(tracked: Driven) -> None:
    v_m = vehicle_point(tracked)
    v_o = mean(tracked.odometer_speed)
    yaw_rate = mean(tracked.commands.yaw_rate)
    rules = {
        "straight_high": (1.0, 0.0),
        "straight_low": (1 / LOW_GEAR, 0.0),
        "turn_arc": (0.8688, 0.0),
        "turn_separated": (1.0, GAUGE / 2),
        "turn_separated_low": (1 / LOW_GEAR, GAUGE / 2),
    }
    for state, (factor, half_gauge) in rules.items():
        at = interior(tracked, state)
        assert at.sum() > 100, state
        expected = factor * v_o - half_gauge * np.abs(yaw_rate)
        np.testing.assert_allclose(smoothed(v_m[:, 1])[at], smoothed(expected)[at], atol=0.01)
        np.testing.assert_allclose(
            smoothed(v_m[:, 0])[at], smoothed(-0.10 * CONTACT * yaw_rate)[at], atol=0.01
        )
        assert np.abs(smoothed(v_m[:, 2])[at]).max() < 0.02
    pivot = interior(tracked, "turn_pivot")
    assert np.all(v_o[pivot] > 1.5 * v_m[pivot, 1])  # raw odometer useless there


def test_all_nine_states_occur_and_none_begins_at_speed(tracked: Driven) -> None:
    legs, speed = tracked.commands.legs, tracked.commands.speed
    assert len({leg.state for leg in legs}) == 9
    assert legs[0].state == "stop" and legs[0].duration == 120
    for leg, edge in zip(legs, tracked.commands.edges, strict=False):
        if "pivot" in leg.state:
            before = speed[int((edge - 4) * RATE_HZ * EVERY)]
            assert 1.5 < before < 3.5


def test_soil_moves_the_constants_by_seed() -> None:
    def factors(seed: int) -> dict[str, float]:
        options = Options(seed, duration=130.0, ground="soil")
        constants = DRIVES["tracked"](options).constants
        _, names, values = constants["forward_factor"]
        return dict(zip(names, values, strict=True)) | {"kappa": constants["kappa"][2][0]}

    one, other = factors(1), factors(2)
    for drawn in (one, other):
        assert 0.05 <= abs(drawn["turn_arc"] / 0.8688 - 1) <= 0.15
        assert drawn["straight_low"] == pytest.approx(1 / LOW_GEAR)
        assert drawn["kappa"] > 0.13
    assert one["turn_arc"] != other["turn_arc"] and one["kappa"] != other["kappa"]


def test_pulses_count_the_true_distance_through_the_wandering_scale(truck: Driven) -> None:
    made = record(truck, Options(7))
    pulses = made.run["odo_pulses"].to_numpy()
    known = made.calibration["calibration"]["odometer_scale"]
    curve = scale_curve(stream(7, "scale"), truck.truth.time, truck)
    np.testing.assert_allclose(np.ravel(known["value"]), curve[::1000])
    assert np.all(np.diff(pulses) >= 0) and pulses[0] == 0
    per_sample = smoothed(np.diff(pulses, prepend=0) * 0.02 * RATE_HZ)
    v_y = smoothed(vehicle_point(truck)[:, 1])
    # an abrupt halt falls between two nodes of the truth: leave its surroundings out of the sum
    halts = np.abs(np.diff(truck.commands.speed[::EVERY])) > 1
    away = np.convolve(halts, np.ones(205), "same") == 0
    missed = np.cumsum((v_y - curve[1:] * per_sample)[away]) / RATE_HZ
    assert np.abs(missed).max() < 0.03  # after 13 km
    assert np.ptp(curve) > 1.4e-3


def test_car_slips_hops_and_its_wheel_spins_only_in_the_listed_episodes(car: Driven) -> None:
    v_m, time = vehicle_point(car), car.truth.time[1:]
    wheel = mean(car.odometer_speed)
    free = np.ones(len(time), bool)
    for event in car.events:
        inside = (time > event.start) & (time < event.end)
        slipping = {"side_slip": v_m[:, 0], "hop": v_m[:, 2]}.get(event.kind, wheel - v_m[:, 1])
        extreme = slipping[inside][np.argmax(np.abs(slipping[inside]))]
        assert extreme == pytest.approx(event.peak_velocity, abs=0.15), event
        free &= ~((time > event.start - 0.1) & (time < event.end + 0.1))
    assert len(car.events) == 6
    listed = {(400.0, 405.0, "side_slip"), (900.0, 905.0, "hop")}
    assert {(e.start, e.end, e.kind) for e in car.events} >= listed
    # the abrupt start falls between two nodes of the truth: not the last permille
    assert np.percentile(np.abs(v_m[free][:, [0, 2]]), 99.9) < 1e-3
    assert np.percentile(np.abs((wheel - v_m[:, 1])[free]), 99.9) < 0.02


@pytest.mark.parametrize("grade", sorted(GRADES))
def test_sensor_errors_are_those_of_the_grade(truck: Driven, grade: str) -> None:
    sheet, dt = GRADES[grade], 1 / RATE_HZ
    gyro_biases, accel_biases = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        zero = np.zeros((20000, 3))
        seen = disturb(rng, sheet, zero, zero, dt)
        white = seen.gyro - seen.gyro_bias
        noise = sheet.gyro_noise_deg_sqrt_h * np.pi / 180 / 60 / np.sqrt(dt)
        assert white.std() == pytest.approx(noise, rel=0.02)
        assert abs(np.corrcoef(white[1:, 0], white[:-1, 0])[0, 1]) < 0.03
        white = seen.accel - seen.accel_bias
        assert white.std() == pytest.approx(
            sheet.accel_noise_mg_sqrt_hz * MG / np.sqrt(dt), rel=0.02
        )
        gyro_biases.append(seen.gyro_bias[0] / DEG_H)
        accel_biases.append(seen.accel_bias[0] / MG)
        wander = (seen.gyro_bias[-1] - seen.gyro_bias[0]) / DEG_H
        assert np.abs(wander).max() < 5 * sheet.gyro_wander_deg_h * np.sqrt(200 / 3600)
    assert np.std(gyro_biases) == pytest.approx(sheet.gyro_bias_deg_h, rel=0.4)
    assert np.std(accel_biases) == pytest.approx(sheet.accel_bias_mg, rel=0.4)


def test_gnss_is_once_a_second_with_its_noise_and_some_multipath(truck: Driven) -> None:
    run = record(truck, Options(7, gnss=True)).run
    fixes = run.dropna(subset=["gnss_lat"])
    assert np.allclose(np.diff(fixes["time"]), 1.0) and len(fixes) == 1200
    north = (fixes["gnss_lat"].to_numpy() - truck.truth.lla[100::100, 0]) * 111_030
    typical = 1.4826 * np.median(np.abs(north - np.median(north)))
    assert typical == pytest.approx(fixes["gnss_sd_n"].iloc[0], rel=0.2)
    assert np.abs(north).max() > 6


def test_the_same_seed_gives_the_same_files_and_another_does_not(tmp_path: Path) -> None:
    names = ("run.csv.gz", "truth.csv.gz", "vehicle.toml", "truth_calibration.json")
    one, same, other = (
        simulate("tracked", tmp_path / name, seed, duration=150.0, gnss=True)
        for name, seed in (("one", 5), ("same", 5), ("other", 6))
    )
    for name in names:
        assert (one / name).read_bytes() == (same / name).read_bytes()
        assert (one / name).read_bytes() != (other / name).read_bytes()
    with gzip.open(one / "run.csv.gz", "rt") as lines:
        assert next(lines).startswith(
            "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,odo_pulses"
        )
        assert next(lines).startswith("0.01,") and ",,,,,," in next(lines)


def test_files_follow_the_interface(tmp_path: Path) -> None:
    out = simulate("wheeled", tmp_path / "car", 5, duration=450.0, slips=True, grade="tactical")
    run, truth = pd.read_csv(out / "run.csv.gz"), pd.read_csv(out / "truth.csv.gz")
    vehicle = tomllib.loads((out / "vehicle.toml").read_text())
    known = json.loads((out / "truth_calibration.json").read_text())
    assert run["odo_speed"].notna().sum() == 4500 and run["gyro_x"].notna().all()
    assert list(truth.columns[:4]) == ["time", "lat", "lon", "height"]
    assert truth["time"].iloc[[0, 1]].tolist() == [0.01, 0.11]
    assert vehicle["imu"]["gyro_bias_deg_h"] == 2.0 and vehicle["odometer"]["column"] == "odo_speed"
    off = vehicle["start"]["heading_deg"] - known["start_heading_deg"]
    assert 0 < abs((off + 180) % 360 - 180) < 5 * vehicle["start"]["heading_sd_deg"]
    assert {e["kind"] for e in known["events"]} >= {"side_slip"}
    assert set(known["calibration"]) >= {"gyro_bias_deg_h", "odometer_scale", "lever_arm_m"}


def test_a_directory_that_is_not_ours_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not a simulation"):
        simulate("tracked", tmp_path, 1, duration=130.0)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    ours = simulate("tracked", tmp_path / "run", 1, duration=130.0)
    first = (ours / "run.csv.gz").read_bytes()
    assert simulate("tracked", ours, 2, duration=130.0) == ours
    assert (ours / "run.csv.gz").read_bytes() != first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "run"]


@pytest.mark.parametrize(
    "choice",
    [
        {"scenario": "boat"},
        {"ground": "ice"},
        {"grade": "quartz"},
        {"duration": -5.0},
        {"rate_hz": 5},
        {"without": ("vibration",)},
        {"scenario": "field-skid", "without": ("rain",)},
    ],
)
def test_unknown_choices_name_the_known_ones_and_write_nothing(
    tmp_path: Path, choice: dict
) -> None:
    arguments = {"scenario": "tracked", "duration": 130.0} | choice
    scenario = arguments.pop("scenario")
    with pytest.raises(InputError, match=r"use|choose"):
        simulate(scenario, tmp_path / "run", 1, **arguments)
    assert list(tmp_path.iterdir()) == []
