"""Is dirty text read, and solved, as the clean run is? Every kind on drives of seeds to choose.

python tools/dirty_text.py --seeds 11-15              # what is read, to the bit or resolution
python tools/dirty_text.py --seeds 11-15 --smooth     # and the trajectory it is smoothed to
python tools/dirty_text.py --seeds 11 --kinds UTF-16 tabs
"""

import argparse
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import forked
import numpy as np
import pandas as pd
import simulated_runs
from dirty_kinds import KINDS, Kind, apart, rounded, text

from graphnav.common.run import Run
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle

SCENARIOS = ("wheeled", "tracked", "field-skid", "rover")
PATH_M = 1e-3  # that a path may differ where the clock is a microsecond's
READ_AS = ["e", "n", "u", "heading_deg"]


@dataclass
class Tally:
    """What came of one kind."""

    runs: int = 0
    exact: int = 0
    largest: float = 0.0  # difference of anything read
    path_m: float = 0.0
    bad: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Drive:
    """A simulated drive and what the plain file gives."""

    name: str
    table: pd.DataFrame
    vehicle: str
    folder: Path
    clean: Run
    path: pd.DataFrame | None


def main() -> int:
    """Print the table; 1 where a kind is read otherwise than the clean run, or is not told."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=simulated_runs.seeds, default=[0], help="3 or 11-15")
    parser.add_argument("--duration", type=float, default=60.0, help="s of the drives")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), metavar="KIND")
    parser.add_argument("--smooth", action="store_true", help="compare trajectories too")
    options = parser.parse_args()
    forked.warm()
    tallies = {name: Tally() for name in options.kinds}
    with tempfile.TemporaryDirectory(prefix="dirty-") as folder:
        for seed in options.seeds:
            for scenario in SCENARIOS:
                made = driven(Path(folder) / f"{scenario}-{seed}", scenario, seed, options)
                for name, tally in tallies.items():
                    if all(column in made.table for column in KINDS[name].needs):
                        judge(made, KINDS[name], tally, np.random.default_rng(seed))
    print(f"{'kind':<27}{'runs':>5}{'exact':>7}{'largest':>11}{'path m':>11}  wrong")
    for name, tally in tallies.items():
        print(f"{name:<27}{tally.runs:>5}{tally.exact:>7}{tally.largest:>11.2g}"
              f"{tally.path_m:>11.2g}  {len(tally.bad)} {'; '.join(tally.bad[:2])}")  # fmt: skip
    wrong = sum(len(tally.bad) for tally in tallies.values())
    print(f"{sum(tally.runs for tally in tallies.values())} files, {wrong} wrong")
    return int(wrong > 0)


def driven(folder: Path, scenario: str, seed: int, options: argparse.Namespace) -> Drive:
    """A drive of a seed, written plainly, read and smoothed."""
    call = ["simulate", scenario, "--out", folder, "--seed", seed, "--duration", options.duration]
    call += [] if scenario == "rover" else ["--gnss", "--rate", 50]
    ended = forked.start([str(word) for word in call]).ended()
    assert ended.status == 0, ended.error
    table = rounded(pd.read_csv(folder / "run.csv.gz"))
    path = folder / "plain" / "run.csv"
    vehicle = (folder / "vehicle.toml").read_text()
    clean = read_as(path, text(table), vehicle)
    smooth = smoothed(path) if options.smooth else None
    return Drive(f"{scenario} {seed}", table, vehicle, folder, clean, smooth)


def read_as(path: Path, content: str | bytes, vehicle: str) -> Run:
    """The run of these contents."""
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    (path.parent / "vehicle.toml").write_text(vehicle)
    return read_run(path, load_vehicle(None, path))


def smoothed(path: Path) -> pd.DataFrame:
    """The trajectory of a run file."""
    out = path.parent / "out"
    ended = forked.start(["smooth", path, "--no-rrd", "--out", out]).ended()
    assert ended.status in (0, 3), ended.error
    return pd.read_parquet(out / "trajectory.parquet", columns=READ_AS)


def judge(drive: Drive, kind: Kind, tally: Tally, rng: np.random.Generator) -> None:
    """Write, read and smooth a drive as this kind, and note what differs."""
    path = drive.folder / "dirty" / ("run.csv.gz" if kind.packed else "run.csv")
    tally.runs += 1
    try:
        run = read_as(path, kind.make(drive.table, rng), drive.vehicle + kind.vehicle)
    except Exception as error:
        tally.bad.append(f"{drive.name}: {error}")
        return
    largest = apart(drive.clean, run)
    tally.exact += largest == 0
    tally.largest = max(tally.largest, largest)
    if largest > kind.atol:
        tally.bad.append(f"{drive.name}: off by {largest:.2g}")
    if kind.told and not set(run.notes) - set(drive.clean.notes):
        tally.bad.append(f"{drive.name}: not told")
    if drive.path is not None:
        there = smoothed(path)
        off = np.abs(there - drive.path).to_numpy().max() if len(there) == len(drive.path) else 1e9
        tally.path_m = max(tally.path_m, float(off))
        if off > (PATH_M if kind.atol else 0.0):
            tally.bad.append(f"{drive.name}: path off by {off:.2g} m")


if __name__ == "__main__":
    raise SystemExit(main())
