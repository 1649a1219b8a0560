"""Run files that are malformed: one line with file, row, time, what is wrong and what to do."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
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
