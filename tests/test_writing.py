"""Result directories: whole or not at all, and nothing foreign is ever replaced."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from graphnav.common.errors import InputError
from graphnav.common.progress import Stages
from graphnav.result.writing import MARKER, check_replaceable, default_out, whole_directory


def write(out: Path, name: str = "summary.json", text: str = "{}") -> None:
    with whole_directory(out) as part:
        (part / name).write_text(text)


def test_default_place() -> None:
    for name in ("run.csv", "run.csv.gz", "run.parquet"):
        assert default_out(Path("a") / name) == Path("a/run_graphnav")


def test_a_directory_appears_when_complete(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with whole_directory(out) as part:
        (part / "a").write_text("1")
        assert not out.exists()
    assert {p.name for p in out.iterdir()} == {"a", MARKER}
    assert [p.name for p in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_the_old_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    out = tmp_path / "out"
    write(out, text="old")
    with pytest.raises(error), whole_directory(out) as part:
        (part / "summary.json").write_text("new")
        raise error
    assert (out / "summary.json").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_earlier_result_is_replaced_whole(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, "old.parquet")
    (out / "report.html").write_text("made later")
    (out / "export").mkdir()
    (out / "export" / "trajectory.kml").write_text("made later")
    write(out, "new.parquet")
    assert {p.name for p in out.iterdir()} == {"new.parquet", MARKER}


def test_an_empty_directory_may_be_used(tmp_path: Path) -> None:
    write(tmp_path / "out")
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty")
    assert (tmp_path / "empty" / MARKER).exists()


def test_foreign_things_are_never_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years")
    with pytest.raises(InputError, match=r"thesis\.tex.*not replaced"):
        write(out)
    (out / "thesis.tex").rename(tmp_path / "summary.json")
    with pytest.raises(InputError, match="is a file"):
        check_replaceable(tmp_path / "summary.json")


def test_a_result_with_a_foreign_file_is_not_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out)
    (out / "notes").mkdir()
    (out / "notes" / "mine.txt").write_text("keep")
    with pytest.raises(InputError, match=r"mine\.txt"):
        write(out)
    assert (out / "notes" / "mine.txt").read_text() == "keep"


def test_a_forged_name_is_not_enough(tmp_path: Path) -> None:
    out = tmp_path / "run_graphnav"
    out.mkdir()
    (out / "summary.json").write_text('{"graphnav": 1}')
    with pytest.raises(InputError, match="did not write"):
        check_replaceable(out)


def test_links_are_followed_not_replaced(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    write(real)
    link.symlink_to(real)
    write(link, "new")
    assert link.is_symlink()
    assert (real / "new").exists()


KILLED = """
import sys, time
from pathlib import Path
from graphnav.result.writing import whole_directory
with whole_directory(Path(sys.argv[1])) as part:
    (part / "summary.json").write_text("{}")
    print("ready", flush=True)
    time.sleep(60)
"""


def test_a_killed_run_leaves_no_result_and_is_swept_up(tmp_path: Path) -> None:
    out = tmp_path / "out"
    root = str(Path(__file__).parents[1])
    command = [sys.executable, "-c", KILLED, str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=root, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGKILL)
    assert not out.exists()
    assert all(p.name.startswith(".out.part-") for p in tmp_path.iterdir())
    write(out)
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_stages_add_up_and_print_nothing_in_a_pipe(capfd: pytest.CaptureFixture[str]) -> None:
    stages = Stages()
    for name in ("a", "b", "a"):
        stages(name)
        time.sleep(0.02)
    stages.done()
    assert list(stages.seconds) == ["a", "b"]
    assert 0.04 <= stages.seconds["a"] < 1
    assert stages.peak_memory_mb >= max(stages.memory_mb.values()) > 1
    assert capfd.readouterr() == ("", "")


def test_stages_see_memory_of_each_stage() -> None:
    with Stages(show=False) as stages:
        stages("large")
        _ = b"x" * 200_000_000
        del _
        stages("small")
    assert stages.memory_mb["large"] > 190
    if os.access("/proc/self/clear_refs", os.W_OK):
        assert stages.memory_mb["small"] < stages.memory_mb["large"] - 100
