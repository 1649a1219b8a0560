"""Whatever a file or an option holds ends in one line with the cause; a truth costs itself only."""

import gzip
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import VEHICLE, driven, fixes, saved

from factors.block import Block
from graphnav.cli.cli import cli
from graphnav.cli.command import report_failures
from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.graph.contradiction import worst
from graphnav.reading import bounds
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result.compare import compare


def one_line(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    status = report_failures(cli, [str(a) for a in arguments])
    text = capsys.readouterr().err.strip()
    assert "unexpected" not in text
    assert len(text.splitlines()) == (status != 0)
    return status, text


@pytest.mark.parametrize(
    "options",
    [
        ("--rate", "nan"),
        ("--rate", "inf"),
        ("--nodes", "nan"),
        ("--lag", "nan"),
        ("--outage", "nan:nan"),
        ("--outage", "0:inf"),
        ("--truth", "/nowhere"),
        ("--vehicle", "/dev/null"),
        ("--out", "{}/loop/out"),
        ("--out", "{}/run.csv/out"),
        ("--out", "{}/" + "x" * 300),
        ("--out", ""),
        ("--out", "{}/\udcff"),
        ("--vehicle", "{}"),
        ("--truth", "{}/loop"),
        ("--lag", "1e308"),
    ],
)
def test_options_that_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, str]
) -> None:
    (tmp_path / "loop").symlink_to("loop")
    run = saved(driven(10), tmp_path)
    status, _ = one_line(capsys, "smooth", run, *(o.format(tmp_path) for o in options))
    assert status == 2


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000 + "]" * 5000,
        ".".join("a" * 20_000) + " = 1",
        VEHICLE.replace("45.0", "0x" + "f" * 5000),
        VEHICLE.replace("45.0", "9" * 4000),
        "[start]\nlat = " + "9" * 5000,
        VEHICLE.replace("45.0", "9" * 400),
        VEHICLE.replace("100.0", "1e300"),
        VEHICLE.replace("100.0", "nan"),
        "x" * 2_000_000,
        "\x00",
    ],
)
def test_vehicle_files_that_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    status, said = one_line(capsys, "check", saved(driven(10), tmp_path, text))
    assert status == 2
    assert str(tmp_path / "vehicle.toml") in said


def truth_of(table: pd.DataFrame) -> pd.DataFrame:
    time = table["time"].to_numpy()[::50]
    return pd.DataFrame({"time": time, "lat": 45.0, "lon": 10.0, "height": 100.0})


MISFITS: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], str]] = {
    "radians": (lambda t: t.assign(lat=np.deg2rad(t.lat), lon=np.deg2rad(t.lon)), "in radians"),
    "ms": (lambda t: t.assign(time=t.time * 1e3), "in ms"),
    "ms from 0": (lambda t: t.assign(time=(t.time - t.time.iloc[0]) * 1e3), "in ms"),
    "overlap": (lambda t: t.assign(time=t.time + 19.8), "they hardly meet"),
    "day": (lambda t: t.assign(time=t.time + 86400), "another day"),
    "cells": (lambda t: t.assign(lat="north"), "not a number"),
    "column": (lambda t: t.drop(columns="lon"), "no column 'lon'"),
}


@pytest.mark.parametrize("kind", MISFITS)
def test_a_truth_that_does_not_fit_costs_the_comparison(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    change, words = MISFITS[kind]
    table = driven(20, 20)
    run, truth = saved(fixes(table, 20), tmp_path), tmp_path / "truth.csv"
    change(truth_of(table)).to_csv(truth, index=False)
    status, _ = one_line(capsys, "smooth", run, "--truth", truth, "--no-rrd", "--nodes", "0.5")
    assert status in (0, 3)
    summary = json.loads((tmp_path / "run_graphnav" / "summary.json").read_text())
    (said,) = (w for w in summary["warnings"] if "not compared with truth" in w)
    assert words in said
    assert "comparison" not in summary


def test_a_truth_of_a_few_seconds_is_compared() -> None:
    long = pd.DataFrame({"time": np.arange(1000.0), "lat": 45.0, "lon": 10.0, "height": 0.0})
    assert compare(long, long.iloc[500:505]).horizontal_max_m == 0
    assert compare(long.iloc[500:505], long).horizontal_max_m == 0
    with pytest.raises(InputError, match="share no time"):
        compare(long, long.assign(time=long["time"] + 5000))


def test_what_does_not_fit_into_memory_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = saved(driven(20), tmp_path)
    packed = tmp_path / "run.csv.gz"
    packed.write_bytes(gzip.compress(run.read_bytes() + b"\n" * 50_000_000))
    monkeypatch.setattr(bounds, "free_memory", lambda: 5_000_000)
    with pytest.raises(InputError, match=r"would take .* GB of memory"):
        read_run(packed, load_vehicle(None, packed))
    monkeypatch.setattr(bounds, "free_memory", lambda: 60_000_000)
    monkeypatch.setattr(bounds, "_claimed", lambda path: 0)  # a tail that lies
    with pytest.raises(InputError, match="what it unfolds to"):
        read_run(packed, load_vehicle(None, packed))
    run = saved(driven(20), tmp_path)
    recorded = read_run_of(run, monkeypatch)
    monkeypatch.setattr(bounds, "free_memory", lambda: 5_000_000)
    with pytest.raises(InputError, match=r"solving 20 s with 10 nodes"):
        bounds.check_solution(recorded, "batch", 10.0, 1000.0)
    assert recorded.imu is not None  # stamps that come twenty at a time make no longer a run
    late = recorded.imu.time[
        np.minimum(np.arange(len(recorded.imu.time)) // 20 * 20 + 19, len(recorded.imu.time) - 1)
    ]
    late = late + 1e-9 * np.arange(len(late))
    bursts = replace(recorded, imu=replace(recorded.imu, time=late, dt=np.diff(late, prepend=0.0)))
    monkeypatch.setattr(bounds, "free_memory", lambda: 60_000_000)
    bounds.check_solution(bursts)


def read_run_of(path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.undo()
    return read_run(path, load_vehicle(None, path))


def test_a_time_far_from_all_others(tmp_path: Path) -> None:
    table = driven(20)
    table.loc[len(table) - 1, "time"] = 1e7
    run = read_run_of(saved(table, tmp_path), pytest.MonkeyPatch())
    assert run.end < 20
    assert any("further than all else" in note for note in run.notes)
    table = driven(20)
    table.loc[500:, "time"] += 1e7
    with pytest.raises(InputError, match="two runs in the file"):
        read_run_of(saved(table, tmp_path), pytest.MonkeyPatch())


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("Singular"), OverflowError("inf")])
def test_linear_algebra_that_breaks_down_names_the_sensor(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr("graphnav.batch.smoother.smooth_batch", broken)
    table = driven(20)
    table.loc[500:540, "gyro_z"] += 3.0
    status, said = one_line(capsys, "smooth", saved(table, tmp_path), "--no-rrd")
    assert status == 1
    assert "the IMU strays furthest from its usual" in said and "from 10." in said


def test_what_does_not_settle_is_named_with_span_and_cure() -> None:
    time = np.arange(100.0)
    residual = np.full((100, 2), 0.5)
    residual[40:50, 1] = 60.0
    small = Block("inertial", ("e", "n"), time, np.ones((100, 2)), ())
    large = Block("gnss", ("e", "n"), time, residual, ())
    text = worst([small, large], [np.ones((100, 2))] * 2)
    assert "the fixes (gnss, n): largest disagreement from 40.0 to 49.0 s" in text
    assert "--outage" in text


@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&- <&-"])
def test_closed_streams_are_no_failure(tmp_path: Path, closed: str) -> None:
    command = f"'{sys.executable}' -m graphnav check '{saved(driven(20), tmp_path)}' {closed}"
    assert subprocess.run(["sh", "-c", command], stdout=subprocess.DEVNULL).returncode == 0
