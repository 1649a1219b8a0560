"""The peers do what they are said to do: a short clean run brings each of them near the truth."""

import numpy as np
import pytest

pytest.importorskip("pyins")

from peer_methods import naive, plain_gtsam
from peers import Trial, begun, figures, fitted_heading

from graphnav.graph.preparation import prepare
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    out = tmp_path_factory.mktemp("peers") / "run"
    simulate("slip", out, 3, duration=120.0, gnss=True, grade="tactical", rate_hz=20)
    return Trial("slip", out / "run.csv.gz", out / "truth.csv.gz", out / "vehicle.toml")


def numbers(cell: str) -> list[float]:
    return [float(x) for x in cell.split(" / ")]


def test_every_method_comes_near_the_truth_of_a_clean_run(trial: Trial) -> None:
    vehicle = load_vehicle(trial.vehicle, trial.run)
    run, truth = read_run(trial.run, vehicle), read_truth(trial.truth)
    prep = prepare(run, vehicle, use_gnss=True, outages=())
    origin, heading = begun(truth), np.deg2rad(vehicle.start.heading_deg)
    rms, _ = numbers(figures(naive(run, heading, origin), truth, (), shift=True))
    assert rms < 10  # the odometer is up to 1.5 % off on 600 m
    fitted = fitted_heading(run, truth, origin)
    assert abs(np.angle(np.exp(1j * (fitted - heading)))) < np.deg2rad(2)
    rms, worst, z = numbers(figures(plain_gtsam(prep), truth, ()))
    assert rms < 5 and worst < 15 and 0.05 < z < 5


def test_errors_count_inside_the_outages_only(trial: Trial) -> None:
    truth = read_truth(trial.truth)
    own = truth[["time", "lat", "lon", "height"]].copy()
    own.loc[truth["time"] > 60, "lat"] += 1 / 111_130
    assert numbers(figures(own, truth, ((70.0, 80.0),)))[0] == pytest.approx(1.0, rel=0.01)
    assert numbers(figures(own, truth, ((10.0, 50.0),)))[0] == pytest.approx(0.0, abs=1e-6)
