"""Result directories: whole or not at all, and nothing foreign is ever replaced."""

import errno
import os
import shutil
import time
from pathlib import Path

import pytest

from graphnav.common import replacing
from graphnav.common.errors import InputError
from graphnav.common.progress import Stages
from graphnav.result.writing import (
    MARKER,
    adopt,
    check_replaceable,
    default_out,
    kept_aside,
    own_files,
    whole_directory,
)


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
    for name in ("report.html", "export/trajectory.kml"):
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("made later")
        adopt(out, out / name)
    assert kept_aside(out) == []
    write(out, "new.parquet")
    assert {p.name for p in out.iterdir()} == {"new.parquet", MARKER}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


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


def test_what_is_not_graphnavs_in_a_result_is_kept_and_told(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for times in (1, 2):
        write(out)
        (out / "export").mkdir()
        (out / "export" / "notes.txt").write_text(f"mine {times}")
        (out / "summary.json").write_text("changed")
        (remark,) = kept_aside(out)
        assert "export/notes.txt and 1 more" in remark
    write(out, "new")
    assert {p.name for p in out.iterdir()} == {"new", MARKER}
    for times, name in ((1, "out_kept"), (2, "out_kept_2")):
        assert (tmp_path / name / "export" / "notes.txt").read_text() == f"mine {times}"
        assert (tmp_path / name / "summary.json").read_text() == "changed"


def test_a_copied_result_is_still_graphnavs(tmp_path: Path) -> None:
    write(tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "copy", copy_function=shutil.copyfile)
    assert kept_aside(tmp_path / "copy") == []


def test_a_marker_of_names_alone_is_understood(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out)
    (out / "run.rrd").write_text("made later")
    (out / MARKER).write_text('{"graphnav": "0.1", "files": ["summary.json"]}')
    write(out, "new")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_the_inputs_are_not_moved(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out)
    (out / "run.csv").write_text("time")
    with pytest.raises(InputError, match=r"run\.csv: lies in"):
        check_replaceable(out, (out / "run.csv", None))


def test_the_directory_one_stands_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    write(out)
    monkeypatch.chdir(out)
    write(Path("."), "new")
    assert Path("new").exists()
    assert Path.cwd() == out


def test_links_in_a_circle_and_full_disks_are_told(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match="out: cannot be found"):
        write(tmp_path / "a" / "out")
    full = pytest.raises(InputError, match=r"out: cannot be written: .*No space left")
    with full, whole_directory(tmp_path / "out"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not (tmp_path / "out").exists()


def test_where_no_result_can_be_put_is_told_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="name too long"):
        check_replaceable(tmp_path / ("x" * 250))  # short enough, but not for what it is made from
    (tmp_path / "out").mkdir()
    with monkeypatch.context() as patched, pytest.raises(InputError, match="is a mount"):
        patched.setattr(Path, "is_mount", lambda _: True)
        check_replaceable(tmp_path / "out")
    with monkeypatch.context() as patched, pytest.raises(InputError, match="may not be written"):
        patched.setattr(os, "access", lambda *_: False)
        check_replaceable(tmp_path / "out")


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    full = pytest.raises(InputError, match=r"a\.kml: cannot be written: No space left")
    with full, replacing.whole(tmp_path / "a.kml"):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_file_changed_since_is_named_where_it_breaks_what_reads_it(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out)
    with pytest.raises(KeyError), own_files(out):  # graphnav's own fault
        raise KeyError
    (out / "summary.json").write_text("[]")
    with pytest.raises(InputError, match=r"summary\.json: was changed since"), own_files(out):
        raise KeyError
    (out / MARKER).write_text('{"files": {"summary.json": {}}}')
    with pytest.raises(InputError, match="did not write"):
        check_replaceable(out)


def test_what_others_left_is_let_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"
    foreign = [tmp_path / ".out.part-elsewhere-1", tmp_path / f".out.old-{replacing.HOST}-1"]
    for path in foreign:  # of another host, and of a living process (init)
        path.mkdir()
    write(out)
    write(out)
    assert all(path.exists() for path in foreign)


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


def test_stages_add_up_and_print_nothing_in_a_pipe(capfd: pytest.CaptureFixture[str]) -> None:
    stages = Stages()
    for name in ("a", "b", "a"):
        stages(name)
        time.sleep(0.02)
    stages.done()
    assert list(stages.seconds) == ["a", "b"]
    assert stages.seconds["a"] >= 0.04
    assert capfd.readouterr() == ("", "")


def test_stages_see_the_memory_of_all_processes() -> None:
    with Stages(show=False) as stages:
        own = stages.peak_memory_mb
        stages.beside(30.0, 40.0)  # at a time
        stages.beside(50.0)
    assert stages.peak_memory_mb >= own + 70.0 > 71.0
