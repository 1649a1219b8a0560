"""Fixes as they are: late, at rest, between nodes."""

from dataclasses import replace

import pytest

from graphnav.common.run import Run
from graphnav.inertial.fix_delay import found_delay
from graphnav.inertial.increments import increments
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("f") / "run"
    simulate("wheeled", out, 31, duration=300, grade="tactical", gnss=True)
    path = out / "run.csv.gz"
    return read_run(path, load_vehicle(None, path))


@pytest.mark.parametrize("delay", [0.0, 0.1, -3.0, 5.0, 18.0])
def test_a_delay_is_found_before_the_solve(run: Run, delay: float) -> None:
    assert run.imu is not None and run.gnss is not None
    late = replace(run.gnss, time=run.gnss.time + delay)
    found = found_delay(increments(run.imu), run.odometer, late)
    # a small one is the graph's, as one more calibration
    assert found == pytest.approx(delay if abs(delay) > 0.3 else 0.0, abs=0.5)


def test_turns_alone_tell_a_long_delay(run: Run) -> None:
    assert run.imu is not None and run.gnss is not None
    late = replace(run.gnss, time=run.gnss.time + 18.0)
    assert found_delay(increments(run.imu), None, late) == pytest.approx(18.0, abs=1.0)
