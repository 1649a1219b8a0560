"""What tools/fuzz.py breaks, and how: bytes, cells, keys, archives and options."""

import gzip
import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

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
    piece = rng.choice((b"\n", b",", b"0", b"0,0\n", given.run or b"\n"))
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
