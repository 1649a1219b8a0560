"""Broken run, vehicle and truth files and odd options through the command: does it keep its word?

    python tools/fuzz.py --minutes 5                 # as many as fit, from a seed of the clock
    python tools/fuzz.py --seed 70000 --count 2000   # seeds 70000 to 71999
    python tools/fuzz.py --seed 70123 --count 1 --keep /tmp/kept

Every input is a small simulated run with one to three things broken, in bytes or cells. The command
must end within a minute with status 0, 1, 2 or 3, with one line where that is not 0, without
"unexpected" and without more memory than twice a clean run's; where it fails nothing is written.
"""

import argparse
import gzip
import random
import re
import shutil
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import forked

SLOWEST_S = 60.0
ROOM_MB = 150.0  # that twice a small run's memory is allowed more: allocators differ
WORDS = (
    "", "nan", "None", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e9", "-1", "0", "1", "1e6",
    "99999999999999999999999", "0x10", "1,5", "1.5.2", "1e", '"', '""', "\x00", "\ufeff", "ÿ", "-",
    "2024-05-01T12:00:00Z", "12:00:00", "#N/A", "; ", "\t", "1e400", "٣", "true", "-20000000000",
    "= 1+1", "1_000", "+1", "١٢", "x" * 5000, "nan(ind)", "9" * 400, "1e15", "3.4e38", "65535",
)  # fmt: skip
VALUES = (
    "nan", "inf", "-inf", "1e308", "1e-308", "0", "-1", "true", '"x"', "[1, 2]", "[]", "{}",
    "1e9", "-1e9", "1e6", "1e-9", "9" * 5000, "9" * 400, "[" * 3000 + "]" * 3000, "1979-05-27",
    '"RFU"', '"FLU"', '"XYZ"', '"odo_pulses"', '"rover"', '"tracked"', '"wheeled"', "0x7f", '""',
    "[0.1, 0.2, 0.3]", "[1e300, 0, 0]", "[nan, 0, 0]", "90", "-90", "180", "1e-12", "1e12",
)  # fmt: skip
OPTIONS = (
    ("--rate", ("nan", "inf", "0", "-1", "1", "1000", "0.1", "1e99", "x", "")),
    ("--nodes", ("nan", "inf", "0", "0.2", "10", "5", "1e99", "x")),
    ("--outage", ("nan:nan", "inf:inf", "1:2", "2:1", "-1e300:1e300", "1", "1:2:3", ":", "x:y")),
    ("--mode", ("batch", "incremental", "x", "")),
    ("--lag", ("nan", "inf", "0", "1", "1e-9", "-1", "1e300")),
    ("--no-gnss", ()), ("--csv", ()), ("--report", ()), ("--nonsense", ()),
    ("--truth", ("/nowhere", "/dev/null", "/", ".", "")),
    ("--vehicle", ("/nowhere", "/dev/null", "/", "")),
)  # fmt: skip
SLOW_OPTIONS = ("incremental", "--report")  # each starts a process: rarely


@dataclass
class Input:
    """What is given to the command, in parts that are broken one by one."""

    run: bytes
    vehicle: bytes
    truth: bytes
    options: list[str] = field(default_factory=list)
    packed: bool = False


Breaking = Callable[[random.Random, Input], None]


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
        return forked.start(self._written(seed, given))

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
    arguments = ["simulate", kind, "--out", out, "--duration", "12", "--rate", "20"]
    arguments += [] if kind == "rover" else ["--gnss"]
    ended = forked.start(arguments).ended()
    assert ended.status == 0, ended.error
    run, truth = (gzip.decompress((out / f"{n}.csv.gz").read_bytes()) for n in ("run", "truth"))
    return Input(run, (out / "vehicle.toml").read_bytes(), truth)


def _bytes(rng: random.Random, data: bytes) -> bytes:
    """Some bytes flipped, cut, doubled, blanked or replaced."""
    if not data:
        return data
    a = rng.randrange(len(data))
    b = min(len(data), a + rng.choice((1, 2, 5, 50, 500, 5000)))
    noise = rng.choice((bytes(b - a), rng.randbytes(b - a), b'"', b",", b"\n", b"\r", b"\xff\xfe"))
    change = rng.randrange(6)
    if change == 0:
        return data[:a] + noise + data[b:]
    if change == 1:
        return data[:a]
    if change == 2:
        return data[:a] + data[b:]
    if change == 3:
        return data[:b] + data[a:]
    if change == 4:
        return rng.choice((b"", data[a:], data.replace(b"\n", b"\r"), data.replace(b",", b";")))
    return data.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-16-be", "utf-32")))


def _cells(rng: random.Random, data: bytes) -> bytes:
    """Some cells of a table replaced: one, a column of them, a stretch; rows moved or doubled."""
    rows = [line.split(",") for line in data.decode("utf-8", "replace").splitlines()]
    if len(rows) < 3 or len(rows[0]) < 2:
        return data
    i, j = rng.randrange(1, len(rows)), rng.randrange(len(rows[0]))
    change = rng.randrange(9)
    word = rng.choice(WORDS)
    if change == 0:
        rows[i][j % len(rows[i])] = word
    elif change == 1:
        _each(rows[1:], j, lambda _: word)
    elif change == 2:
        factor = 10.0 ** rng.choice((-300, -9, -3, -1, 1, 3, 6, 7, 9, 300))
        _each(rows[1:], j, lambda cell: _times(cell, factor))
    elif change == 3:
        _each(rows[i : i + rng.choice((2, 20, 200))], j, lambda _: word)
    elif change == 4:
        for row in rows:
            del row[j % len(row) :][:1]
    elif change == 5:
        rows[0][j] = rng.choice((rows[0][-1], word, rows[0][j].upper(), "time", "gyro_x"))
    elif change == 6:
        rng.shuffle(rows)
    elif change == 7:
        rows[i:i] = rows[max(1, i - rng.choice((1, 5, 50))) : i]
    else:
        del rows[i : i + rng.choice((1, 10, 100, 1000))]
    return "\n".join(",".join(row) for row in rows).encode("utf-8", "replace")


def _each(rows: Sequence[list[str]], j: int, change: Callable[[str], str]) -> None:
    for row in rows:
        if j < len(row):
            row[j] = change(row[j])


def _times(cell: str, factor: float) -> str:
    try:
        return f"{float(cell) * factor:.9g}"
    except ValueError:
        return cell


def _keys(rng: random.Random, text: bytes) -> bytes:
    """A value of a vehicle file replaced, a line left out, doubled or misspelt."""
    lines = text.decode("utf-8", "replace").splitlines() or [""]
    i = rng.randrange(len(lines))
    change = rng.randrange(5)
    if change <= 2:
        value = rng.choice(VALUES)
        lines[i] = re.sub(r"=.*", lambda _: f"= {value}", lines[i])
    elif change == 3:
        lines.insert(i, rng.choice((lines[rng.randrange(len(lines))], "[columns]", "[[imu]]",
                                    "a" * 10_000, 'gyro_x = { name = "accel_x" }')))  # fmt: skip
    else:
        lines[i] = lines[i].replace("e", rng.choice(("", "E", "3")), 1)
    return "\n".join(lines).encode()


def _option(rng: random.Random, given: Input) -> None:
    name, values = rng.choice(OPTIONS)
    words = [name, rng.choice(values)] if values else [name]
    if not set(words) & set(SLOW_OPTIONS) or rng.random() < 0.1:
        given.options += words


def _run_bytes(rng: random.Random, given: Input) -> None:
    given.run = _bytes(rng, given.run)


def _run_cells(rng: random.Random, given: Input) -> None:
    given.run = _cells(rng, given.run)


def _archive(rng: random.Random, given: Input) -> None:
    if not given.packed:
        given.run, given.packed = gzip.compress(given.run), True
    given.run = _bytes(rng, given.run)


def _bomb(rng: random.Random, given: Input) -> None:
    size = rng.choice((1, 100, 400)) << 20
    piece = rng.choice((b"\n", b",", b"0", b"0,0\n", given.run))
    given.run = gzip.compress(given.run + piece * (size // len(piece)), 1)
    given.packed = True


def _vehicle_keys(rng: random.Random, given: Input) -> None:
    given.vehicle = _keys(rng, given.vehicle)


def _vehicle_bytes(rng: random.Random, given: Input) -> None:
    given.vehicle = _bytes(rng, given.vehicle)


def _truth_cells(rng: random.Random, given: Input) -> None:
    given.truth = _cells(rng, given.truth)


def _truth_bytes(rng: random.Random, given: Input) -> None:
    given.truth = _bytes(rng, given.truth)


def _rarely(breaking: Breaking, otherwise: Breaking) -> Breaking:
    return lambda rng, given: (breaking if rng.random() < 0.01 else otherwise)(rng, given)


BREAKINGS: tuple[tuple[str, Breaking], ...] = (
    ("bytes of the run", _run_bytes),
    ("cells of the run", _run_cells),
    ("cells of the run", _run_cells),
    ("archive", _rarely(_bomb, _archive)),
    ("keys of vehicle", _vehicle_keys),
    ("keys of vehicle", _vehicle_keys),
    ("bytes of vehicle", _vehicle_bytes),
    ("cells of truth", _truth_cells),
    ("bytes of truth", _truth_bytes),
    ("options", _option),
)


if __name__ == "__main__":
    raise SystemExit(main())
