"""How long smoothing takes, stage by stage, and how much memory it needs.

    python tools/bench.py                             # the cases without a star
    python tools/bench.py 4000s-100hz 10h-100hz       # these; --list names all
    python tools/bench.py --gate                      # exit 1 where slower than the baseline
    python tools/bench.py --update                    # measure and keep as baseline

Every case runs through `graphnav.pipeline.smooth`, all outputs included, in a fresh process. Beside
it the same process times a fixed numpy workload: the gate compares seconds over that unit, so that
machines (and a machine's busy hours) compare. Runs are simulated once, into --cache.
"""

import argparse
import json
import operator
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CACHE = Path.home() / ".cache" / "graphnav"
BASELINE = Path(__file__).with_name("bench_baseline.json")
SEED = 1
TOLERANCE = 0.35  # slower than the baseline by this share, in units, fails
STAGE_TOLERANCE = 0.7  # single stages are short and jitter more
MEMORY_TOLERANCE = 0.25
LEAST_S = 0.15  # s; what is lost below it, at the baseline's speed, is noise

Measured = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One run and the way to smooth it; `spare` cases run only when named or with --all."""

    duration: float  # s
    imu_hz: int
    mode: str = "batch"
    gnss: bool = False
    kind: str = "tracked"
    nodes_hz: float = 1.0
    spare: bool = False


CASES = {
    "600s-100hz": Case(600.0, 100),
    "4000s-100hz": Case(4000.0, 100),
    "4000s-200hz": Case(4000.0, 200, spare=True),
    "4000s-200hz-gnss": Case(4000.0, 200, gnss=True),
    "4000s-100hz-incremental": Case(4000.0, 100, "incremental"),
    "4000s-200hz-incremental": Case(4000.0, 200, "incremental", spare=True),
    "3848s-wheeled": Case(3848.0, 100, kind="wheeled", spare=True),
    "3848s-wheeled-incremental": Case(3848.0, 100, "incremental", kind="wheeled"),
    "4000s-10hz-nodes": Case(4000.0, 100, nodes_hz=10.0, spare=True),
    "4000s-10hz-nodes-incremental": Case(4000.0, 100, "incremental", nodes_hz=10.0, spare=True),
    "10h-100hz": Case(36000.0, 100, spare=True),
    "10h-100hz-incremental": Case(36000.0, 100, "incremental", spare=True),
}


def run_of(case: Case, cache: Path) -> Path:
    """The case's run file, simulated where the cache does not hold it."""
    from graphnav.simulation import simulate

    fixes = "-gnss" if case.gnss else ""
    where = cache / f"bench-{case.kind}-{case.duration:.0f}s-{case.imu_hz}hz{fixes}-{SEED}"
    if not (where / "run.csv.gz").exists():
        chosen: dict[str, Any] = {"gnss": case.gnss, "rate_hz": case.imu_hz}
        simulate(case.kind, where, SEED, duration=case.duration, **chosen)
    return where / "run.csv.gz"


def measured(name: str, cache: Path) -> Measured:
    """One case in a fresh process."""
    case = CASES[name]
    run = run_of(case, cache)
    with tempfile.TemporaryDirectory(prefix="graphnav-bench-") as scratch:
        out = Path(scratch) / "result"
        how = [case.mode, str(case.nodes_hz), str(run), str(out)]
        command = [sys.executable, __file__, "--child", *how]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"bench: {name} failed: {done.stderr.strip().splitlines()[-1]}")
        figures = json.loads(done.stdout.splitlines()[-1])
        summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    stages = {"importing": figures["importing"]} | _merged(summary["stages"])
    solver = summary["solver"]
    keep = ("updates", "median_ms", "p99_ms", "first_thousand_ms", "last_thousand_ms")
    return {
        "seconds": round(figures["seconds"], 3),
        "unit": round(figures["unit"], 5),
        "nodes": solver["nodes"],
        "peak_memory_mb": summary["peak_memory_mb"],
        "stages": {k: round(v, 3) for k, v in stages.items()},
        "latency": {k: solver[k] for k in keep if k in solver},
    }


def _merged(
    stages: dict[str, float], join: Callable[[float, float], float] = operator.add
) -> dict[str, float]:
    """Rounds of one stage as one: added up, or what `join` makes of them."""
    total: dict[str, float] = {}
    for name, value in stages.items():
        kind = name.partition(",")[0]
        total[kind] = join(total.get(kind, 0.0), value)
    return total


def child(mode: str, nodes_hz: str, run: str, out: str) -> None:
    """What the fresh process does; one line of JSON to stdout."""
    before = workload()
    began = time.perf_counter()
    from graphnav.common.progress import Stages
    from graphnav.pipeline import SmoothOptions, smooth

    imported = time.perf_counter()
    quiet = Stages(show=False)
    smooth(Path(run), Path(out), SmoothOptions(mode=mode, nodes_hz=float(nodes_hz)), quiet)
    ended = time.perf_counter()
    figures = {"importing": imported - began, "seconds": ended - began}
    print(json.dumps(figures | {"unit": 0.5 * (before + workload())}))


def workload(repeats: int = 5) -> float:
    """Median seconds of a fixed task of the kind smoothing is made of: small matrices, one core."""
    import numpy as np

    rng = np.random.default_rng(0)
    R, x = rng.standard_normal((40_000, 3, 3)), rng.standard_normal(400_000)
    A = rng.standard_normal((400, 30, 20))
    took = []
    for _ in range(repeats):
        began = time.perf_counter()
        np.einsum("nij,njk->nik", R, R @ R)
        np.cumsum(np.sort(x))
        np.fft.rfft(x)
        np.linalg.qr(A)
        sum(float(matrix[0, 0]) for matrix in R)  # calls, as GTSAM gets them
        took.append(time.perf_counter() - began)
    return float(np.median(took))


def slower(now: dict[str, Measured], base: dict[str, Measured]) -> list[str]:
    """One line for everything that lost against the baseline beyond its tolerance."""
    lost = []
    for name in sorted(now.keys() & base.keys()):
        a, b = now[name], base[name]
        pairs = [("total", a["seconds"], b["seconds"], TOLERANCE)]
        both = a["stages"].keys() & b["stages"].keys()
        pairs += [(s, a["stages"][s], b["stages"][s], STAGE_TOLERANCE) for s in sorted(both)]
        for what, new, old, tolerance in pairs:
            then, here = old / b["unit"], new / a["unit"]
            if here > then * (1 + tolerance) and (here - then) * b["unit"] > LEAST_S:
                lost.append(f"{name}: {what} {here:.1f} units, baseline {then:.1f}")
        then, here = b["peak_memory_mb"], a["peak_memory_mb"]
        if here > then * (1 + MEMORY_TOLERANCE):
            lost.append(f"{name}: memory {here:.0f} MB, baseline {then:.0f}")
    return lost


def show(found: dict[str, Measured], base: dict[str, Measured]) -> None:
    """A column per case: seconds by stage, and what else was measured."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="seconds by stage", title_justify="left", header_style="bold")
    table.add_column("stage", no_wrap=True)
    for name in found:
        table.add_column(name.replace("-", "\n", 1), justify="right")
    for stage in dict.fromkeys(s for one in found.values() for s in one["stages"]):
        cells = (one["stages"].get(stage) for one in found.values())
        table.add_row(stage, *("" if c is None else f"{c:.2f}" for c in cells))
    table.add_section()
    table.add_row("[bold]all", *(f"[bold]{one['seconds']:.2f}" for one in found.values()))
    rows: dict[str, Callable[[str, Measured], str]] = {
        "ms a node": lambda name, one: f"{1e3 * one['seconds'] / one['nodes']:.2f}",
        "peak memory, MB": lambda name, one: f"{one['peak_memory_mb']:.0f}",
        "unit, ms": lambda name, one: f"{1e3 * one['unit']:.1f}",
        "units": lambda name, one: f"{one['seconds'] / one['unit']:.0f}",
        "baseline units": lambda name, one: (
            f"{base[name]['seconds'] / base[name]['unit']:.0f}" if name in base else ""
        ),
        "update p50, p99, ms": lambda name, one: _pair(one, "median_ms", "p99_ms"),
        "first, last 1000, ms": lambda name, one: _pair(
            one, "first_thousand_ms", "last_thousand_ms"
        ),
    }
    for label, cell in rows.items():
        table.add_row(label, *(cell(name, one) for name, one in found.items()))
    Console(width=30 + 14 * len(found)).print(table)


def _pair(one: Measured, first: str, second: str) -> str:
    latency = one["latency"]
    return f"{latency[first]:.1f}, {latency[second]:.1f}" if first in latency else ""


def kept(path: Path) -> dict[str, Measured]:
    """Cases of a file this tool wrote; none where there is no file."""
    if not path.exists():
        return {}
    return dict(json.loads(path.read_text(encoding="utf-8"))["cases"])


def write(found: dict[str, Measured], path: Path) -> None:
    """The cases and the machine they were measured on."""
    machine = f"{platform.machine()} {platform.system()}, Python {platform.python_version()}"
    content = {"machine": machine, "cases": found}
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Command line."""
    if sys.argv[1:2] == ["--child"]:
        child(*sys.argv[2:6])
        return
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help="see --list")
    parser.add_argument("--all", action="store_true", help="the long cases too")
    parser.add_argument("--list", action="store_true", help="name the cases")
    parser.add_argument("--gate", action="store_true", help="exit 1 where the baseline was faster")
    parser.add_argument("--update", action="store_true", help="keep what is measured as baseline")
    parser.add_argument("--repeat", type=int, default=1, help="keep the fastest of so many")
    parser.add_argument("--baseline", type=Path, default=BASELINE)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what is measured")
    parser.add_argument("--cache", type=Path, default=CACHE, help="of simulated runs")
    options = parser.parse_args()
    if options.list:
        print("\n".join(f"{name}{' *' if case.spare else ''}" for name, case in CASES.items()))
        return
    if unknown := set(options.cases) - CASES.keys():
        parser.error(f"no case {', '.join(sorted(unknown))}: choose from {', '.join(CASES)}")
    usual = [name for name, case in CASES.items() if options.all or not case.spare]
    base = kept(options.baseline)
    found = {
        name: min(
            (measured(name, options.cache) for _ in range(options.repeat)),
            key=lambda one: one["seconds"] / one["unit"],
        )
        for name in options.cases or usual
    }
    show(found, base)
    if options.json:
        write(found, options.json)
    if options.update:
        write({name: (base | found)[name] for name in CASES if name in base | found}, BASELINE)
    if options.gate:
        lost = slower(found, base)
        print("\n".join(lost) or "no slower than the baseline")
        raise SystemExit(bool(lost))


if __name__ == "__main__":
    main()
