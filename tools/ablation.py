"""What each step brings to a tracked run: from plain dead reckoning to the ground learnt.

    python tools/ablation.py run.csv.gz --truth truth.csv.gz

The same run is smoothed with three correction tables: every state taken as the odometer shows it,
the paper's constants held, the ground learnt; each once by least squares with the noise assumed, as
a filter would, and once as graphnav does, with robust weights and the noise found in the data.
Biases, scale, mounting and lever arm are estimated in all of them; GNSS is not used.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table

from factors.estimate import Estimate
from graphnav.batch.finish import finish
from graphnav.batch.smoother import Smoothed, smooth_batch
from graphnav.common.earth import Origin
from graphnav.common.errors import GraphnavError, InputError
from graphnav.common.run import Run
from graphnav.graph.densify import Path as Motion
from graphnav.graph.densify import densify
from graphnav.graph.elimination import covariances
from graphnav.graph.preparation import Prepared, params, prepare
from graphnav.graph.problem import build
from graphnav.graph.solve import gauss_newton
from graphnav.inertial.measured import measured
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.recognition.corrections import Correction, correction_table
from graphnav.result import trajectory
from graphnav.result.compare import compare

Corrections = dict[str, Correction]
FIGURES = {
    "horizontal_max_m": "max [m]",
    "horizontal_rms_m": "rms [m]",
    "horizontal_end_m": "end [m]",
    "permille_of_distance": "max/distance [permille]",
    "heading_rms_deg": "heading rms [deg]",
    "nees_horizontal": "NEES (2)",
}


def raw(table: Corrections) -> Corrections:
    """No correction: the odometer shows the forward speed in every state, nothing moves aside."""
    straight = table["straight_high"]

    def plain(row: Correction) -> Correction:
        return replace(
            row,
            factor=1.0,
            half_gauge=0.0,
            kappa=0.0,
            use_odometer=True,
            sigma_forward=straight.sigma_forward,
            sigma_lateral=straight.sigma_lateral,
        )

    return held({state: plain(row) for state, row in table.items()})


def held(table: Corrections) -> Corrections:
    """The constants as they stand, not learnt."""
    return {state: replace(row, factor_sd=0.0, kappa_sd=0.0) for state, row in table.items()}


def least_squares(prep: Prepared, reference: Smoothed) -> Smoothed:
    """The same graph without robust weights and with the noise as assumed, as a filter has it.

    Motion states and nodes are those of `reference`.
    """
    nodes = reference.problem.nodes
    at = _restarted(reference.estimate, prep)
    problem = build(prep, nodes, reference.timeline, at, {})
    solution = gauss_newton(problem.linearise, at, problem.order, {})
    found = covariances(solution.bayes_net, problem.order)
    path = densify(
        prep.sensed.inc, problem.pre, problem.nodes, solution.estimate, prep.setup.alignment.origin
    )
    return replace(
        reference,
        prep=prep,
        problem=problem,
        solution=solution,
        covariances=found,
        scales={},
        path=path,
    )


def _restarted(estimate: Estimate, prep: Prepared) -> Estimate:
    """An estimate with the calibrations of another table at their priors."""
    calibration = np.tile(prep.setup.layout.prior, (len(estimate.calibration), 1))
    calibration[:, :6] = estimate.calibration[:, :6]
    return replace(estimate, calibration=calibration)


def ablation(run: Run, vehicle: Vehicle, truth: DataFrame | None) -> dict[str, dict[str, Any]]:
    """Figures of every row; against the trajectory with learnt ground where there is no truth."""
    if vehicle.kind != "tracked" or run.odometer is None:
        raise InputError(f"{run.path}: the ablation needs a tracked vehicle with an odometer")
    table = correction_table(params(vehicle))

    def prepared(corrections: Corrections) -> Prepared:
        return prepare(run, vehicle, use_gnss=False, outages=(), table=corrections)

    learnt = smooth_batch(prepared(table))
    solved = {
        "least squares, raw odometer": least_squares(prepared(raw(table)), learnt),
        "least squares, paper's constants": least_squares(prepared(held(table)), learnt),
        "least squares, ground learnt": least_squares(learnt.prep, learnt),
        "robust, raw odometer": smooth_batch(prepared(raw(table))),
        "robust, paper's constants": smooth_batch(prepared(held(table))),
        "robust, ground learnt": learnt,
    }
    found = {k: DataFrame(trajectory.table(finish(s, run), 10.0)) for k, s in solved.items()}
    if truth is None:
        truth = found.pop("robust, ground learnt")[["time", "lat", "lon", "height"]]
    where = truth[["time", "lat", "lon", "height"]]
    reckoned = positions(learnt.reckoned, learnt.prep.setup.alignment.origin, run.clock_start)
    figures = {"dead reckoning": compare(reckoned, where).as_dict()}
    return figures | {name: compare(each, truth).as_dict() for name, each in found.items()}


def positions(path: Motion, origin: Origin, clock_start: float) -> DataFrame:
    """A path as a table of positions on the run's clock."""
    lat, lon, height = origin.geodetic(path.p_n)
    columns = {"lat": np.rad2deg(lat), "lon": np.rad2deg(lon), "height": height}
    return DataFrame({"time": path.time + clock_start} | columns)


def show(found: dict[str, dict[str, Any]], against: str) -> None:
    """The table, in Markdown."""
    table = Table(box=MARKDOWN)
    table.add_column(f"against {against}")
    for title in FIGURES.values():
        table.add_column(title, justify="right")
    for name, figures in found.items():
        values = [figures.get(key) for key in FIGURES]
        table.add_row(name, *("" if v is None else f"{v:.3g}" for v in values))
    Console(width=140).print(table)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--vehicle", type=Path, help="default: vehicle.toml beside the run")
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        vehicle = load_vehicle(options.vehicle, options.run)
        truth = read_truth(options.truth) if options.truth else None
        found = ablation(measured(read_run(options.run, vehicle)), vehicle, truth)
    except GraphnavError as error:
        raise SystemExit(f"ablation: {error}") from None
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        show(found, options.truth.name if options.truth else "the trajectory with learnt ground")


if __name__ == "__main__":
    main()
