"""The command as a user meets it: fast help, one line per failure, exit status."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from runs import VEHICLE, driven, saved, shared

from graphnav.cli import cli
from graphnav.cli.command import report_failures
from graphnav.common.errors import InputError, SolutionError

ROOT = Path(__file__).parents[1]


def run(capsys: pytest.CaptureFixture[str], *args: object) -> tuple[int, str, str]:
    """Status, stdout, stderr of `graphnav ARGS`."""
    status = report_failures(cli.cli, [str(arg) for arg in args])
    out, err = capsys.readouterr()
    return status, out, err


def refused(capsys: pytest.CaptureFixture[str], *args: object) -> str:
    """The one line that goes with exit status 2."""
    status, out, err = run(capsys, *args)
    assert (status, out, err.count("\n")) == (2, "", 1), err
    assert err.startswith("graphnav: ")
    return err


@pytest.mark.parametrize("command", ["", *cli.cli.commands])
def test_help_teaches(capsys: pytest.CaptureFixture[str], command: str) -> None:
    status, out, _ = run(capsys, *command.split(), "--help")
    assert status == 0
    assert "Usage: graphnav" in out
    assert max(map(len, out.splitlines())) <= 90


def test_help_is_fast_because_nothing_heavy_is_imported() -> None:
    code = (
        "import sys; from graphnav.cli import cli, command;"
        "command.report_failures(cli.cli, ['--help']);"
        "heavy = {'numpy', 'pandas', 'gtsam', 'rerun', 'pydantic', 'rich', 'scipy', 'pyarrow'};"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("args", "part"),
    [
        (["smoth"], "did you mean 'smooth'"),
        (["smooth"], "Missing argument 'RUN'"),
        (["smooth", "r.csv", "--vehicel", "v"], "--vehicle"),
        (["smooth", "r.csv", "--outage", "5"], "START:END"),
        (["smooth", "r.csv", "--outage", "6:5"], "START must come before END"),
        (["smooth", "r.csv", "--rate", "0"], "--rate"),
        (["smooth", "r.csv", "--mode", "btch"], "'batch', 'incremental'"),
        (["export", "x", "--to", "kmz"], "'kml'"),
        (["export", "x", "--to", "kml", "--at", "1,2"], "X,Y,Z"),
        (["compare", "none", "none"], "no such file"),
        (["simulate", "boat"], "tracked"),
        (["report", "none"], "no such directory"),
    ],
)
def test_options_at_fault(capsys: pytest.CaptureFixture[str], args: list[str], part: str) -> None:
    assert part in refused(capsys, *args)


def test_malformed_runs_end_with_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = saved(driven(20).drop(columns="gyro_z"), tmp_path)
    assert "no column 'gyro_z'" in refused(capsys, "smooth", path)
    path = saved(driven(20).assign(gyro_z=lambda t: np.rad2deg(t["gyro_z"])), tmp_path)
    assert "deg/s" in refused(capsys, "smooth", path)
    (tmp_path / "vehicle.toml").unlink()
    assert "vehicle.toml" in refused(capsys, "smooth", path)
    assert "no such run file" in refused(capsys, "smooth", tmp_path / "none.csv")
    assert not list(tmp_path.glob("*_graphnav"))


def test_a_foreign_directory_is_refused_before_the_work(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = saved(driven(20), tmp_path)
    (tmp_path / "run_graphnav").mkdir()
    (tmp_path / "run_graphnav" / "mine").touch()
    worked = "graphnav.graph.preparation.prepare"
    monkeypatch.setattr(worked, lambda *_, **__: pytest.fail("worked first"))
    assert "not replaced" in refused(capsys, "smooth", path)


@pytest.mark.parametrize(
    ("error", "status", "part"),
    [
        (InputError("a\nb"), 2, "a b"),
        (SolutionError("lost"), 1, "lost"),
        (RuntimeError("Indeterminate\nlinear system"), 1, "unexpected RuntimeError: Indeterminate"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (OSError(28, "No space left", "x.parquet"), 2, "x.parquet: No space left"),
    ],
)
def test_every_failure_is_one_line(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    status: int,
    part: str,
) -> None:
    def fails(_: object) -> None:
        raise error

    monkeypatch.delenv("GRAPHNAV_DEBUG", raising=False)
    monkeypatch.setattr("graphnav.views.show.open_viewer", fails)
    got, out, err = run(capsys, "show", "x")
    assert (got, out, err.count("\n")) == (status, "", 1)
    assert part in err


def test_debugging_shows_the_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setenv("GRAPHNAV_DEBUG", "1")
    monkeypatch.setattr("graphnav.views.show.open_viewer", fails)
    with pytest.raises(ZeroDivisionError):
        run(capsys, "show", "x")


def test_compare_for_people_and_machines(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    time_ = np.arange(0.0, 60.0, 0.1)
    table = driven(60, 10)[["time"]].assign(lat=45 + 1e-5 * time_, lon=10.0, height=1.0)
    table.to_csv(tmp_path / "trajectory.csv", index=False)
    table.assign(lat=table["lat"] + 1e-5).to_csv(tmp_path / "truth.csv", index=False)
    args = ("compare", tmp_path / "trajectory.csv", tmp_path / "truth.csv")
    status, out, _ = run(capsys, *args)
    assert status == 0
    assert "horizontal error, rms" in out
    status, out, _ = run(capsys, *args, "--json")
    assert status == 0
    assert json.loads(out)["horizontal_rms_m"] == pytest.approx(1.111, abs=0.002)


def test_check_tells_without_smoothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = saved(driven().assign(Speed=0), tmp_path, VEHICLE)
    status, out, _ = run(capsys, "check", path)
    assert status == 0
    assert "'Speed'" in out
    assert "1 finding" in out


def test_formats_offered_are_those_written() -> None:
    from graphnav.export import FORMATS

    assert set(cli.FORMATS) == set(FORMATS)


def test_a_shared_run_checks_clean(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "check", shared("sim_rlg"))
    assert (status, err) == (0, "")
    assert "0 finding" in out
