"""Vehicle files: what is understood, and the one line each mistake earns."""

from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import shared

from graphnav.common.errors import InputError
from graphnav.graph.calibrations import scale_components
from graphnav.reading import columns, units
from graphnav.reading.axes import DIRECTIONS, axes_matrix, axes_name
from graphnav.reading.grades import GRADES
from graphnav.reading.vehicle import BodySpec, GnssSpec, ImuSpec, OdometerSpec, StartSpec
from graphnav.reading.vehicle_file import TABLES, load_vehicle, parse_vehicle

WHEELED = {"vehicle": {"kind": "wheeled"}}


def complaint(table: dict[str, Any]) -> str:
    with pytest.raises(InputError) as caught:
        parse_vehicle(table, "my.toml")
    text = str(caught.value)
    assert text.startswith("my.toml: ")
    assert "\n" not in text
    return text


def test_only_kind_is_needed() -> None:
    vehicle = parse_vehicle(WHEELED)
    assert vehicle.kind == "wheeled"
    assert set(vehicle.imu.assumed) == set(GRADES["mems"])
    assert not vehicle.start.has_position


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        ({}, ["[vehicle] is missing", "kind"]),
        ({"vehicle": {}}, ["kind is missing", "tracked", "rover"]),
        ({"kind": "tracked"}, ["'kind'", "belongs under [vehicle]"]),
        ({"vehicle": {"kind": "trackd"}}, ["'trackd'", '"tracked"']),
        ({**WHEELED, "odometre": {}}, ["'odometre'", "nearest is [odometer]"]),
        ({"vehicle": {"kind": "tracked", "track_gage": 2}}, ["'track_gage'", "'track_gauge'"]),
        (
            {**WHEELED, "odometer": {"meters_per_puls": 2}},
            ["'meters_per_puls'", "'metres_per_pulse'"],
        ),
        ({**WHEELED, "gnss": {"axes": "RFU"}}, ["'axes'", "belongs under [imu]"]),
        ({"vehicle": {"kind": "tracked", "track_gauge": "2.8"}}, ["'2.8'", "a number [m]"]),
        ({"vehicle": {"kind": "tracked", "track_gauge": True}}, ["True", "a number [m]"]),
        ({"vehicle": {"kind": "tracked", "track_gauge": -1}}, ["-1", "at least 1e-12 [m]"]),
        ({"vehicle": 3}, ["[vehicle]", "3"]),
        ({**WHEELED, "odometer": {"lever_arm": [1, 2]}}, ["lever_arm", "3 numbers", "[m]"]),
        ({**WHEELED, "odometer": {"lever_arm": [1, 2, "a"]}}, ["lever_arm", "3 numbers"]),
        ({**WHEELED, "imu": {"axes": "RFD"}}, ["left-handed", "'RFU'"]),
        ({**WHEELED, "imu": {"axes": "RLU"}}, ["twice"]),
        ({**WHEELED, "imu": {"axes": "ENU"}}, ["'ENU'", "R/L"]),
        ({**WHEELED, "gnss": {"use": "no"}}, ["'no'", "true or false"]),
        ({**WHEELED, "start": {"lat": 3}}, ["both lat and lon"]),
        ({**WHEELED, "start": {"lat": 91, "lon": 3}}, ["91", "at most 90 [deg]"]),
        ({**WHEELED, "start": {"heading_deg": float("nan")}}, ["nan", "[deg]"]),
        ({**WHEELED, "columns": {"gyrox": "wx"}}, ["'gyrox'", "'gyro_x'"]),
        ({**WHEELED, "columns": {"gyro_x": {"unit": "km/h"}}}, ["gyro_x", "km/h", "deg/s"]),
        ({**WHEELED, "columns": {"gyro_x": {"nam": "wx"}}}, ["gyro_x", "name", "unit"]),
    ],
)
def test_each_mistake_is_one_helpful_line(table: dict[str, Any], parts: list[str]) -> None:
    text = complaint(table)
    for part in parts:
        assert part in text, text


def test_unknown_keys_always_name_a_known_one() -> None:
    for name in ("vehicle", "odometer", "imu", "gnss", "start", "rover", "columns"):
        assert name in TABLES
        text = complaint(WHEELED | {name: {**WHEELED.get(name, {}), "zzz": 1}})
        assert "nearest is '" in text


def test_grade_fills_what_is_not_given_and_explicit_keys_win() -> None:
    imu = parse_vehicle({**WHEELED, "imu": {"grade": "fog", "gyro_bias_deg_h": 0.02}}).imu
    assert imu.gyro_bias_deg_h == 0.02
    assert imu.accel_bias_mg == GRADES["fog"]["accel_bias_mg"]
    assert imu.assumed == ()
    partly = parse_vehicle({**WHEELED, "imu": {"gyro_bias_deg_h": 0.02}}).imu
    assert "gyro_bias_deg_h" not in partly.assumed
    assert "accel_bias_mg" in partly.assumed


def test_grades_fill_exactly_the_noise_keys() -> None:
    for figures in GRADES.values():
        assert set(figures) | {"gyro_instability_deg_h", "accel_instability_mg"} == {
            k for k in ImuSpec.model_fields if k not in ("axes", "grade")
        }


def test_biases_wander_by_a_tenth_of_what_they_are() -> None:
    imu = parse_vehicle({**WHEELED, "imu": {"grade": "fog", "accel_bias_mg": 3.0}}).imu
    assert imu.gyro_instability_deg_h == pytest.approx(0.1 * GRADES["fog"]["gyro_bias_deg_h"])
    assert imu.accel_instability_mg == pytest.approx(0.3)


def test_deviations_are_wider_when_nothing_is_stated() -> None:
    stated = OdometerSpec(lever_arm=(0.0, 0.0, 0.0), mount_deg=(0.0, 0.0, 0.0))
    assert stated.lever_arm_sd < OdometerSpec().lever_arm_sd
    assert stated.mount_sd_deg < OdometerSpec().mount_sd_deg
    assert OdometerSpec(lever_arm_sd=0.3).lever_arm_sd == 0.3


def test_an_antenna_that_would_sit_in_the_imu_is_not_stated() -> None:
    zeros = GnssSpec(lever_arm=(0.0, 0.0, 0.0))
    assert zeros.lever_arm_sd == GnssSpec().lever_arm_sd == 1.0
    assert GnssSpec(lever_arm=(0.0, 0.5, 0.0)).lever_arm_sd == 0.05
    assert GnssSpec(lever_arm=(0.0, 0.0, 0.0), lever_arm_sd=0.02).lever_arm_sd == 0.02


def test_models_are_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        BodySpec(kind="wheeled").kind = "rover"  # type: ignore[misc]


def test_mounting_is_told_in_degrees_and_used_in_radians() -> None:
    np.testing.assert_allclose(
        OdometerSpec(mount_deg=(180.0, 0.0, -90.0)).mount_b, np.pi * np.array([1, 0, -0.5])
    )


def test_a_start_without_height_still_is_a_position() -> None:
    assert StartSpec(lat=1.0, lon=2.0).has_position


@given(st.permutations(["RL", "FB", "UD"]), st.tuples(*[st.integers(0, 1)] * 3))
def test_axes_are_rotations_that_do_what_the_letters_say(
    order: list[str], pick: tuple[int, ...]
) -> None:
    axes = "".join(pair[k] for pair, k in zip(order, pick, strict=True))
    columns_of = np.array([DIRECTIONS[letter] for letter in axes], float).T
    if np.linalg.det(columns_of) < 0:
        with pytest.raises(ValueError, match="left-handed"):
            axes_matrix(axes)
        return
    matrix = axes_matrix(axes)
    assert axes_name(matrix) == axes
    np.testing.assert_array_equal(matrix @ matrix.T, np.eye(3))
    for k, letter in enumerate(axes):
        np.testing.assert_array_equal(matrix[:, k], DIRECTIONS[letter])


def test_there_are_24_axis_orders() -> None:
    orders = ("".join(x) for p in permutations(("RL", "FB", "UD")) for x in product(*p))
    assert sum(np.linalg.det([DIRECTIONS[c] for c in axes]) > 0 for axes in orders) == 24


@pytest.mark.parametrize(
    ("dimension", "unit", "factor"),
    [
        ("rate", "deg/s", np.pi / 180),
        ("rate", "dps", np.pi / 180),
        ("acceleration", "g", 9.80665),
        ("speed", "km/h", 1 / 3.6),
        ("time", "ms", 1e-3),
        ("position", "rad", 180 / np.pi),
    ],
)
def test_units(dimension: str, unit: str, factor: float) -> None:
    assert units.factor(dimension, unit) == pytest.approx(factor, rel=1e-15)


def test_every_column_has_a_dimension_with_units() -> None:
    for name in [*columns.DIMENSION, *columns.GROUPS]:
        assert units.factor(columns.dimension(name), columns.default_unit(name)) == 1.0


def test_a_missing_file_says_how_to_begin(tmp_path: Path) -> None:
    run = tmp_path / "run.csv"
    with pytest.raises(InputError, match="no such run file"):
        load_vehicle(None, run)
    run.write_text("time\n")
    with pytest.raises(InputError, match=r"vehicle\.toml.*--vehicle"):
        load_vehicle(None, run)


def test_what_is_not_toml_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "v.toml"
    path.write_text("[vehicle]\nkind = tracked\n")
    with pytest.raises(InputError, match=r"v\.toml: not TOML.*line 2"):
        load_vehicle(path, tmp_path / "run.csv")


@pytest.mark.parametrize(
    "name", ["kingston2008", "comma2k19", "husky", "sim_tracked", "sim_rlg", "sim_mimu"]
)
def test_shared_vehicle_files_read(name: str) -> None:
    vehicle = load_vehicle(None, shared(name))
    assert vehicle.imu.assumed == ()
    assert (vehicle.kind == "tracked") == (name in ("husky", "sim_tracked"))


def test_scale_factors_go_by_the_grade_whose_bias_is_nearest() -> None:
    gyros = parse_vehicle({**WHEELED, "imu": {"gyro_bias_deg_h": 0.02}}).imu
    assert gyros.gyro_scale_ppm == GRADES["fog"]["gyro_scale_ppm"]
    assert "gyro_scale_ppm" not in gyros.assumed and "accel_scale_ppm" in gyros.assumed
    named = parse_vehicle({**WHEELED, "imu": {"grade": "tactical", "accel_bias_mg": 0.1}}).imu
    assert named.accel_scale_ppm == GRADES["tactical"]["accel_scale_ppm"]


def test_scale_factors_are_held_at_zero_and_opened_by_a_wrong_weight() -> None:
    held = parse_vehicle({**WHEELED, "imu": {"gyro_scale_ppm": 0, "grade": "tactical"}})
    [accel] = scale_components(held)
    assert accel.name == "accel_scale" and accel.sd == pytest.approx([1e-3] * 3)
    [same], [open_] = scale_components(held, 1.004), scale_components(held, 0.99)
    assert same.sd == pytest.approx(accel.sd) and open_.sd == pytest.approx([0.01] * 3)
    off = parse_vehicle({**WHEELED, "imu": {"gyro_scale_ppm": 0, "accel_scale_ppm": 0}})
    assert scale_components(off, 0.99) == []
