"""Views are made by processes of their own: their errors are told in one line, none is left."""

from pathlib import Path

import pytest
import result_maker

from graphnav.common.errors import InputError
from graphnav.common.progress import Stages
from graphnav.views.views import IMPORTS, Views


@pytest.fixture
def result(tmp_path: Path) -> Path:
    return result_maker.write(tmp_path / "result", duration=120.0)


def test_all_views_of_a_result_are_made(result: Path) -> None:
    stages = Stages(show=False)
    alone = stages.peak_memory_mb
    with Views(list(IMPORTS)) as views:
        views.make(result, stages)
        stages.done()
    for name in ("run.rrd", "report.html"):
        assert (result / name).stat().st_size > 1000
    assert set(stages.seconds) == set(IMPORTS)
    assert stages.peak_memory_mb > alone + 50 * len(IMPORTS)


def test_what_a_view_misses_is_told_in_one_line(tmp_path: Path) -> None:
    with Views(["recording"]) as views, pytest.raises(InputError) as error:
        views.make(tmp_path, Stages(show=False))
    assert str(tmp_path) in str(error.value) and "\n" not in str(error.value)


def test_a_view_that_breaks_names_itself(result: Path) -> None:
    (result / "trajectory.parquet").write_bytes(b"no table")
    with Views(["recording"]) as views, pytest.raises(InputError) as error:
        views.make(result, Stages(show=False))
    assert "\n" not in str(error.value) and "trajectory.parquet" in str(error.value)
