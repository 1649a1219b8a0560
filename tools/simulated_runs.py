"""Simulated runs for the other tools: chosen on the command line, kept in a cache."""

import argparse
import hashlib
from pathlib import Path

from graphnav import simulation
from graphnav.simulation import simulate

CACHE = Path.home() / ".cache" / "graphnav"
CHOICES = ("grade", "ground", "duration", "gnss", "rate_hz", "noise", "sampled", "vibration")


def seeds(text: str) -> list[int]:
    """`3`, `1,4,9` or `11-15`."""
    first, dash, last = text.partition("-")
    return list(range(int(first), int(last) + 1)) if dash else [int(s) for s in text.split(",")]


def add_options(parser: argparse.ArgumentParser, default_seeds: str) -> None:
    """What may be chosen of the runs; `gnss` is left to the tool."""
    parser.add_argument(
        "--seeds", type=seeds, default=seeds(default_seeds), help="3 or 1,4,9 or 11-15"
    )
    parser.add_argument("--ground", default="concrete", help="concrete or soil (tracked)")
    parser.add_argument("--grade", help="IMU: navigation, fog, tactical, mems")
    parser.add_argument("--duration", type=float, help="s; default: the scenario's")
    parser.add_argument("--rate", dest="rate_hz", type=int, default=100, help="Hz, of the IMU")
    parser.add_argument("--noise", type=float, default=1.0, help="over the IMU's data sheet")
    parser.add_argument(
        "--vibration", type=float, default=1.0, help="field: over the vehicle's own"
    )
    parser.add_argument("--sampled", action="store_true", help="IMU values of an instant")
    parser.add_argument("--without", action="append", default=[], help="field: leave an effect out")
    parser.add_argument("--cache", type=Path, default=CACHE)


def run_of(options: argparse.Namespace, scenario: str, seed: int) -> Path:
    """Directory of the simulated run of a seed, from the cache where it is there."""
    chosen = {name: getattr(options, name) for name in CHOICES}
    if not scenario.startswith("field-"):
        chosen["vibration"] = 1.0
    left_out = tuple(options.without) if scenario.startswith("field-") else ()
    settings = [f"{name}={value}" for name, value in chosen.items() if value]
    words = [scenario, str(seed), *settings, *(f"no-{effect}" for effect in left_out), simulator()]
    where: Path = options.cache / "_".join(words)
    if not (where / "run.csv.gz").exists():
        simulate(scenario, where, seed, without=left_out, **chosen)
    return where


def simulator() -> str:
    """A word that changes with the simulator's code: its runs are not another version's."""
    sources = sorted(Path(simulation.__file__).parent.glob("*.py"))
    return hashlib.sha1(b"".join(path.read_bytes() for path in sources)).hexdigest()[:8]
