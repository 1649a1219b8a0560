"""Are the standard deviations honest? Errors over their own deviations, many simulated runs.

One sample per run (its end, its middle): within a run errors are one drift and no statistics. A
deviation may be too large by up to three (noise that is correlated is told with care), never too
small: the upper limit is chi-square's 99.9 %.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from graphnav.common.run import Array
from graphnav.pipeline import SmoothOptions, solve
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import trajectory
from graphnav.result.solved import Solved
from graphnav.simulation import simulate

SEEDS = range(41, 47)
MOST_PESSIMISTIC = 3.0  # deviation over error


@dataclass(frozen=True)
class Normalised:
    """Squared errors over their variances of one run at its middle and end, (2,) each."""

    position: Array  # 2 degrees of freedom
    heading: Array  # 1
    velocity: Array  # 3


def normalised(directory: Path) -> Normalised:
    """Smooth a simulated run and hold it against its truth."""
    run = directory / "run.csv.gz"
    vehicle = load_vehicle(None, run)
    solved = solve(read_run(run, vehicle), vehicle, SmoothOptions(rate_hz=100.0))
    table = pd.DataFrame(trajectory.table(solved, 100.0))
    truth = read_truth(directory / "truth.csv.gz").iloc[[1500, -20]]

    def own(name: str) -> Array:
        return np.interp(truth["time"], table["time"], table[name])

    e, n = (_position(solved, truth)[:, k] - own(name) for k, name in enumerate("en"))
    e, n, r = e / own("sd_e"), n / own("sd_n"), own("corr_en")
    turned = np.interp(truth["time"], table["time"], np.unwrap(table["heading_deg"], period=360.0))
    off = (turned - truth["heading_deg"].to_numpy() + 180) % 360 - 180
    v = [(own(f"v_{k}") - truth[f"v_{k}"].to_numpy()) / own(f"sd_v_{k}") for k in "enu"]
    return Normalised(
        position=(e * e - 2 * r * e * n + n * n) / (1 - r * r),
        heading=(off / own("sd_heading_deg")) ** 2,
        velocity=np.sum(np.square(v), axis=0),
    )


def _position(solved: Solved, truth: pd.DataFrame) -> Array:
    lla = np.deg2rad(truth["lat"]), np.deg2rad(truth["lon"]), truth["height"]
    return solved.origin.local(*(np.asarray(x) for x in lla))


@pytest.mark.parametrize(("scenario", "grade"), [("tracked", "tactical"), ("slip", None)])
def test_errors_fit_their_deviations(scenario: str, grade: str | None, tmp_path: Path) -> None:
    each = []
    for seed in SEEDS:
        directory = simulate(scenario, tmp_path / str(seed), seed, grade=grade, duration=300)
        each.append(normalised(directory))
    for name, dof in (("position", 2), ("heading", 1), ("velocity", 3)):
        sums = np.sum([getattr(found, name) for found in each], axis=0)
        freedom = dof * len(SEEDS)
        limit = float(chi2.ppf(0.999, freedom))
        assert (sums < limit).all(), f"{name}: too sure of itself, {sums} against {limit:.0f}"
        assert sums[-1] > freedom / MOST_PESSIMISTIC**2, f"{name}: far too modest, {sums}"
