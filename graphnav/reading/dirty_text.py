"""A text table line by line, where pyarrow's own reading does not fit: what is whole is kept.

Comments and blank lines are passed over, cells beyond the header that are blank are cut; a line
that is neither is damaged and left out. Slower than pyarrow by a factor, so only tried second.
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import IO

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading.dialect import HEAD_BYTES, Dialect, is_aside
from graphnav.reading.dirty_cells import Cells
from graphnav.reading.left_out import NAMED, LeftOut

BETWEEN = "\x1f"  # ASCII's own unit separator: no cell holds it once the lines are taken apart
BLOCK = 4 << 20  # characters that are taken apart at once
ODD, PLAIN, ASIDE = range(3)  # lines to be looked at one by one, to be cut, to be passed over
Kinds = NDArray[np.uint8]
Places = NDArray[np.intp]


@dataclass
class _Block:
    """Lines that can be taken apart, and what became of the others."""

    left_out: LeftOut
    text: bytearray = field(default_factory=bytearray)  # UTF-8, cells joined by BETWEEN
    number: "array[int]" = field(default_factory=lambda: array("q"))  # in the file, from 1

    def cells(self, dialect: Dialect, names: Sequence[str]) -> Cells:
        """Columns `names` of the lines."""
        columns = _columns(self, len(dialect.names), [dialect.names.index(name) for name in names])
        return Cells(dict(zip(names, columns, strict=True)), np.array(self.number, np.intp))


def cells_of(
    stream: IO[str], dialect: Dialect, names: Sequence[str], where: str, left_out: LeftOut
) -> Iterator[Cells]:
    """Columns `names` of the rows of `stream`, which `where` names, block by block; lines that are
    none are counted in `left_out`. InputError on a line without an end.
    """
    before = 0
    for text in _texts(stream, where):
        block = _Block(left_out)
        before += _take_all(text, before, dialect, block)
        yield block.cells(dialect, names)


def _texts(stream: IO[str], where: str) -> Iterator[bytes]:
    """The text in pieces of whole lines."""
    rest = ""
    while data := stream.read(BLOCK):
        whole, _, rest = (rest + data).rpartition("\n")
        if len(rest) > HEAD_BYTES:
            raise InputError(f"{where}: a line is longer than {HEAD_BYTES // 1024} kB: no table")
        if whole:
            yield f"{whole}\n".encode("utf-8", errors="replace")
    if rest:
        yield f"{rest}\n".encode("utf-8", errors="replace")


def _take_all(text: bytes, before: int, dialect: Dialect, block: _Block) -> int:
    """All lines of `text`, which follow so many `before`, into `block`; their count."""
    data = np.frombuffer(text, np.uint8)
    end = np.flatnonzero(data == ord("\n")) + 1
    start = np.concatenate([[0], end[:-1]])
    kind = _kinds(data, start, dialect)
    kind[: max(0, dialect.skip - before)] = ASIDE
    mark, between = dialect.separator.encode(), BETWEEN.encode()
    edges = [0, *(np.flatnonzero(np.diff(kind)) + 1).tolist(), len(kind)]
    for a, b in pairwise(edges):
        if kind[a] == PLAIN:
            block.text += text[start[a] : end[b - 1]].replace(mark, between)
            block.number.extend(range(before + a + 1, before + b + 1))
        elif kind[a] == ODD:
            for i in range(a, b):
                line = text[start[i] : end[i] - 1].decode("utf-8")
                _take_apart(line, before + i + 1, dialect, block)
    told = (kind == ASIDE) & (end - start > 1)
    block.left_out.comments += int(told[max(0, dialect.skip - before) :].sum())
    return len(kind)


def _kinds(data: Kinds, start: Places, dialect: Dialect) -> Kinds:
    """What is to be done with the lines (N,) of a text (UTF-8) that begin at `start`."""
    counts = np.add.reduceat(data == ord(dialect.separator), start, dtype=np.intp)
    strange = np.maximum.reduceat((data == ord('"')) | (data == ord(BETWEEN)), start)
    fits = (counts == len(dialect.names) - 1) & ~strange
    if dialect.separator == " " or len(dialect.names) == 1:  # runs of blanks, blank lines
        fits[:] = False
    first, second = data[start], data[np.minimum(start + 1, len(data) - 1)]
    aside = (first == ord("\n")) | (first == ord("#")) | (first == ord("%"))
    aside |= (first == ord("/")) & (second == ord("/"))
    return np.where(aside, ASIDE, np.where(fits, PLAIN, ODD)).astype(np.uint8)


def _take_apart(line: str, number: int, dialect: Dialect, block: _Block) -> None:
    """One line that is not plain, into `block` as far as it can be understood."""
    wanted, left_out = len(dialect.names), block.left_out
    if is_aside(line):
        left_out.comments += bool(line.strip())
        return
    cells = dialect.cells(line)
    if len(cells) > wanted and not any(cells[wanted:]):
        left_out.cut += 1
        cells = cells[:wanted]
    if len(cells) == wanted:
        text = BETWEEN.join(cell.replace(BETWEEN, " ") for cell in cells)
        block.text += f"{text}\n".encode()
        block.number.append(number)
        return
    why = [(number, f"it has {len(cells)} cells, the header has {wanted}")]
    left_out.damage(1, why if len(left_out.first) < NAMED else ())


def _columns(block: _Block, width: int, wanted: Sequence[int]) -> list[pa.Array]:
    """Columns of the lines as text, by their place among `width`."""
    names = [str(i) for i in range(width)]
    if not block.number:
        return [pa.array([], pa.string())] * len(wanted)
    table = pa_csv.read_csv(
        pa.BufferReader(memoryview(block.text)[:-1]),
        pa_csv.ReadOptions(column_names=names, block_size=8 * HEAD_BYTES),
        pa_csv.ParseOptions(delimiter=BETWEEN, quote_char=False, ignore_empty_lines=False),
        pa_csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.string()),
            include_columns=[str(i) for i in wanted],
            strings_can_be_null=False,
        ),
    )
    return [table[str(i)].combine_chunks() for i in wanted]
