"""Run files into a `Run`: units, axes, blanks, and what is malformed."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import PULSES, VEHICLE, driven, fixes, saved, shared

from graphnav.common.run import Run
from graphnav.reading.axes import axes_matrix
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle, parse_vehicle

GYRO, ACCEL = ["gyro_x", "gyro_y", "gyro_z"], ["accel_x", "accel_y", "accel_z"]


def read(path: Path) -> Run:
    return read_run(path, load_vehicle(None, path))


def test_values_arrive_unchanged(tmp_path: Path) -> None:
    table = driven()
    run = read(saved(table, tmp_path))
    assert run.imu is not None
    assert run.clock_start == table["time"][0]
    np.testing.assert_array_equal(run.imu.gyro, table[GYRO])
    np.testing.assert_array_equal(run.imu.accel, table[ACCEL])
    np.testing.assert_array_equal(run.imu.time, table["time"] - table["time"][0])
    np.testing.assert_allclose(run.imu.dt, 0.02, atol=1e-12)
    assert run.end == run.imu.time[-1]


def test_sensors_keep_their_own_rates(tmp_path: Path) -> None:
    table = driven()
    run = read(saved(table, tmp_path))
    assert run.odometer is not None
    known = table["odo_speed"].notna()
    np.testing.assert_array_equal(run.odometer.speed, table["odo_speed"][known])
    np.testing.assert_allclose(run.odometer.time, table["time"][known] - table["time"][0])
    assert run.gnss is None


@pytest.mark.parametrize("form", ["csv", "csv.gz", "parquet"])
def test_all_file_forms_read_alike(tmp_path: Path, form: str) -> None:
    table = driven(20)
    reference = read(saved(table, tmp_path))
    other = tmp_path / f"other.{form}"
    table.to_parquet(other) if form == "parquet" else table.to_csv(other, index=False)
    again = read(other)
    assert reference.imu is not None and again.imu is not None
    np.testing.assert_array_equal(reference.imu.accel, again.imu.accel)


def test_speed_becomes_distance_by_trapezoids(tmp_path: Path) -> None:
    table = driven().assign(odo_speed=lambda t: 2.0 * t["time"] - 30)  # backwards, then forwards
    run = read(saved(table, tmp_path))
    assert run.odometer is not None
    time = table["time"].to_numpy()
    expected = time**2 - 30 * time - (time[0] ** 2 - 30 * time[0])
    np.testing.assert_allclose(run.odometer.distance, expected, atol=1e-9)
    assert run.odometer.pulse == 0.0


def test_pulses_become_distance(tmp_path: Path) -> None:
    counts = np.floor(np.arange(3000) * 0.37) + 1234
    run = read(
        saved(driven().assign(odo_pulses=counts).drop(columns="odo_speed"), tmp_path, PULSES)
    )
    assert run.odometer is not None
    np.testing.assert_allclose(run.odometer.distance, (counts - 1234) * 0.02, atol=1e-9)
    assert run.odometer.pulse == 0.02
    assert run.notes == ()


def test_a_counter_that_wraps_is_unwrapped_and_told(tmp_path: Path) -> None:
    true = np.arange(3000.0)
    run = read(saved(driven().assign(odo_pulses=true % 2048), tmp_path, PULSES))
    assert run.odometer is not None
    assert run.odometer.distance[-1] == pytest.approx(true[-1] * 0.02)
    assert any("wraps at 2048, 1 times" in note for note in run.notes)


def test_jolts_are_neither_rejected_nor_clipped(tmp_path: Path) -> None:
    table = driven()
    table.loc[700, "accel_y"] = 300.0
    run = read(saved(table, tmp_path))
    assert run.imu is not None
    assert run.imu.accel[700, 1] == 300.0


def test_gaps_stay_true(tmp_path: Path) -> None:
    run = read(saved(driven().drop(index=range(100, 150)), tmp_path))
    assert run.imu is not None
    assert run.imu.dt[100] == pytest.approx(1.02)


@pytest.mark.parametrize("axes", ["FRD", "FLU", "BRU", "UFL", "LDB"])
def test_axes_turn_vectors_to_right_forward_up(tmp_path: Path, axes: str) -> None:
    table = driven()
    recorded = table.copy()
    for names in (GYRO, ACCEL):
        recorded[names] = table[names].to_numpy() @ axes_matrix(axes)  # A^T v per row
    vehicle = VEHICLE.replace('grade = "tactical"', f'grade = "tactical"\naxes = "{axes}"')
    run = read(saved(recorded, tmp_path, vehicle))
    assert run.imu is not None
    np.testing.assert_array_equal(run.imu.gyro, table[GYRO])
    np.testing.assert_array_equal(run.imu.accel, table[ACCEL])


def test_names_and_units_are_mapped(tmp_path: Path) -> None:
    table = driven()
    other = pd.DataFrame({"t_ms": table["time"] * 1000, "wx": np.rad2deg(table["gyro_x"])})
    other[GYRO[1:]] = np.rad2deg(table[GYRO[1:]])
    other[ACCEL] = table[ACCEL] / 9.80665
    other["speed"] = table["odo_speed"] * 3.6
    mapping = """
[columns]
time = { name = "t_ms", unit = "ms" }
gyro = { unit = "deg/s" }
gyro_x = "wx"
accel = { unit = "g" }
odo_speed = { name = "speed", unit = "km/h" }
"""
    run = read(saved(other, tmp_path, VEHICLE + mapping))
    assert run.imu is not None and run.odometer is not None
    np.testing.assert_allclose(run.imu.gyro, table[GYRO], atol=1e-15)
    np.testing.assert_allclose(run.imu.accel, table[ACCEL], atol=1e-12)
    np.testing.assert_allclose(run.imu.time, table["time"] - table["time"][0], atol=1e-9)
    np.testing.assert_allclose(run.odometer.speed, table["odo_speed"].dropna(), atol=1e-12)
    assert run.notes == ()


def test_unknown_columns_are_told_not_guessed(tmp_path: Path) -> None:
    run = read(saved(driven().assign(Speed=1.0), tmp_path))
    assert "'Speed'" in run.notes[0]


def test_fixes_without_deviation_get_the_vehicle_files_and_a_note(tmp_path: Path) -> None:
    run = read(saved(fixes(driven()), tmp_path, VEHICLE + "[gnss]\nsd = 7.0\n"))
    assert run.gnss is not None
    np.testing.assert_array_equal(run.gnss.sd_enu, np.full((60, 3), 7.0))
    assert any("7 m assumed" in note for note in run.notes)


def test_fixes_at_nowhere_are_left_out(tmp_path: Path) -> None:
    table = fixes(driven())
    table.loc[0, ["gnss_lat", "gnss_lon"]] = 0.0
    run = read(saved(table, tmp_path))
    assert run.gnss is not None
    assert len(run.gnss.time) == 59
    assert any("0, 0" in note for note in run.notes)


def test_sides_alone_serve_as_odometer(tmp_path: Path) -> None:
    table = driven().drop(columns="odo_speed").assign(odo_left=1.0, odo_right=3.0)
    run = read(saved(table, tmp_path))
    assert run.odometer is not None and run.sides is not None
    np.testing.assert_array_equal(run.odometer.speed, 2.0)
    assert any("mean of odo_left and odo_right" in note for note in run.notes)


def test_external_heading_in_radians(tmp_path: Path) -> None:
    run = read(saved(driven().assign(heading_deg=270.0), tmp_path))
    assert run.heading is not None
    np.testing.assert_allclose(run.heading.heading, 1.5 * np.pi)


def test_a_rover_needs_no_gyros(tmp_path: Path) -> None:
    table = driven()[["time", *ACCEL]].assign(**{f"wheel_{i}": float(i) for i in range(1, 7)})
    run = read(saved(table, tmp_path, VEHICLE.replace("wheeled", "rover")))
    assert run.imu is None
    assert run.accelerometer is not None and run.rover is not None
    np.testing.assert_array_equal(run.rover.wheel[0], np.arange(1.0, 7.0))
    np.testing.assert_array_equal(run.accelerometer.accel, table[ACCEL])


@pytest.mark.parametrize(
    ("name", "samples", "fixes", "pulse"),
    [
        ("kingston2008", 35290, 3528, 0.0),
        ("comma2k19", 6247, 579, 0.0),
        ("husky", 11863, 988, 0.0),
        ("sim_tracked", 90000, 0, 0.0108),
        ("sim_rlg", 90000, 0, 0.02),
        ("sim_mimu", 100000, 0, 0.0),
    ],
)
def test_shared_runs(name: str, samples: int, fixes: int, pulse: float) -> None:
    run = read(shared(name))
    assert run.imu is not None and run.odometer is not None
    assert len(run.imu.time) == samples
    assert (len(run.gnss.time) if run.gnss else 0) == fixes
    assert run.odometer.pulse == pulse
    assert run.notes == ()


def test_fixes_carried_on_by_the_logger_count_once(tmp_path: Path) -> None:
    table = driven()
    second = np.floor(table["time"])
    carried = table.assign(gnss_lat=45.0 + 1e-5 * second, gnss_lon=10.0, gnss_height=1.0)
    path = saved(carried, tmp_path)
    run = read_run(path, load_vehicle(None, path))
    assert run.gnss is not None
    assert len(run.gnss.time) == second.nunique()
    assert any("repeat the fix before" in note for note in run.notes)


@pytest.mark.parametrize("way", ["left out", "zero"])
def test_level_gyros_that_were_not_recorded_are_told(tmp_path: Path, way: str) -> None:
    """In any axes; a vehicle that stands still throughout keeps its upright gyro."""
    names = ["gyro_x", "gyro_y", "gyro_z"] if way == "zero" else ["gyro_z"]
    header = ["time", *names, "accel_x", "accel_y", "accel_z"]
    rows = [[k / 100, *([0] * len(names)), 0.1, 0.2, -9.8] for k in range(50)]
    text = "\n".join(",".join(map(str, row)) for row in [header, *rows])
    (tmp_path / "run.csv").write_text(text)
    vehicle = parse_vehicle({"vehicle": {"kind": "wheeled"}, "imu": {"axes": "FRD"}})
    run = read_run(tmp_path / "run.csv", vehicle)
    assert run.sensed == (False, False, True, True, True, True)
    assert run.imu is not None and not run.imu.gyro.any()
    assert any("gyro_x, gyro_y not recorded" in note for note in run.notes)
