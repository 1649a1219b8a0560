"""Whenever a kill, a Ctrl-C or a full disk comes: the old or the new result, and every note."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from test_writing import write

from graphnav.common import replacing
from graphnav.common.errors import InputError
from graphnav.result.result_directory import load
from graphnav.result.writing import keep_in_result, restore, whole_directory


@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize("swaps", [True, False])
def test_a_kill_before_any_rename_leaves_old_or_new(tmp_path: Path, at: int, swaps: bool) -> None:
    out = tmp_path / "out"
    write(out, text="old")
    (out / "mine.txt").write_text("keep")
    pid = os.fork()
    if pid == 0:
        _die_before_rename(at, swaps)
        write(out, text="new")
        os._exit(0)
    os.waitpid(pid, 0)
    if not swaps:
        restore(out)
    assert (out / "summary.json").read_text() in ("old", "new")
    with pytest.raises(ValueError), whole_directory(out):  # a failing run puts right, too
        assert (out / "summary.json").read_text() in ("old", "new")
        raise ValueError
    write(out, text="next")
    assert (out / "summary.json").read_text() == "next"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out", "out_kept"]
    assert (tmp_path / "out_kept" / "mine.txt").read_text() == "keep"


def _die_before_rename(at: int, swaps: bool) -> None:
    """Kill this process before its `at`-th rename; without the exchange of names where asked."""
    left = [at]

    def dying(call: Callable[..., Any]) -> Callable[..., Any]:
        def last(*arguments: Any) -> Any:
            if not left[0]:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1
            return call(*arguments)

        return last

    exchange = replacing.exchange if swaps else lambda *_: False
    replacing.exchange = dying(exchange) if swaps else exchange
    os.rename, os.replace = dying(os.rename), dying(os.replace)


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_ctrl_c_between_exchange_and_tidying_costs_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
) -> None:
    out, put = tmp_path / "out", replacing.put
    write(out, text="old")
    (out / "mine.txt").write_text("keep")

    def interrupted(part: Path, to: Path) -> None:
        put(part, to)
        raise error

    monkeypatch.setattr(replacing, "put", interrupted)
    with pytest.raises(error):
        write(out, text="new")
    assert (out / "summary.json").read_text() == "new"
    assert (tmp_path / "out_kept" / "mine.txt").read_text() == "keep"


def test_what_cannot_be_kept_is_not_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    write(out, text="old")
    (out / ".graphnav_notes").write_text("keep")

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched, pytest.raises(InputError, match="cannot be moved to"):
        patched.setattr(replacing, "kept_beside", lambda *_: tmp_path / "m" / "kept")
        with whole_directory(out) as part:
            (part / "summary.json").write_text("new")
            patched.setattr(Path, "mkdir", full)
    assert (out / "summary.json").read_text() == "new"
    left = next(path for path in tmp_path.iterdir() if path.name.startswith(".out.part"))
    left.rename(tmp_path / f".out.part-{replacing.HOST}-4000000")  # as of a process that ended
    write(out, text="next")
    assert (tmp_path / "out_kept" / ".graphnav_notes").read_text() == "keep"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "out_kept"]


def test_whoever_reads_a_result_puts_back_what_a_kill_left(tmp_path: Path) -> None:
    out, hidden = tmp_path / "out", tmp_path / f".out.old-{replacing.HOST}-4000000"
    for read in (lambda: load(out), lambda: keep_in_result(out, "v.json", tmp_path / "r.csv", "")):
        write(out)
        out.rename(hidden)
        with suppress(InputError):  # a summary alone is no whole result
            read()
        assert (out / "summary.json").exists() and not hidden.exists()
    assert (out / "v.json").exists()


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
