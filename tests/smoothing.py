"""The command on simulated runs, for tests: run it, read what it wrote."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from graphnav.cli import cli
from graphnav.cli.command import report_failures

QUICK = ("--no-rrd", "--no-report")
Table: TypeAlias = pd.DataFrame


def command(*args: object) -> int:
    """Exit status of `graphnav ARGS`."""
    return report_failures(cli.cli, [str(arg) for arg in args])


def smoothed(directory: Path, *args: object) -> Path:
    """The result directory of a simulated run."""
    [run] = directory.glob("run.csv*")
    [truth] = directory.glob("truth.csv*")
    out = directory / f"out{len(list(directory.glob('out*')))}"
    assert command("smooth", run, "--truth", truth, "--out", out, *args) == 0
    return out


def summary(result: Path) -> dict[str, Any]:
    return dict(json.loads((result / "summary.json").read_text()))


def trajectory(result: Path) -> Table:
    return pd.read_parquet(result / "trajectory.parquet")


def changed(
    source: Path,
    directory: Path,
    change: Callable[[Table], Table],
    vehicle: Callable[[str], str] = lambda text: text,
) -> Path:
    """A copy of a simulated run with its table or vehicle file changed."""
    change(pd.read_csv(source / "run.csv.gz")).to_csv(directory / "run.csv", index=False)
    (directory / "vehicle.toml").write_text(vehicle((source / "vehicle.toml").read_text()))
    (directory / "truth.csv.gz").write_bytes((source / "truth.csv.gz").read_bytes())
    return directory
