"""Run files that are malformed: one line with file, row, time, what is wrong and what to do."""

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import PULSES, VEHICLE, driven, fixes, saved

from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle


def read(path: Path) -> Run:
    return read_run(path, load_vehicle(None, path))


def complaint(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


def test_missing_column_names_the_likely_one(tmp_path: Path) -> None:
    text = complaint(saved(driven().rename(columns={"gyro_y": "gyroy"}), tmp_path))
    assert "no column 'gyro_y'" in text
    assert "'gyroy'" in text


def test_a_column_that_is_another_sensors_is_no_cure(tmp_path: Path) -> None:
    """A pitch gyro mapped as the upright one would be read without a word, and all be wrong."""
    text = complaint(saved(driven().drop(columns="gyro_z"), tmp_path))
    assert "no column 'gyro_z' (the heading needs gyro_z)" in text
    assert "gyro_x" not in text and "map it" not in text


def test_missing_time_shows_the_mapping(tmp_path: Path) -> None:
    text = complaint(saved(driven().rename(columns={"time": "timestamp"}), tmp_path))
    assert 'time = { name = "timestamp"' in text


def left_out(path: Path) -> tuple[Run, str]:
    """The run, and what it says of the one row that it lost."""
    run = read(path)
    assert run.imu is not None
    assert len(run.imu.time) == len(pd.read_csv(path, dtype=str)) - 1
    return run, next(note for note in run.notes if "left out" in note)


@pytest.mark.parametrize("word", ["abc", "1.2.3", "12 m/s", "1,5", "0x10", "12\x00"])
def test_text_in_a_number_costs_the_line(tmp_path: Path, word: str) -> None:
    table = driven().astype({"accel_y": object})
    table.loc[17, "accel_y"] = word
    _, note = left_out(saved(table, tmp_path))
    assert f"line 19: accel_y is '{word}'" in note


def test_text_in_many_numbers_names_line_and_column(tmp_path: Path) -> None:
    table = driven().astype({"accel_y": object})
    table.loc[17:60, "accel_y"] = "abc"
    assert "line 19: accel_y is 'abc', not a number (44 such lines of 3000" in complaint(
        saved(table, tmp_path)
    )


def test_text_far_down_a_large_file_is_found(tmp_path: Path) -> None:
    table = driven(1200, 100).astype({"gyro_x": object})
    table.loc[110_000, "gyro_x"] = "oops"
    _, note = left_out(saved(table, tmp_path))
    assert "line 110002: gyro_x is 'oops'" in note


@pytest.mark.parametrize("value", [20.0, 3.0, 1e9])
def test_a_time_astray_costs_the_row(tmp_path: Path, value: float) -> None:
    table = driven()
    table.loc[1000, "time"] = value  # row 999 is at 20.0
    _, note = left_out(saved(table, tmp_path))
    assert "line 1002" in note


def test_a_clock_that_begins_anew_or_is_set_back(tmp_path: Path) -> None:
    table = driven()
    again = table.assign(time=np.where(table.index < 1500, table["time"], table["time"] - 29.9))
    assert "line 1502: 30 then 0.12: the recording seems to begin anew" in complaint(
        saved(again, tmp_path)
    )
    set_back = table.assign(time=np.where(table.index < 1500, table["time"], table["time"] - 3))
    assert "seems to have been set back" in complaint(saved(set_back, tmp_path))


def test_rows_of_one_time_that_contradict(tmp_path: Path) -> None:
    table = driven()
    coarse = table.assign(time=np.round(table["time"], 1))
    text = complaint(saved(coarse, tmp_path))
    assert "time repeats at line" in text
    assert "too few decimals" in text


@pytest.mark.parametrize("column", ["time", "accel_z"])
def test_a_few_blank_cells_are_left_out_and_many_are_not(column: str, tmp_path: Path) -> None:
    table = driven()
    table.loc[5, column] = np.nan
    words = left_out(saved(table, tmp_path))[1]
    assert ("line 7" if column == "time" else column) in words
    table.loc[5:70, column] = np.nan
    text = complaint(saved(table, tmp_path))
    assert "line 7" in text
    assert f"{column} is blank" in text
    assert "leave the cell blank" not in text


def test_infinite_numbers_are_no_samples(tmp_path: Path) -> None:
    table = driven()
    table.loc[5, "gyro_x"] = np.inf
    run, _ = left_out(saved(table, tmp_path))
    assert any("'inf' (1)" in note for note in run.notes)


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


def test_values_out_of_range_are_no_samples(tmp_path: Path) -> None:
    table = fixes(driven())
    table.loc[50, "gnss_lat"] = 4500.0
    heading = np.where(table.index < 2000, -2e10, 30.0)
    run = read(saved(table.assign(gnss_sd_e=0.0, heading_deg=heading), tmp_path))
    assert run.gnss is not None and run.heading is not None
    assert len(run.gnss.time) == 59
    assert len(run.heading.time) == 1000
    np.testing.assert_array_equal(run.gnss.sd_enu[:, 0], 5.0)
    for words in ("gnss_lat is 4500", "heading_deg is -2e+10", "gnss_sd_e is 0"):
        assert any(words in note and "no sample" in note for note in run.notes)


def test_positions_in_another_unit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    table = fixes(driven())
    table["gnss_lat"] *= 107.0 + rng.random(len(table))
    assert "line 2: gnss_lat is" in complaint(saved(table, tmp_path))


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "empty file"),
        (b"time,gyro_x\n1,2\n2,3\n", "no column"),
        (b"time,gyro_x\n0,01,0,002\n0,02,0,001\n", "both decimal mark and separator"),
        (b"time;gyro_x\n1,001;0\n2,002;0\n", "may be a decimal comma or a mark of thousands"),
        (b"time;gyro_x\n1,1;0.1\n2,0;0.1\n", "both with decimal commas"),
        (b"x" * 300_000, "first line is longer than"),
        (",".join(f"c{i}" for i in range(5000)).encode(), "5000 columns"),
        (b"time,gyro_x,gyro_x\n1,2,3\n", "occurs twice"),
        (bytes(range(256)), "cannot be read"),
        (b"\n0.01,0,0\n0.02,0,0\n", "line 2 holds numbers where the columns' names"),
        (b'time,"' + b"x" * 140_000 + b'",gyro_y\n1,2,3\n', "1 rows under the header"),
    ],
)
def test_files_that_are_no_runs(tmp_path: Path, content: bytes, part: str) -> None:
    path = saved(driven(2), tmp_path)
    path.write_bytes(content)
    assert part in complaint(path)


@pytest.mark.parametrize("name", ["run.csv", "run.csv.gz", "run.parquet"])
def test_files_of_another_kind_than_their_name(tmp_path: Path, name: str) -> None:
    table = driven(2)
    saved(table, tmp_path)
    parquet, path = tmp_path / "a.parquet", tmp_path / name
    table.to_parquet(parquet)
    contents = {".csv": parquet.read_bytes(), ".gz": gzip.compress(parquet.read_bytes()),
                ".parquet": b"time,gyro_x\n1,2\n"}  # fmt: skip
    path.write_bytes(contents[path.suffix])
    assert "whatever its name says" in complaint(path)


def test_parquet_columns_that_are_no_plain_numbers(tmp_path: Path) -> None:
    table, path = driven(2), tmp_path / "run.parquet"
    clean = read(saved(table, tmp_path))
    table.assign(gyro_x=[[1.0]] * len(table)).to_parquet(path)
    assert "'gyro_x' holds list<element: double>" in complaint(path)
    table.assign(time=pd.to_timedelta(table["time"], unit="s").dt.round("us")).to_parquet(path)
    for dirty in (False, True):
        if dirty:
            words = table.drop(columns="odo_speed").assign(odo_speed="None")
            durations = pd.to_timedelta(table["time"], unit="s").dt.round("us")
            words.assign(time=durations).to_parquet(path)
        run = read(path)
        assert run.imu is not None and clean.imu is not None
        np.testing.assert_allclose(run.imu.time, clean.imu.time, rtol=0, atol=1e-9)
        assert any("read as seconds" in note for note in run.notes)


def test_a_header_alone(tmp_path: Path) -> None:
    path = saved(driven(2).iloc[:0], tmp_path)
    assert "no rows under the header" in complaint(path)


def test_lines_of_another_length(tmp_path: Path) -> None:
    path = saved(driven(2), tmp_path)
    text = path.read_text()
    path.write_text(text.replace("\n0.04,", "\n0.04,9,9,", 1))
    (note,) = (note for note in read(path).notes if "left out" in note)
    assert "line 3: it has 10 cells, the header has 8" in note
    path.write_text(text.replace("\n0.0", "\n0.0,9,9,"))
    assert "line 2: it has 11 cells, the header has 8 (4 such lines of 100" in complaint(path)


def test_a_truncated_archive(tmp_path: Path) -> None:
    path = saved(driven(), tmp_path)
    archive = tmp_path / "run.csv.gz"
    whole = gzip.compress(path.read_bytes())
    archive.write_bytes(whole[:-2000])
    run = read(archive)
    assert any("the archive is cut off" in note for note in run.notes)
    clean = read(path).imu
    assert run.imu is not None and clean is not None
    np.testing.assert_array_equal(run.imu.gyro, clean.gyro[: len(run.imu.gyro)])
    assert len(run.imu.time) > 0.9 * len(clean.time)
    archive.write_bytes(whole + bytes(1000))  # as copied from a device of blocks
    assert read(archive).notes == read(path).notes
    archive.write_bytes(whole + whole)
    assert "the recording seems to begin anew" in complaint(archive)
    damaged = bytearray(whole)
    damaged[-6] ^= 1
    archive.write_bytes(damaged)
    assert "the archive is damaged" in complaint(archive)
    archive.write_bytes(path.read_bytes())
    assert "is no gzip archive" in complaint(archive)


def test_no_file(tmp_path: Path) -> None:
    saved(driven(2), tmp_path)
    with pytest.raises(InputError, match="no such run file"):
        read(tmp_path / "none.csv")
