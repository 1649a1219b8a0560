"""Run files into a `Run`: units, axes, blanks, and what is malformed."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import VEHICLE, driven, saved, shared

from graphnav.axes import axes_matrix
from graphnav.errors import InputError
from graphnav.read import read_run
from graphnav.run import Run
from graphnav.vehicle_file import load_vehicle

GYRO, ACCEL = ["gyro_x", "gyro_y", "gyro_z"], ["accel_x", "accel_y", "accel_z"]
PULSES = VEHICLE + '[odometer]\ncolumn = "odo_pulses"\nmetres_per_pulse = 0.02\n'


def read(path: Path) -> Run:
    return read_run(path, load_vehicle(None, path))


def complaint(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


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


def test_a_counter_that_wraps_counts_no_distance_and_is_told(tmp_path: Path) -> None:
    true = np.arange(3000.0)
    run = read(saved(driven().assign(odo_pulses=true % 2048), tmp_path, PULSES))
    assert run.odometer is not None
    assert run.odometer.distance[-1] == pytest.approx((true[-1] - 1) * 0.02)
    assert any("jumps 1 times" in note for note in run.notes)


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


def fixes(table: pd.DataFrame, every: int = 50) -> pd.DataFrame:
    at = np.arange(len(table)) % every == 0
    return table.assign(
        **{
            name: np.where(at, value, np.nan)
            for name, value in {"gnss_lat": 45.0, "gnss_lon": 10.0, "gnss_height": 100.0}.items()
        }
    )


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


# -- malformed files


def test_missing_column_names_the_likely_one(tmp_path: Path) -> None:
    text = complaint(saved(driven().rename(columns={"gyro_y": "gyroy"}), tmp_path))
    assert "no column 'gyro_y'" in text
    assert "'gyroy'" in text


def test_missing_time_shows_the_mapping(tmp_path: Path) -> None:
    text = complaint(saved(driven().rename(columns={"time": "timestamp"}), tmp_path))
    assert 'time = { name = "timestamp"' in text


@pytest.mark.parametrize("word", ["abc", "1.2.3", "12 m/s", "1,5"])
def test_text_in_a_number_names_line_and_column(tmp_path: Path, word: str) -> None:
    table = driven().astype({"accel_y": object})
    table.loc[17, "accel_y"] = word
    text = complaint(saved(table, tmp_path))
    assert "line 19: accel_y" in text
    assert f"'{word}'" in text


def test_text_far_down_a_large_file_is_found(tmp_path: Path) -> None:
    table = driven(1200, 100).astype({"gyro_x": object})
    table.loc[110_000, "gyro_x"] = "oops"
    assert "line 110002: gyro_x is 'oops'" in complaint(saved(table, tmp_path))


@pytest.mark.parametrize(("value", "how"), [(20.0, "repeats"), (3.0, "goes backwards")])
def test_time_must_increase(tmp_path: Path, value: float, how: str) -> None:
    table = driven()
    table.loc[1000, "time"] = value  # row 999 is at 20.0
    text = complaint(saved(table, tmp_path))
    assert f"time {how} at line 1002" in text
    assert "20 then" in text


def test_blank_time(tmp_path: Path) -> None:
    table = driven()
    table.loc[5, "time"] = np.nan
    assert "line 7: time is blank" in complaint(saved(table, tmp_path))


def test_half_filled_samples(tmp_path: Path) -> None:
    table = driven()
    table.loc[5, "accel_z"] = np.nan
    text = complaint(saved(table, tmp_path))
    assert "line 7" in text
    assert "accel_z is blank" in text


def test_infinite_numbers(tmp_path: Path) -> None:
    table = driven()
    table.loc[5, "gyro_x"] = np.inf
    assert "line 7: gyro_x is infinite" in complaint(saved(table, tmp_path))


def test_a_counter_without_its_worth(tmp_path: Path) -> None:
    table = driven().drop(columns="odo_speed").assign(odo_pulses=0)
    assert "metres_per_pulse" in complaint(saved(table, tmp_path))


def test_an_odometer_column_that_is_not_there(tmp_path: Path) -> None:
    assert "no column 'odo_pulses'" in complaint(saved(driven(), tmp_path, PULSES))


def test_a_mapped_column_that_is_not_there(tmp_path: Path) -> None:
    path = saved(driven(), tmp_path, VEHICLE + '[columns]\ngyro_x = "gyro_xx"\n')
    assert "'gyro_xx', which the vehicle file names for gyro_x; nearest is 'gyro_x'" in complaint(
        path
    )


def test_positions_that_are_none(tmp_path: Path) -> None:
    table = fixes(driven())
    table.loc[50, "gnss_lat"] = 4500.0
    assert "line 52" in complaint(saved(table, tmp_path))


@pytest.mark.parametrize("sd", [0.0, -1.0])
def test_deviations_that_are_none(tmp_path: Path, sd: float) -> None:
    text = complaint(saved(fixes(driven()).assign(gnss_sd_e=sd), tmp_path))
    assert "not above 0" in text


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "empty file"),
        (b"time,gyro_x\n1,2\n2,3\n", "no column"),
        (b"time;gyro_x\n1;2\n", "not separated by commas"),
        (b"time,gyro_x,gyro_x\n1,2,3\n", "occurs twice"),
        (bytes(range(256)), "cannot be read"),
    ],
)
def test_files_that_are_no_runs(tmp_path: Path, content: bytes, part: str) -> None:
    path = saved(driven(2), tmp_path)
    path.write_bytes(content)
    assert part in complaint(path)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda b: b.splitlines(keepends=True)[0], "no rows under the header"),
        (
            lambda b: b.replace(b"\n0.04,", b"\n0.04,9,9,", 1),
            "line 3 has 10 cells, the header has 8",
        ),
    ],
)
def test_broken_rows(tmp_path: Path, change: Callable[[bytes], bytes], part: str) -> None:
    path = saved(driven(2), tmp_path)
    path.write_bytes(change(path.read_bytes()))
    assert part in complaint(path)


def test_a_truncated_archive(tmp_path: Path) -> None:
    path = saved(driven(), tmp_path)
    archive = tmp_path / "run.csv.gz"
    archive.write_bytes(gzip.compress(path.read_bytes())[:-2000])
    assert "cannot be read" in complaint(archive)


def test_no_file(tmp_path: Path) -> None:
    saved(driven(2), tmp_path)
    with pytest.raises(InputError, match="no such run file"):
        read(tmp_path / "none.csv")


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
