"""What becomes of a run with one fault: survived, covered, told, MISLED or SILENT.

    python tools/faults.py                      # every kind on every base run, seed 801
    python tools/faults.py --seeds 801-803 --only spike,lost --bases wheeled,tracked
    python tools/faults.py --part 1/4           # every fourth pair of kind and base, from the first
    python tools/faults.py --only lost_,late_,jitter,bursts,spike --factor 1.5 --slack 0

survived: the error is within 1.2 of the clean run's and 0.2 m. covered: within 3 of its own sigmas.
told: refused, or the findings name the cause. MISLED: another cause is named. SILENT: nothing is.
"unexpected" is a failure of the program itself, or of the solution without the cause.
"""

import argparse
import re
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import fault_kinds_clock
import fault_kinds_fixes
import fault_kinds_midrun
import fault_kinds_odometer
import fault_kinds_samples
import fault_kinds_users
import numpy as np
import pandas as pd
from fault_registry import FAULTS, Drive, Fault
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table
from simulated_runs import CACHE, run_of, seeds
from smoothed_runs import NoResult, Result, smoothed

from graphnav.reading.vehicle_file import load_vehicle

KINDS = (
    fault_kinds_samples, fault_kinds_clock, fault_kinds_odometer, fault_kinds_users,
    fault_kinds_fixes, fault_kinds_midrun,
)  # fmt: skip
BASES = {
    "wheeled": ("wheeled", "navigation", True),
    "mems": ("wheeled", "mems", True),
    "tracked": ("tracked", None, False),
    "slip": ("slip", None, False),
    "reversing": ("field-skid", None, True),
    "field-wheeled": ("field-wheeled", None, True),
    "field-tracked": ("field-tracked", None, False),
}
CLASSES = ("survived", "covered", "told", "MISLED", "SILENT", "unexpected")
FACTOR, SLACK, SIGMAS = 1.2, 0.2, 3.0


def main() -> None:
    """Print a table of kinds and what became of them on each base run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=seeds, default=seeds("801"))
    parser.add_argument("--bases", default=",".join(BASES))
    parser.add_argument("--only", default="", help="beginnings of names, by commas")
    parser.add_argument("--mode", default="batch", help="batch or incremental (judged causally)")
    parser.add_argument("--duration", type=float, default=300.0)
    parser.add_argument("--rate", dest="rate_hz", type=int, default=100)
    parser.add_argument("--part", default="1/1", help="K/N: of the pairs of kind and base")
    parser.add_argument("--factor", type=float, default=FACTOR, help="of clean: survived")
    parser.add_argument("--slack", type=float, default=SLACK, help="m beyond that: survived")
    options = parser.parse_args()
    chosen = [f for f in FAULTS.values() if f.name.startswith(tuple(options.only.split(",")))]
    bases = options.bases.split(",")
    found = {(f.name, base): list[str]() for f in chosen for base in bases}
    part, of = map(int, options.part.split("/"))
    for k, base in enumerate(bases):
        mine = [f for i, f in enumerate(chosen) if (i + k + 1 - part) % of == 0]
        for seed in options.seeds:
            _judge_all(mine, base, seed, options, found)
    _show(chosen, bases, found)


def _judge_all(
    chosen: list[Fault],
    base: str,
    seed: int,
    options: argparse.Namespace,
    found: dict[tuple[str, str], list[str]],
) -> None:
    """Every chosen kind on one run."""
    scenario, grade, gnss = BASES[base]
    usual = {"ground": "concrete", "noise": 1.0, "vibration": 1.0, "sampled": False, "without": []}
    asked = argparse.Namespace(
        **usual, grade=grade, gnss=gnss, duration=options.duration,
        rate_hz=options.rate_hz, cache=CACHE,
    )  # fmt: skip
    folder = run_of(asked, scenario, seed)
    truth = pd.read_csv(next(folder.glob("truth.csv*")))
    clean = smoothed(next(folder.glob("run.csv*")), folder / "vehicle.toml", "--mode", options.mode)
    best, z = errors(clean, truth)
    known = set(_said(clean))
    whole = drive_of(folder, truth)
    grade_ = clean.summary["quality"]["grade"]
    print(f"{base} {seed} clean: {grade_} ({best:.2f} m, z {z:.1f}) {_said(clean)}", flush=True)
    for fault in chosen:
        drive = replace(whole, table=whole.table.copy(), rng=np.random.default_rng(seed))
        if fault.needs and fault.needs not in drive.table:
            continue
        fault.spoil(drive)
        enough = options.factor * best + options.slack
        said = _became(fault, drive, truth, options.mode, (best, enough), known)
        found[fault.name, base].append(said)
        print(f"{base} {seed} {fault.name}: {said}", flush=True)


def drive_of(folder: Path, truth: pd.DataFrame) -> Drive:
    """A clean run, and where in it faults happen."""
    table = pd.read_csv(next(folder.glob("run.csv*")))
    vehicle = load_vehicle(folder / "vehicle.toml", folder)
    t, v = truth["time"].to_numpy(), np.hypot(truth["v_e"], truth["v_n"]).to_numpy()
    w = np.abs(np.gradient(np.unwrap(np.deg2rad(truth["heading_deg"])), t))
    middle = (t > 0.4 * t[-1]) & (t < 0.75 * t[-1])
    fast = np.flatnonzero(middle & (v > 0.5 * v[middle].max()))
    bend = fast[w[fast].argmax()]
    at = np.searchsorted(table["time"], [t[fast[0]], t[bend]]) + 1
    rate = 1 / float(np.median(np.diff(table["time"])))
    return Drive(
        table, (folder / "vehicle.toml").read_text(), np.random.default_rng(0),
        int(at[0]), int(at[1]), vehicle.odometer.metres_per_pulse or 0.0, rate, truth,
    )  # fmt: skip


def errors(result: Result, truth: pd.DataFrame) -> tuple[float, float]:
    """Horizontal rms error m, and rms of error over sigma, of what is judged."""
    path = result.trajectory if result.causal is None else result.causal
    lat, lon = np.deg2rad(truth["lat"].to_numpy()), np.deg2rad(truth["lon"].to_numpy())
    where = result.origin.local(lat, lon, truth["height"].to_numpy())
    t = truth["time"].to_numpy()
    path = path[(path["time"] >= t[0]) & (path["time"] <= t[-1])]
    at = path["time"].to_numpy()
    error = np.stack([path[k] - np.interp(at, t, where[:, i]) for i, k in enumerate("en")], -1)
    over = error / path[["sd_e", "sd_n"]].to_numpy()
    return float(np.sqrt((error**2).sum(1).mean())), float(np.sqrt((over**2).mean()))


def _said(result: Result) -> list[str]:
    """All that a result tells its user in words."""
    quality = result.summary.get("quality", {})
    words = [*result.summary["warnings"], *result.summary["verdicts"]]
    return [*words, *quality.get("why", []), *quality.get("remedy", [])]


def _became(
    fault: Fault,
    drive: Drive,
    truth: pd.DataFrame,
    mode: str,
    limits: tuple[float, float],
    known: set[str],
) -> str:
    """The class of a spoilt run, and its figures; `limits` m: the clean error, one survived."""
    best, enough = limits
    with tempfile.TemporaryDirectory() as scratch:
        run, vehicle = Path(scratch) / "run.csv", Path(scratch) / "vehicle.toml"
        drive.table.to_csv(run, index=False, float_format="%.12g")
        vehicle.write_text(drive.vehicle)
        try:
            result = smoothed(run, vehicle, "--mode", mode)
        except NoResult as failure:
            line = str(failure)
            names = re.search(fault.says, line.lower())
            refused = line.startswith("exit 2")
            return f"{('told' if names else 'MISLED') if refused else 'unexpected'} ({line[:90]})"
    error, over = errors(result, truth)
    figures = f"({error:.2f} m of {best:.2f}, z {over:.1f})"
    if error <= enough:
        return f"survived {figures}"
    if over < SIGMAS:
        return f"covered {figures}"
    new = [word for word in _said(result) if word not in known]
    if any(re.search(fault.says, word.lower()) for word in new):
        return f"told {figures}"
    return f"{'MISLED' if new else 'SILENT'} {figures} {new}"


def _show(chosen: list[Fault], bases: list[str], found: dict[tuple[str, str], list[str]]) -> None:
    """The table of classes, and how many of each."""
    table = Table("fault", *bases, box=MARKDOWN)
    total: Counter[str] = Counter()
    for fault in chosen:
        cells = []
        for base in bases:
            classes = Counter(said.split()[0] for said in found[fault.name, base])
            total += classes
            cells.append(", ".join(f"{k} {n}" if n > 1 else k for k, n in classes.items()))
        table.add_row(fault.name, *cells)
    Console(width=120).print(table)
    print("; ".join(f"{name} {total[name]}" for name in CLASSES))


if __name__ == "__main__":
    main()
