"""Calls in another process: results, errors and the end of it."""

import os
import signal
from pathlib import Path
from pickle import PicklingError

import pytest

from graphnav.common.errors import InputError, SolutionError
from graphnav.common.worker_process import WorkerProcess


def test_a_result_comes_back() -> None:
    with WorkerProcess("graphnav.reading.units:factor") as aside:
        aside.call("rate", "deg/s")
        assert aside.result() == pytest.approx(0.017453, rel=1e-4)
    assert aside.peak_memory_mb > 5


def test_a_users_error_comes_back_as_it_is() -> None:
    with (
        WorkerProcess("graphnav.reading.vehicle_file:load_vehicle") as aside,
        pytest.raises(InputError) as error,
    ):
        aside.call(None, Path("nowhere/run.csv"))
        aside.result()
    assert "\n" not in str(error.value)


def test_any_other_error_comes_back_with_where_it_was() -> None:
    with (
        WorkerProcess("graphnav.reading.units:factor") as aside,
        pytest.raises(ValueError, match="furlongs") as e,
    ):
        aside.call("rate", "furlongs")
        aside.result()
    assert "in factor" in "".join(e.value.__notes__)


def test_what_is_killed_is_told() -> None:
    with (
        WorkerProcess("time:sleep") as aside,
        pytest.raises(SolutionError, match=r"sleep.*signal 9"),
    ):
        aside.call(60)
        os.kill(aside._process.pid, signal.SIGKILL)
        aside.result()


def test_a_process_that_leaves_is_told() -> None:
    with (
        WorkerProcess("sys:exit") as aside,
        pytest.raises(SolutionError, match=r"exit: .*status 3"),
    ):
        aside.call(3)
        aside.result()


def test_what_cannot_be_sent_is_told_and_nothing_hangs() -> None:
    with (
        WorkerProcess("time:sleep") as aside,
        pytest.raises((TypeError, AttributeError, PicklingError)),
    ):
        aside.call(lambda: None)
        aside.result()
    assert aside._process.poll() is not None


def test_a_talkative_process_does_not_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPROFILEIMPORTTIME", "1")
    with WorkerProcess("builtins:len", ("pandas",)) as aside:
        aside.call(bytes(3_000_000))
        assert aside.result() == 3_000_000


def test_what_lies_in_the_working_directory_is_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "graphnav.py").write_text("raise RuntimeError('mine')")
    monkeypatch.chdir(tmp_path)
    with WorkerProcess("graphnav.reading.units:factor") as aside:
        aside.call("rate", "deg/s")
        assert aside.result() > 0


def test_no_process_outlives_its_context() -> None:
    with WorkerProcess("time:sleep") as waiting, WorkerProcess("time:sleep") as busy:
        busy.call(60)
    assert waiting._process.poll() is not None and busy._process.poll() is not None


def test_what_is_printed_does_not_garble_the_answer() -> None:
    with WorkerProcess("builtins:print") as aside:
        aside.call("noise")
        assert aside.result() is None
