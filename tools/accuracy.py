"""How accurate, and how honest: simulated runs of several seeds, smoothed and held against truth.

    python tools/accuracy.py tracked --seeds 11-15 --ground soil
    python tools/accuracy.py wheeled --grade tactical --duration 1200 --json
    python tools/accuracy.py field-tracked field-wheeled field-skid --gnss

One line per seed and their median; the tables of README.md are made by it. Runs are kept in --cache
and simulated once. `NEES in bounds`: the mean squared normalised position error lies between the
95 % limits of a chi-square mean, with as many independent samples as the error's own correlation
leaves (an error that drifts for an hour is one sample, not 36,000).
"""

import argparse
import json
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from normalised_errors import independent, normalised
from pandas import DataFrame
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2
from simulated_runs import add_options, run_of

from graphnav.common.errors import GraphnavError
from graphnav.common.run import Array
from graphnav.inertial.measured import measured
from graphnav.pipeline import solve
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import trajectory
from graphnav.result.compare import compare
from graphnav.result.solved import Calibrated, Solved

SETTLED_S = 300.0  # wandering calibrations are judged after it
FIGURES = {
    "horizontal_max_m": "max [m]",
    "horizontal_rms_m": "rms [m]",
    "horizontal_end_m": "end [m]",
    "permille_of_distance": "max/dist. [permille]",
    "heading_rms_deg": "heading rms [deg]",
    "nees_horizontal": "NEES (2)",
    "nees_in_bounds": "in bounds",
    "nees_heading": "heading NEES (1)",
    "state_accuracy": "states right",
    "seconds": "smoothed in [s]",
}


def judged(directory: Path) -> dict[str, Any]:
    """Every figure of one run."""
    path = directory / "run.csv.gz"
    truth = read_truth(directory / "truth.csv.gz")
    vehicle = load_vehicle(None, path)
    run = measured(read_run(path, vehicle))
    began = time.perf_counter()
    solved = solve(run, vehicle)
    took = time.perf_counter() - began
    table = DataFrame(trajectory.table(solved, 10.0))
    found = compare(table, truth).as_dict() | {"seconds": took}
    errors = normalised(table, truth, solved.origin)
    found["independent_samples"] = samples = independent(errors["position"])
    low, high = chi2.ppf([0.025, 0.975], 2 * samples) / samples
    found["nees_in_bounds"] = bool(low <= found["nees_horizontal"] <= high)
    true = json.loads((directory / "truth_calibration.json").read_text())["calibration"]
    return found | {"calibration": calibration_errors(solved, true)}


def calibration_errors(solved: Solved, true: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """By name and component: RMS error after `SETTLED_S`, its mean square in own variances."""
    found = {}
    for c in solved.calibrated:
        for k, part in enumerate(c.components):
            known = true.get(c.name)
            if known is not None and part in known["components"]:
                curve = np.array(known["value"])[:, known["components"].index(part)]
                error, nees = _error(c, k, np.array(known["time"]), curve)
                seen = c.observable[k]
                found[f"{c.name} {part}"] = {"error": error, "nees": nees, "observable": seen}
    return found


def _error(c: Calibrated, k: int, time_: Array, curve: Array) -> tuple[float, float]:
    late = c.time >= SETTLED_S if c.time[-1] > SETTLED_S else c.time >= 0
    error = (c.value[:, k] - np.interp(c.time, time_, curve))[late]
    return float(np.sqrt(np.mean(error**2))), float(np.mean((error / c.sd[late, k]) ** 2))


def show(found: dict[str, dict[str, Any]], title: str) -> None:
    """Both tables, in Markdown."""
    keys = [k for k in FIGURES if any(f.get(k) is not None for f in found.values())]
    table = Table(box=MARKDOWN)
    table.add_column(title)
    for key in keys:
        table.add_column(FIGURES[key], justify="right")
    for seed, figures in found.items():
        table.add_row(seed, *(_cell(figures.get(key)) for key in keys))
    table.add_row("median", *(_middle([f.get(key) for f in found.values()]) for key in keys))
    console = Console(width=170)
    console.print(table)
    table = Table(box=MARKDOWN)
    for heading in ("calibration", "median rms error", "median NEES (1)", "observable"):
        table.add_column(heading)
    each = [f["calibration"] for f in found.values()]
    for name in each[0]:
        of = [c[name] for c in each if name in c]
        error, nees = (f"{median(c[key] for c in of):.3g}" for key in ("error", "nees"))
        table.add_row(name, error, nees, f"{sum(c['observable'] for c in of)} of {len(of)}")
    console.print(table)


def _middle(values: list[Any]) -> str:
    if all(isinstance(v, bool) for v in values):
        return f"{sum(values)} of {len(values)}"
    known = [v for v in values if v is not None]
    return _cell(median(known) if known else None)


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "" if value is None else f"{value:.3g}"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    known = "tracked, wheeled, slip, rover, field-tracked, field-wheeled, field-skid"
    parser.add_argument("scenarios", nargs="+", metavar="SCENARIO", help=known)
    add_options(parser, "11-15")
    parser.add_argument("--gnss", action="store_true", help="satellite fixes too")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    everything = {}
    for scenario in options.scenarios:
        found: dict[str, dict[str, Any]] = {}
        for seed in options.seeds:
            try:
                found[str(seed)] = judged(run_of(options, scenario, seed))
            except GraphnavError as error:
                print(f"accuracy: {scenario}, seed {seed}: {error}", file=sys.stderr)
        everything[scenario] = found
        if found and not options.json:
            show(found, f"{scenario} {options.grade or ''} {options.ground}")
    if options.json:
        print(json.dumps(everything, indent=1))


if __name__ == "__main__":
    main()
