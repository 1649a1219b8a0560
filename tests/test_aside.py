"""Calls in another process: results, errors and the end of it."""

import os
import signal
from pathlib import Path

import pytest

from graphnav.aside import Aside
from graphnav.errors import InputError, SolutionError


def test_a_result_comes_back() -> None:
    with Aside("graphnav.units:factor") as aside:
        aside.call("rate", "deg/s")
        assert aside.result() == pytest.approx(0.017453, rel=1e-4)
    assert aside.peak_memory_mb > 5


def test_a_users_error_comes_back_as_it_is() -> None:
    with Aside("graphnav.vehicle_file:load_vehicle") as aside, pytest.raises(InputError) as error:
        aside.call(None, Path("nowhere/run.csv"))
        aside.result()
    assert "\n" not in str(error.value)


def test_any_other_error_is_one_line() -> None:
    with Aside("graphnav.units:factor") as aside, pytest.raises(SolutionError) as error:
        aside.call("rate", "furlongs")
        aside.result()
    assert str(error.value).startswith("factor: ") and "\n" not in str(error.value)


def test_what_is_killed_is_told() -> None:
    with Aside("time:sleep") as aside, pytest.raises(SolutionError, match="sleep: ended with"):
        aside.call(60)
        os.kill(aside._process.pid, signal.SIGKILL)
        aside.result()


def test_no_process_outlives_its_context() -> None:
    with Aside("time:sleep") as waiting, Aside("time:sleep") as busy:
        busy.call(60)
    assert waiting._process.poll() is not None and busy._process.poll() is not None


def test_what_is_printed_does_not_garble_the_answer() -> None:
    with Aside("builtins:print") as aside:
        aside.call("noise")
        assert aside.result() is None
