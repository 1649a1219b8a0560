"""What robustness is worth on runs with slips: robust against plain least squares (methods D).

    python tools/robustness.py RUN.csv.gz [RUN.csv.gz ...]

Each run lies in a directory of `graphnav simulate slip`, with truth.csv.gz and
truth_calibration.json beside it. Velocity errors are told inside and outside the true episodes,
episodes by how many were reported and how many reports were false.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from graphnav.batch.finish import finish
from graphnav.batch.smoother import smooth_batch
from graphnav.common.run import Array
from graphnav.graph.preparation import Prepared, prepare
from graphnav.graph.robust_schedule import FINAL, FIRST, Weights
from graphnav.inertial.measured import measured
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import tables
from graphnav.result.solved import Solved

AROUND_S = 1.0  # an episode's ramps
PLAIN: tuple[Weights, Weights] = ({}, {})


@dataclass(frozen=True)
class Score:
    """Errors of one solution."""

    velocity_inside: float  # m/s, rms
    velocity_outside: float
    end: float  # m, horizontal
    found: int
    false: int


def main() -> None:
    """Print a line for every run and every way of weighting."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path)
    print(f"{'run':<12}{'weights':<9}{'v inside':>9}{'v outside':>10}{'end m':>8}  episodes false")
    for path in parser.parse_args().runs:
        vehicle = load_vehicle(None, path)
        prep = prepare(measured(read_run(path, vehicle)), vehicle, use_gnss=True, outages=())
        spans = _episodes(path.parent / "truth_calibration.json", prep.sensed.run.clock_start)
        for name, weights in (("plain", PLAIN), ("robust", (FIRST, FINAL))):
            s = score(prep, weights, path.parent / "truth.csv.gz", spans)
            print(
                f"{path.parent.name:<12}{name:<9}{s.velocity_inside:9.3f}{s.velocity_outside:10.4f}"
                f"{s.end:8.2f}  {s.found} of {len(spans)}   {s.false}"
            )


def score(
    prep: Prepared, weights: tuple[Weights, Weights], truth_path: Path, spans: Array
) -> Score:
    """Solve with the given weights and hold it against truth."""
    solved = finish(smooth_batch(prep, robust=weights), prep.sensed.run)
    t, error_v, error_p = _errors(solved, truth_path)
    inside = np.zeros(len(t), bool)
    for start, end in spans:
        inside |= (t > start - AROUND_S) & (t < end + AROUND_S)
    found_spans = [(e.start, e.end) for e in tables.slips(solved)]
    hit = [any(_meet(a, b) for b in spans) for a in found_spans]
    found = sum(any(_meet(a, b) for a in found_spans) for b in spans)
    speed = np.linalg.norm(error_v, axis=1)
    return Score(
        velocity_inside=float(np.sqrt(np.mean(speed[inside] ** 2))),
        velocity_outside=float(np.sqrt(np.mean(speed[~inside] ** 2))),
        end=float(np.hypot(*error_p[-1, :2])),
        found=found,
        false=len(found_spans) - sum(hit),
    )


def _meet(a: tuple[float, float] | Array, b: tuple[float, float] | Array) -> bool:
    return bool(a[0] < b[1] + AROUND_S and b[0] < a[1] + AROUND_S)


def _episodes(path: Path, clock: float) -> Array:
    """True episodes, (K, 2) s from the run's start."""
    events = json.loads(path.read_text(encoding="utf-8"))["events"]
    return np.array([(e["start"] - clock, e["end"] - clock) for e in events]).reshape(-1, 2)


def _errors(solved: Solved, truth_path: Path) -> tuple[Array, Array, Array]:
    """Times and errors of velocity and position in n, at truth's times."""
    truth = read_truth(truth_path)
    t = truth["time"].to_numpy() - solved.run.clock_start
    on = (t >= solved.path.time[0]) & (t <= solved.path.time[-1])
    truth, t = truth[on], t[on]
    _, v_n, p_n = solved.path.at(t)
    lat, lon = np.deg2rad(truth["lat"].to_numpy()), np.deg2rad(truth["lon"].to_numpy())
    where = solved.origin.local(lat, lon, truth["height"].to_numpy())
    level = solved.origin.level_axes(where)
    v = np.einsum("nij,nj->ni", level, v_n)
    return t, v - truth[["v_e", "v_n", "v_u"]].to_numpy(), p_n - where


if __name__ == "__main__":
    main()
