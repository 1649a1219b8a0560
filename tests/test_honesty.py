"""The tools' figures of honesty: errors over sigma, independent samples, restated grades."""

from pathlib import Path

import numpy as np
import pytest
from honesty import pooled, restated
from noise_check import ratios
from normalised_errors import independent, normalised
from pandas import DataFrame
from scipy.signal import lfilter

from graphnav.common.earth import Origin
from graphnav.reading.vehicle_file import load_vehicle

ORIGIN = Origin(np.deg2rad(48.0), np.deg2rad(11.0), 500.0)


def track(sd: float) -> tuple[DataFrame, DataFrame]:
    """A drive to the north and a truth that lies 2 m west of it, heading over the north."""
    time = np.arange(0.0, 60.0, 0.1)
    p_n = np.stack([0 * time, 5 * time, 0 * time], -1)
    lat, lon, height = ORIGIN.geodetic(p_n - [2.0, 0, 0])
    truth = {"time": time, "lat": np.rad2deg(lat), "lon": np.rad2deg(lon), "height": height}
    truth |= {
        "v_e": 0 * time,
        "v_n": 5 + 0 * time,
        "v_u": 0 * time,
        "heading_deg": 359.0 + 0 * time,
    }
    own = {"time": time, "e": p_n[:, 0], "n": p_n[:, 1], "v_e": 0.2 + 0 * time, "v_n": 5 + 0 * time}
    own |= {"heading_deg": 1.0 + 0 * time, "sd_heading_deg": 0.5 + 0 * time}
    own |= {f"sd_{k}": sd + 0 * time for k in ("e", "n", "v_e", "v_n")}
    return DataFrame(own), DataFrame(truth)


def test_errors_are_held_against_their_own_deviations() -> None:
    found = normalised(*track(0.5), ORIGIN)
    assert {kind: z.shape for kind, z in found.items()} == {
        "position": (60, 2), "velocity": (60, 2), "heading": (60, 1),
    }  # fmt: skip
    np.testing.assert_allclose(found["position"], [[4.0, 0.0]] * 60, atol=1e-3)
    np.testing.assert_allclose(found["velocity"], [[0.4, 0.0]] * 60)
    np.testing.assert_allclose(found["heading"], 4.0)


def test_a_velocity_that_no_vehicle_has_is_left_out() -> None:
    own, truth = track(0.5)
    truth.loc[truth["time"] > 29.95, "v_n"] = 0.0
    velocity = normalised(own, truth, ORIGIN)["velocity"]
    assert len(velocity) == 59 and np.isclose(velocity[:30, 1], 0).all()


@pytest.mark.parametrize("keep", [0.0, 0.9, 0.99])
def test_independent_samples_are_those_of_the_correlation(keep: float) -> None:
    drive = np.random.default_rng(1).standard_normal((20_000, 2))
    found = independent(lfilter([1], [1, -keep], drive, axis=0))
    assert found == pytest.approx(20_000 * (1 - keep**2) / (1 + keep**2), rel=0.25)


def test_pooling_weighs_every_second_alike() -> None:
    rng = np.random.default_rng(1)
    found = pooled([rng.standard_normal((500, 2)), 3 * rng.standard_normal((500, 2))])
    assert found["z"] == pytest.approx(np.sqrt(5), rel=0.05)
    assert found["worst_run"] == pytest.approx(3, rel=0.1) and found["n"] > 700
    assert found["within_3"] == pytest.approx((0.9973 + 0.6827) / 2, abs=0.02)


def test_a_restated_grade_is_all_that_is_said_of_the_imu(tmp_path: Path) -> None:
    text = '[vehicle]\nkind = "wheeled"\n\n[imu]\naxes = "FLU"\ngrade = "mems"\n'
    (tmp_path / "vehicle.toml").write_text(text + "gyro_bias_deg_h = 8.0\naccel_bias_mg = 1.0\n")
    (tmp_path / "new").mkdir()
    described = restated(tmp_path / "vehicle.toml", "fog", tmp_path / "new")
    spec = load_vehicle(described, tmp_path / "run.csv").imu
    assert (spec.grade, spec.axes) == ("fog", "FLU") and not spec.given("gyro_bias_deg_h")


def test_noise_found_is_held_against_the_injected() -> None:
    injected = {
        "standing": {"gyro_deg_sqrt_h": {"1": [1.0, 2.0, 4.0]}, "accel_mg_sqrt_hz": {}},
        "driving": {
            "gyro_deg_sqrt_h": {"1": [9.0, 9.0, 9.0]},
            "accel_mg_sqrt_hz": {"1": [1.0] * 3},
        },
    }
    found = {
        "standing": {"gyro_deg_sqrt_h": [1.0, 1.0, 8.0], "accel_mg_sqrt_hz": [1.0] * 3},
        "driving": {"accel_mg_sqrt_hz": [3.0] * 3},
    }
    assert ratios(found, injected) == {
        ("standing", "gyro"): [1.0, 0.5, 2.0],
        ("driving", "accel"): [3.0, 3.0, 3.0],
    }
