"""Are the deviations honest? Errors over sigma, pooled over seeds, with and without fixes.

    python tools/honesty.py                                  # every scenario, seeds 11-18, 600 s
    python tools/honesty.py field-skid tracked --seeds 1-4 --duration 300
    python tools/honesty.py field-wheeled --state fog        # the vehicle file states another grade

z is the root mean square of error over sigma, batch and causal (what a stream knew at the time), of
east and north and of the heading; 1 is ideal. `n` is how many independent samples it rests on,
found from the errors' own correlation: z is known to 1 / sqrt(2 n) of itself. `in 3` is the share
within 3 sigma. Asked: z between 0.8 and 1.25, 99 % within 3 sigma.
"""

import argparse
import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from normalised_errors import Array, independent, normalised
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table
from simulated_runs import add_options, run_of
from smoothed_runs import NoResult, smoothed

from graphnav.reading.truth import read_truth

SCENARIOS = ("tracked", "wheeled", "slip", "field-tracked", "field-wheeled", "field-skid", "rover")
WITHOUT_STREAM = ("rover",)
KINDS = ("position", "velocity", "heading")
LEAST, MOST, WITHIN = 0.8, 1.25, 0.99  # asked of z and of the share within 3 sigma
DURATION = 600.0  # s


def judged(directory: Path, use_gnss: bool, mode: str, grade: str | None) -> dict[str, Any]:
    """Normalised errors of one run, by mode and kind. Raises NoResult."""
    vehicle = directory / "vehicle.toml"
    with tempfile.TemporaryDirectory() as scratch:
        if grade:
            vehicle = restated(vehicle, grade, Path(scratch))
        fixes = () if use_gnss else ("--no-gnss",)
        result = smoothed(directory / "run.csv.gz", vehicle, "--mode", mode, *fixes)
    truth = read_truth(directory / "truth.csv.gz")
    found = {"batch": normalised(result.trajectory, truth, result.origin)}
    if result.causal is not None and len(result.causal) > 1:
        found["causal"] = normalised(result.causal, truth, result.origin)
    return found


def restated(vehicle: Path, grade: str, where: Path) -> Path:
    """The vehicle file with nothing but another grade said of the IMU, written into `where`."""
    text = re.sub(r"(?m)^(grade|gyro_|accel_)\S* *=.*\n", "", vehicle.read_text())
    other = where / "vehicle.toml"
    other.write_text(text.replace("[imu]\n", f'[imu]\ngrade = "{grade}"\n'))
    return other


def pooled(runs: list[Array]) -> dict[str, float]:
    """z, the independent samples behind it and the share within 3 sigma of all runs (n, k)."""
    together = np.concatenate([run.ravel() for run in runs])
    return {
        "z": float(np.sqrt(np.mean(together**2))),
        "n": float(sum(independent(run) for run in runs)),
        "within_3": float(np.mean(np.abs(together) <= 3)),
        "worst_run": float(max(np.sqrt(np.mean(run**2)) for run in runs)),
    }


def scenario(name: str, use_gnss: bool, options: argparse.Namespace) -> dict[str, Any]:
    """Pooled figures of a scenario by mode and kind, and the seeds that gave none."""
    runs: dict[str, dict[str, list[Array]]] = {}
    failed = []
    mode = "batch" if options.batch or name in WITHOUT_STREAM else "incremental"
    for seed in options.seeds:
        directory = run_of(options, name, seed)
        try:
            found = judged(directory, use_gnss, mode, options.state)
        except NoResult as error:
            failed.append(f"{seed}: {error}")
            continue
        for way, kinds in found.items():
            for kind, errors in kinds.items():
                if len(errors):
                    runs.setdefault(way, {}).setdefault(kind, []).append(errors)
    figures = {way: {k: pooled(v) for k, v in kinds.items()} for way, kinds in runs.items()}
    return {"figures": figures, "failed": failed}


def figured(figures: dict[str, Any]) -> str:
    """z of every kind in one line, for who waits."""
    each = (f"{way} {k} {f['z']:.2f}" for way, kinds in figures.items() for k, f in kinds.items())
    return ", ".join(each)


def row(table: Table, title: tuple[str, str, str], kinds: dict[str, Any]) -> None:
    """One line of the table; what is asked and not given is bold."""
    cells = []
    for kind in KINDS:
        if kind not in kinds:
            cells += ["", "", ""]
            continue
        f = kinds[kind]
        z = f"{f['z']:.2f}" if LEAST <= f["z"] <= MOST else f"**{f['z']:.2f}**"
        share = f"{100 * f['within_3']:.1f}"
        cells += [z, f"{f['n']:.0f}", share if f["within_3"] >= WITHIN else f"**{share}**"]
    table.add_row(*title, *cells)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=list(SCENARIOS), metavar="SCENARIO")
    add_options(parser, "11-18")
    parser.add_argument("--state", metavar="GRADE", help="say this of the IMU, and nothing else")
    parser.add_argument("--batch", action="store_true", help="leave out the stream")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    options.duration = options.duration or DURATION
    options.gnss = True
    table = Table(box=MARKDOWN)
    for title in ("scenario", "fixes", "", "position z", "n", "in 3 [%]"):
        table.add_column(title)
    for title in ("velocity z", "n", "in 3 [%]", "heading z", "n", "in 3 [%]"):
        table.add_column(title, justify="right")
    everything = {}
    for name in options.scenarios:
        for use_gnss in (True, False):
            if name == "rover" and use_gnss:
                continue  # has none
            fixes = "yes" if use_gnss else "no"
            found = everything[f"{name}, fixes: {fixes}"] = scenario(name, use_gnss, options)
            print(
                f"{name}, fixes: {fixes}: {figured(found['figures'])}", file=sys.stderr, flush=True
            )
            for way, kinds in found["figures"].items():
                row(table, (name, fixes, way), kinds)
            for said in found["failed"]:
                print(f"{name}, fixes: {fixes}: no result of seed {said}", file=sys.stderr)
    if options.json:
        print(json.dumps(everything, indent=1))
    else:
        Console(width=150).print(table)


if __name__ == "__main__":
    main()
