"""Whether a change of the code changed results: the same runs smoothed before and after.

    python tools/same_results.py record OUT     # smooth every run with this checkout's code
    python tools/same_results.py compare A B    # largest difference of every table, by run

`record` simulates one run of each scenario (kept in OUT/runs; copy it to reuse it) and smooths
these and the runs of ../shared/data, two of them as a stream besides. `compare` ends with status 1
where a number differs by more than `--within` (absolute, 0: bit for bit).
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
RECORDED = ("kingston2008", "comma2k19", "husky", "sim_tracked", "sim_rlg", "sim_mimu")
SCENARIOS = {
    "tracked": ["tracked", "--ground", "soil"],
    "wheeled": ["wheeled", "--gnss", "--grade", "mems"],
    "slip": ["slip"],
    "rover": ["rover"],
    "field-tracked": ["field-tracked"],
    "field-wheeled": ["field-wheeled", "--gnss"],
    "field-skid": ["field-skid", "--gnss"],
}
STREAMED = ("wheeled", "comma2k19")
TABLES = ("trajectory", "dead_reckoning", "odometer", "trajectory_causal")


def graphnav(*words: str) -> None:
    """One command of this checkout's graphnav, whatever is installed; its complaint is shown."""
    subprocess.run(
        [sys.executable, "-m", "graphnav", *words],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
        stdout=subprocess.DEVNULL,
    )


def record(out: Path, data: Path) -> None:
    """Smooth every run into `out`."""
    runs = {name: next(data.glob(f"{name}/run.csv*")) for name in RECORDED}
    for name, words in SCENARIOS.items():
        where = out / "runs" / name
        if not where.exists():
            graphnav("simulate", *words, "--duration", "300", "--seed", "5", "--out", str(where))
        runs[name] = next(where.glob("run.csv*"))
    for name, run in runs.items():
        for mode in ("batch", "incremental") if name in STREAMED else ("batch",):
            result = out / f"{name}_{mode}"
            print(result, flush=True)
            graphnav("smooth", str(run), "--no-rrd", "--mode", mode, "--out", str(result))


def differences(a: Path, b: Path) -> dict[str, float]:
    """Largest difference of every table two results share; infinite where shapes differ."""
    found = {}
    for name in TABLES:
        paths = [x / f"{name}.parquet" for x in (a, b)]
        if not any(p.exists() for p in paths):
            continue
        if not all(p.exists() for p in paths):
            found[name] = np.inf
            continue
        one, other = (pd.read_parquet(p) for p in paths)
        numbers = one.select_dtypes("number").columns.difference(["latency_ms"])  # it is a time
        if one.shape != other.shape or list(one) != list(other):
            found[name] = np.inf
            continue
        x, y = one[numbers].to_numpy(), other[numbers].to_numpy()
        both = np.isnan(x) & np.isnan(y)
        found[name] = float(np.where(both, 0, np.abs(x - y)).max(initial=0))
    for name in ("states.csv", "events.csv", "calibration.json"):
        texts = [(x / name).read_text() if (x / name).exists() else "" for x in (a, b)]
        found[name] = 0.0 if texts[0] == texts[1] else _numbers_apart(*texts)
    return found


def _numbers_apart(a: str, b: str) -> float:
    """Largest difference of the numbers in two JSON texts; infinite where anything else differs."""
    try:
        one, other = (list(_leaves(json.loads(x))) for x in (a, b))
    except json.JSONDecodeError:
        return np.inf
    if len(one) != len(other):
        return np.inf
    pairs = list(zip(one, other, strict=True))
    if any(x != y for x, y in pairs if not isinstance(x, float) or not isinstance(y, float)):
        return np.inf
    return max((abs(x - y) for x, y in pairs if isinstance(x, float)), default=0.0)


def _leaves(x: object) -> object:
    if isinstance(x, dict):
        for key, value in x.items():
            yield key
            yield from _leaves(value)
    elif isinstance(x, list):
        for value in x:
            yield from _leaves(value)
    else:
        yield float(x) if isinstance(x, int) else x


def main() -> int:
    """The command."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    what = ask.add_subparsers(dest="what", required=True)
    one = what.add_parser("record")
    one.add_argument("out", type=Path)
    one.add_argument("--data", type=Path, default=DATA)
    two = what.add_parser("compare")
    two.add_argument("a", type=Path)
    two.add_argument("b", type=Path)
    two.add_argument("--within", type=float, default=0.0)
    asked = ask.parse_args()
    if asked.what == "record":
        record(asked.out, asked.data)
        return 0
    worst = 0.0
    for result in sorted(p for p in asked.a.iterdir() if (p / "trajectory.parquet").exists()):
        apart = differences(result, asked.b / result.name)
        worst = max(worst, *apart.values())
        print(
            f"{result.name:24s}", "  ".join(f"{k} {v:.2g}" for k, v in apart.items() if v) or "same"
        )
    return int(worst > asked.within)


if __name__ == "__main__":
    sys.exit(main())
