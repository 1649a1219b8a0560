"""kill -9 at any moment, full disks and races: is the old or the new result whole every time?

    python tools/kills.py                       # 200 kills, 50 of them between renames
    python tools/kills.py --random 20 --forced 10 --races 2

A small simulated run is smoothed again and again into one directory that holds an older result and
a note of a user's. After each kill the directory must be whole (the old result or the new one), the
note must be there or kept, and the next run must end with 0 and leave nothing beside it.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import forked

from graphnav.common import replacing
from graphnav.result.writing import MARKER

NOTE = "kept by its user"


def main() -> int:
    """Print the table; 1 where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--random", type=int, default=150, metavar="N", help="kills at any moment")
    parser.add_argument("--forced", type=int, default=50, metavar="N", help="kills at renames")
    parser.add_argument("--races", type=int, default=10, metavar="N", help="of four at once")
    parser.add_argument("--full", type=int, default=10, metavar="N", help="full disks")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    forked.warm()
    found: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        place = Place(Path(folder))
        usual = place.smoothed().seconds
        rng = random.Random(options.seed)
        for kind, times, trial in (
            ("at any moment", options.random, lambda: place.killed_late(rng.uniform(0, usual))),
            ("before a rename", options.forced // 2, lambda: place.killed_at_rename(rng, True)),
            ("... in two steps", options.forced - options.forced // 2,
             lambda: place.killed_at_rename(rng, False)),
            ("file too large", options.full, lambda: place.full(rng)),
            ("race of four", options.races, place.race),
        ):  # fmt: skip
            found[kind] = Counter(trial() for _ in range(times))
            print(f"{kind:<18}{sum(found[kind].values()):>5}  {_words(found[kind])}", flush=True)
    return int(any(said.startswith("LOST") for each in found.values() for said in each))


def _words(counts: Counter[str]) -> str:
    return ", ".join(f"{said}: {count}" for said, count in counts.most_common())


class Place:
    """A run and the directory its result goes to."""

    def __init__(self, folder: Path) -> None:
        made = forked.start(["simulate", "wheeled", "--out", folder / "w", "--duration", "30"])
        assert made.ended().status == 0
        self.run, self.out = folder / "w" / "run.csv.gz", folder / "results" / "out"
        self.rate = 10

    def arguments(self) -> list[str | Path]:
        """Of a call whose result differs from the one before."""
        self.rate = 10 + (self.rate + 1) % 10
        return ["smooth", self.run, "--out", self.out, "--no-rrd", "--rate", str(self.rate)]

    def smoothed(self) -> forked.Ended:
        """An undisturbed call."""
        return forked.start(self.arguments()).ended()

    def reset(self) -> None:
        """An older result, with a user's note in it."""
        shutil.rmtree(self.out.parent, ignore_errors=True)
        assert self.smoothed().status in (0, 3)
        (self.out / "export").mkdir()
        (self.out / "export" / "note.txt").write_text(NOTE)

    def killed_late(self, after_s: float) -> str:
        """Killed after so many seconds."""
        self.reset()
        child = forked.start(self.arguments())
        with suppress(ProcessLookupError):  # it was quicker
            child.ended(after_s)
        return self.verdict(True)

    def killed_at_rename(self, rng: random.Random, swaps: bool) -> str:
        """Killed before or after one of the calls that rename."""
        self.reset()
        at, after = rng.randrange(4), rng.random() < 0.5
        forked.start(self.arguments(), lambda: dying(at, after, swaps)).ended()
        return self.verdict(swaps)

    def full(self, rng: random.Random) -> str:
        """No file may be longer than a few kilobytes: what a full disk does, at some file."""
        self.reset()
        most = rng.choice([600, 1000, 3000, 10_000, 30_000])

        def limit() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

        child = forked.start(self.arguments(), limit)
        ended = child.ended()
        lines = ended.error.strip().splitlines()
        if most < 3000 and (ended.status != 2 or len(lines) > 1 or str(self.out) not in lines[0]):
            return f"LOST its words: {ended.status} {ended.error[:200]!r}"
        return self.verdict(True)

    def race(self) -> str:
        """Four at once."""
        self.reset()
        children = [forked.start(self.arguments()) for _ in range(4)]
        ends = [child.ended() for child in children]
        bad = [end for end in ends if end.status not in (0, 3)]
        return f"LOST a race: {bad[0].error[:200]!r}" if bad else self.verdict(True)

    def verdict(self, stands: bool) -> str:
        """What is there, and whether the next run is clean. `stands`: without waiting for it, else
        for whoever reads the result next.
        """
        state = "whole" if self.out.exists() else "whole for the next command"
        if not stands:
            copy = self.run.with_name("trajectory.csv")
            read = forked.start(["export", self.out, "--to", "csv", "--file", copy]).ended()
            if read.status:
                return f"LOST to a reader: {read.error[:200]!r}"
        if not whole(self.out):
            return "LOST the result"
        failing = forked.start(["smooth", self.run, "--out", self.out, "--lag", "3"]).ended()
        ended = self.smoothed()
        if failing.status != 2 or ended.status not in (0, 3) or not whole(self.out):
            return f"LOST the next run: {ended.status} {ended.error[:200]!r}"
        there = sorted(path.name for path in self.out.parent.iterdir())
        if there not in (["out"], ["out", "out_kept"]):
            return f"LOST its order: {there}"
        notes = [path.read_text() for path in self.out.parent.rglob("note.txt")]
        return state if notes == [NOTE] else f"LOST the note: {there}"


def whole(directory: Path) -> bool:
    """Whether every file the marker lists is there in its length, and the summary can be read."""
    try:
        files = json.loads((directory / MARKER).read_text())["files"]
        json.loads((directory / "summary.json").read_text())
        return bool(files) and all((directory / n).stat().st_size == p[0] for n, p in files.items())
    except (OSError, ValueError):
        return False


def dying(at: int, after: bool, swaps: bool) -> None:
    """Have this process killed at its rename number `at`."""
    left = [at]

    def last(call: Callable[..., Any]) -> Callable[..., Any]:
        def renamed(*arguments: Any, **more: Any) -> Any:
            left[0] -= 1
            if left[0] == -1 and not after:
                os.kill(os.getpid(), signal.SIGKILL)
            done = call(*arguments, **more)
            if left[0] == -1:
                os.kill(os.getpid(), signal.SIGKILL)
            return done

        return renamed

    swap = last(replacing.exchange) if swaps else lambda *_: False
    replacing.exchange = swap
    os.rename, os.replace = last(os.rename), last(os.replace)


if __name__ == "__main__":
    raise SystemExit(main())
