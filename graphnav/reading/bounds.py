"""What a file may ask of this machine, told before it is taken: size, columns, span, memory."""

import io
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from graphnav.common.errors import InputError
from graphnav.common.memory import free_memory
from graphnav.common.run import Imu, Run
from graphnav.reading.archive import Unfolding, is_archive

SHARE = 0.8  # of the free memory that a run may take
PER_BYTE = 1.2  # bytes held of a byte of text while pyarrow reads it
PER_CELL = 24  # bytes of a number while it is read: pyarrow's, numpy's and the scaled one
PER_ROW = 400  # bytes of an inertial sample on its way: increments, screening, reckoning
MOST_KNOWN = 64  # columns graphnav can use, at most
BURST = 200  # samples that a host may stamp together
READ_AT_ONCE = 4 << 20
LOOKED_AT = 16 << 20  # bytes unfolded to see how an archive that claims too much goes on
# bytes of a solution, measured by tools/bench.py: a node with its factors and covariances (batch,
# incremental), a second of the dense path, a row of the trajectory in its three forms
PER_NODE = {"batch": 47_000, "incremental": 90_000}
PER_SECOND, PER_WRITTEN = 24_000, 1000


def need(size: int, rows: int, columns: int) -> int:
    """Bytes of memory that `rows` rows of `size` bytes of text in all will take."""
    return int(PER_BYTE * size) + rows * (min(columns, MOST_KNOWN) * PER_CELL + PER_ROW)


def check_need(
    path: Path, needed: float, what: str, cure: str = "cut the file in parts, or thin its rows"
) -> None:
    """InputError when `what` asks for more memory than is free."""
    free = free_memory()
    if needed > SHARE * free:
        raise InputError(
            f"{path}: {what} would take {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are "
            f"free; {cure}"
        )


def check_solution(
    run: Run, mode: str = "batch", nodes_hz: float = 1.0, rate_hz: float = 10.0
) -> None:
    """InputError when the solution of a run will not fit into memory."""
    samples = 0.0 if run.imu is None else _bridged(run.imu)
    fixes = 0 if run.gnss is None else len(run.gnss.time)
    nodes = run.end * nodes_hz + fixes
    per_second = PER_SECOND + rate_hz * PER_WRITTEN
    needed = samples * PER_ROW + nodes * PER_NODE[mode] + run.end * per_second
    what = f"solving {run.end:.0f} s with {nodes_hz:g} nodes and {rate_hz:g} rows a second"
    check_need(run.path, needed, what, "smooth it in parts, or lower --nodes or --rate")


def _bridged(imu: Imu) -> float:
    """Samples there will be once those lost are bridged; stamps may come in bursts."""
    together = min(BURST, len(imu.time) - 1)
    if together < 1:
        return len(imu.time)
    spacing = float(np.median(imu.time[together:] - imu.time[:-together])) / together
    return max(len(imu.time), float(np.ptp(imu.time)) / spacing)


def check_text_size(path: Path, head: bytes, columns: int) -> None:
    """InputError when the file cannot be held; its rows are reckoned from its first ones."""
    density = _density(head)

    def needed(size: int) -> int:
        return need(size, int(size * density), columns)

    size = path.stat().st_size
    if is_archive(path):
        size = max(size, _claimed(path))
        if needed(size) > SHARE * free_memory():  # the claim of an archive that is cut off is noise
            size = _likely(path)
    check_need(path, needed(size), f"its {size / 1e6:.0f} MB of text")


def _density(head: bytes) -> float:
    """Rows in a byte of text."""
    return (head.count(b"\n") + 1) / max(len(head), 1)


def _claimed(path: Path) -> int:
    """Bytes that an archive says it unfolds to (its last four, modulo 4 GB)."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 4))
        tail = file.read(4)
    return int(struct.unpack("<I", tail)[0]) if len(tail) == 4 else 0


def _likely(path: Path) -> int:
    """Bytes that an archive unfolds to, if it goes on as it does after `LOOKED_AT` bytes."""
    seen, at = 0, [(0, 0.0)]
    with Unfolding(path) as stream:
        while seen < LOOKED_AT and (data := stream.read(READ_AT_ONCE)):
            seen += len(data)
            at.append((seen, stream.share))
        else:
            if seen < LOOKED_AT:
                return seen
    half = at[len(at) // 2]
    rate = (seen - half[0]) / max(at[-1][1] - half[1], 1e-9)
    return int(seen + rate * (1 - at[-1][1]))


@contextmanager
def opened(path: Path, columns: int) -> Iterator[Any]:
    """The text as a stream of bytes; what it will take is held against free memory: at once, or as
    an archive unfolds.
    """
    if is_archive(path):
        with Unfolding(path) as archive, _Counted(archive, path, columns) as stream:
            yield stream
    else:
        size = path.stat().st_size
        with path.open("rb") as file:
            rows = int(size * _density(file.read(READ_AT_ONCE)))
        check_need(path, need(size, rows, columns), f"its {size / 1e6:.0f} MB of text")
        with pa.OSFile(os.fsencode(path)) as stream:
            yield stream


def note_of(stream: Any) -> tuple[str, ...]:
    """What is to be told of a stream from `opened` that was read to its end."""
    return (f"{stream.path.name}: {stream.note}",) if getattr(stream, "note", "") else ()


class _Counted(io.RawIOBase):
    """An unfolding archive; InputError once it is more than fits."""

    def __init__(self, archive: Unfolding, path: Path, columns: int) -> None:
        self.path = path
        self._archive, self._columns = archive, columns
        self._size = self._rows = self._checked = 0

    @property
    def note(self) -> str:
        """How the archive ended, where it did not end well."""
        return self._archive.note

    def readable(self) -> bool:
        """It is."""
        return True

    def read(self, size: int = -1) -> bytes:
        """As a file's."""
        data = self._archive.read(size)
        self._size += len(data)
        self._rows += data.count(b"\n")
        if self._size - self._checked > READ_AT_ONCE:
            self._checked = self._size
            needed = need(self._size, self._rows, self._columns)
            check_need(self.path, needed, f"what it unfolds to ({self._size / 1e6:.0f} MB so far)")
        return data

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """As a file's."""
        data = self.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)
