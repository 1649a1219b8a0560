"""Broken run, vehicle and truth files and odd options through the command: does it keep its word?

    python tools/fuzz.py --minutes 5                 # as many as fit, from a seed of the clock
    python tools/fuzz.py --seed 70000 --count 2000   # seeds 70000 to 71999
    python tools/fuzz.py --seed 70123 --count 1 --keep /tmp/kept

Every input is a small simulated run with one to three things broken, in bytes or cells. The command
must end within a minute with status 0, 1, 2 or 3, with one line where that is not 0, without
"unexpected" and without more memory than twice a clean run's; where it fails nothing is written.
"""

import argparse
import random
import shutil
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import forked
import pandas as pd
from fuzz_breakings import BREAKINGS, Input

SLOWEST_S = 60.0
MOST_MB = 3000.0  # beyond the parent's: what takes more fails there, not the machine
ROOM_MB = 150.0  # that twice a small run's memory is allowed more: allocators differ


def main() -> int:
    """Print the table; 1 where the command broke its word."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, help="first seed  [default: the clock's]")
    parser.add_argument("--count", type=int, help="of inputs, instead of minutes")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="directory for inputs that broke it")
    options = parser.parse_args()
    seed = options.seed if options.seed is not None else int(time.time()) * 1000
    end = time.monotonic() + 60 * options.minutes
    seeds = iter(range(seed, seed + (options.count or 10**9)))
    forked.warm()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        bench = Bench(Path(folder), options.keep)
        print(f"a clean run: {bench.clean_mb:.0f} MB", flush=True)
        work(bench, seeds, options.jobs, lambda: options.count or time.monotonic() < end)
        print(bench.table())
    return int(any(bench.broken.values()))


def work(bench: "Bench", seeds: Iterator[int], jobs: int, go_on: Callable[[], object]) -> None:
    """Keep so many children busy until the seeds or the time end."""
    busy: list[tuple[int, forked.Child]] = []
    while True:
        while len(busy) < jobs and go_on() and (seed := next(seeds, None)) is not None:
            busy.append((seed, bench.start(seed)))
        if not busy:
            return
        seed, child = busy.pop(0)
        bench.judge(seed, child.ended(SLOWEST_S))


class Bench:
    """Clean inputs, and what came of the broken ones."""

    def __init__(self, folder: Path, keep: Path | None) -> None:
        self.folder, self.keep = folder, keep
        self.clean = [_simulated(folder / kind, kind) for kind in ("wheeled", "tracked", "rover")]
        self.kinds: dict[int, str] = {}
        self.ends: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self.broken: defaultdict[str, list[str]] = defaultdict(list)
        self.slowest: defaultdict[str, float] = defaultdict(float)
        self.largest: defaultdict[str, float] = defaultdict(float)
        self.clean_mb = 0.0
        for number, clean in enumerate(self.clean):
            ended = forked.start(self._written(-1 - number, clean)).ended()
            assert ended.status in (0, 3), ended.error
            self.clean_mb = max(self.clean_mb, ended.memory_mb)
            shutil.rmtree(self.folder / str(-1 - number))

    def start(self, seed: int) -> forked.Child:
        """The command on the input of a seed."""
        rng = random.Random(seed)
        clean = rng.choice(self.clean)
        given = Input(clean.run, clean.vehicle, clean.truth)
        kind, breaking = rng.choice(BREAKINGS)
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            breaking(rng, given)
        self.kinds[seed] = kind
        return forked.start(self._written(seed, given), memory_mb=MOST_MB)

    def _written(self, seed: int, given: Input) -> list[str | Path]:
        """The files of an input, and the arguments that name them."""
        place = self.folder / str(seed)
        place.mkdir()
        run = place / ("run.csv.gz" if given.packed else "run.csv")
        run.write_bytes(given.run)
        (place / "vehicle.toml").write_bytes(given.vehicle)
        (place / "truth.csv").write_bytes(given.truth)
        arguments: list[str | Path] = ["smooth", run, "--no-rrd", "--out", place / "out"]
        if "--truth" not in given.options:
            arguments += ["--truth", place / "truth.csv"]
        return [*arguments, *given.options]

    def judge(self, seed: int, ended: forked.Ended) -> None:
        """Count how a call ended, and note where it broke its word."""
        place, kind = self.folder / str(seed), self.kinds.pop(seed)
        self.ends[kind][str(ended.status)] += 1
        self.slowest[kind] = max(self.slowest[kind], ended.seconds)
        self.largest[kind] = max(self.largest[kind], ended.memory_mb)
        wrong = self._wrong(ended, (place / "out").exists())
        if wrong:
            words = f"seed {seed} ({kind}): {wrong}: {ended.error.strip()[-600:]}"
            self.broken[kind].append(words)
            print(words, flush=True)
            if self.keep is not None:
                shutil.copytree(place, self.keep / str(seed), dirs_exist_ok=True)
        shutil.rmtree(place, ignore_errors=True)

    def _wrong(self, ended: forked.Ended, written: bool) -> str | None:
        if ended.timed_out:
            return f"not done in {SLOWEST_S:g} s"
        if ended.status not in (0, 1, 2, 3):
            return f"status {ended.status}"
        if "unexpected" in ended.error or "Traceback" in ended.error:
            return "unexpected"
        if len(ended.error.strip().splitlines()) != (ended.status != 0):
            return "not one line"
        if written != (ended.status in (0, 3)):
            return "written though it failed" if written else "nothing written"
        if ended.memory_mb > 2 * self.clean_mb + ROOM_MB:
            return f"{ended.memory_mb:.0f} MB"
        return None

    def table(self) -> str:
        """How many inputs of each kind ended how."""
        lines = [f"{'broken':<18}{'inputs':>7}{'0':>7}{'1':>7}{'2':>7}{'3':>7}{'wrong':>7}"
                 f"{'slowest s':>11}{'most MB':>9}"]  # fmt: skip
        for kind, ends in sorted(self.ends.items()):
            counts = "".join(f"{ends[status]:>7}" for status in "0123")
            lines.append(
                f"{kind:<18}{sum(ends.values()):>7}{counts}{len(self.broken[kind]):>7}"
                f"{self.slowest[kind]:>11.1f}{self.largest[kind]:>9.0f}"
            )
        total = sum(sum(ends.values()) for ends in self.ends.values())
        return "\n".join([*lines, f"{total} inputs, {sum(map(len, self.broken.values()))} wrong"])


def _simulated(out: Path, kind: str) -> Input:
    """The first seconds of a drive and the last of the standing before it."""
    arguments = ["simulate", kind, "--out", out, "--duration", "140", "--rate", "20"]
    arguments += [] if kind == "rover" else ["--gnss"]
    ended = forked.start(arguments).ended()
    assert ended.status == 0, ended.error
    run, truth = (pd.read_csv(out / f"{n}.csv.gz", dtype=str) for n in ("run", "truth"))
    moved = truth["lat"] != truth["lat"].iloc[0]
    sets_off = float(truth["time"][moved.idxmax()])
    tables = (table[table["time"].astype(float).between(sets_off - 2, sets_off + 6)]
              for table in (run, truth))  # fmt: skip
    run, truth = (table.to_csv(index=False).encode() for table in tables)
    return Input(run, (out / "vehicle.toml").read_bytes(), truth)


if __name__ == "__main__":
    raise SystemExit(main())
