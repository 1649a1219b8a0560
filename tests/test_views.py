"""Views are made by processes of their own: their errors are told in one line, none is left."""

from pathlib import Path

import pytest
import result_maker

from graphnav.errors import SolutionError
from graphnav.progress import Stages
from graphnav.views import MADE, Views


@pytest.fixture
def result(tmp_path: Path) -> Path:
    return result_maker.write(tmp_path / "result", duration=120.0)


def test_all_views_of_a_result_are_made(result: Path) -> None:
    told = Stages(show=False)
    with Views(list(MADE)) as views:
        views.make(result, told)
        told.done()
    for name in MADE.values():
        assert (result / name).stat().st_size > 1000
    assert set(told.seconds) == set(MADE)
    assert min(told.memory_mb.values()) > 50


def test_what_a_view_misses_is_told_in_one_line(tmp_path: Path) -> None:
    with Views(["recording"]) as views, pytest.raises(SolutionError) as error:
        views.make(tmp_path, Stages(show=False))
    assert str(tmp_path) in str(error.value) and "\n" not in str(error.value)


def test_a_view_that_breaks_names_itself(result: Path) -> None:
    (result / "trajectory.parquet").write_bytes(b"no table")
    with Views(["recording"]) as views, pytest.raises(SolutionError) as error:
        views.make(result, Stages(show=False))
    assert "\n" not in str(error.value) and "trajectory.parquet" in str(error.value)


def test_a_view_that_was_killed_is_told(result: Path) -> None:
    with Views(["recording"]) as views, pytest.raises(SolutionError, match="recording"):
        next(iter(views._makers.values())).kill()
        next(iter(views._makers.values())).wait()
        views.make(result, Stages(show=False))


def test_no_process_outlives_its_run() -> None:
    with Views(list(MADE)) as views:
        makers = list(views._makers.values())
        assert all(maker.poll() is None for maker in makers)
    assert all(maker.poll() is not None for maker in makers)
