"""A text table line by line, where pyarrow's own reading does not fit: what is whole is kept.

Comments and blank lines are passed over, cells beyond the header that are blank are cut; a line
that is neither is damaged and left out. Slower than pyarrow by a factor, so only tried second.
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import IO

import pyarrow as pa
import pyarrow.csv as pa_csv

from graphnav.common.errors import InputError
from graphnav.reading.dialect import COMMENTS, HEAD_BYTES, Dialect, is_aside

BETWEEN = "\x1f"  # ASCII's own unit separator: no cell holds it once the lines are taken apart


@dataclass
class Lines:
    """The lines of a table that can be taken apart, and what became of the others."""

    text: bytearray = field(default_factory=bytearray)  # UTF-8, cells joined by BETWEEN
    number: "array[int]" = field(default_factory=lambda: array("q"))  # in the file, from 1
    damaged: list[tuple[int, str]] = field(default_factory=list)  # number and what is wrong
    comments: int = 0
    cut: int = 0  # lines with blank cells beyond the header

    def keep(self, cells: str, number: int) -> None:
        """Another line; as bytes, since a str of each would take several times the file."""
        self.text += cells.encode("utf-8", errors="replace")
        self.text += b"\n"
        self.number.append(number)

    def notes(self) -> tuple[str, ...]:
        """What was passed over."""
        notes = []
        if self.comments:
            notes.append(f"{self.comments} comment lines passed over")
        if self.cut:
            notes.append(f"blank cells beyond the header cut off in {self.cut} lines")
        return tuple(notes)


def lines_of(stream: IO[str], dialect: Dialect, where: str) -> Lines:
    """The rows of `stream`, which `where` names. InputError on a line without an end."""
    kept = Lines()
    wanted, mark = len(dialect.names), dialect.separator
    for number, line in enumerate(_lines(stream, where), 1):
        if number <= dialect.skip:
            continue
        line = line.rstrip("\r\n")
        simple = mark != " " and '"' not in line and not line.startswith(COMMENTS)
        if simple and line.count(mark) == wanted - 1 and BETWEEN not in line:
            if not line.strip():
                continue  # one column, no cell
            kept.keep(line.replace(mark, BETWEEN), number)
        elif is_aside(line):
            kept.comments += bool(line.strip())
        else:
            _take_apart(line, number, wanted, dialect, kept)
    return kept


def _lines(stream: IO[str], where: str) -> Iterator[str]:
    while line := stream.readline(HEAD_BYTES):
        if len(line) == HEAD_BYTES:
            raise InputError(f"{where}: a line is longer than {HEAD_BYTES // 1024} kB: no table")
        yield line


def _take_apart(line: str, number: int, wanted: int, dialect: Dialect, kept: Lines) -> None:
    """One line that is not plain, into `kept` as far as it can be understood."""
    cells = dialect.cells(line)
    if len(cells) > wanted and not any(cells[wanted:]):
        kept.cut += 1
        cells = cells[:wanted]
    if len(cells) != wanted:
        kept.damaged.append((number, f"it has {len(cells)} cells, the header has {wanted}"))
        return
    kept.keep(BETWEEN.join(cell.replace(BETWEEN, " ") for cell in cells), number)


def columns_of(lines: Lines, width: int, wanted: Sequence[int]) -> list[pa.Array]:
    """Columns of the lines as text, by their place among `width`."""
    names = [str(i) for i in range(width)]
    if not lines.number:
        return [pa.array([], pa.string())] * len(wanted)
    table = pa_csv.read_csv(
        pa.BufferReader(memoryview(lines.text)[:-1]),
        pa_csv.ReadOptions(column_names=names, block_size=8 * HEAD_BYTES),
        pa_csv.ParseOptions(delimiter=BETWEEN, quote_char=False, ignore_empty_lines=False),
        pa_csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.string()),
            include_columns=[str(i) for i in wanted],
            strings_can_be_null=False,
        ),
    )
    return [table[str(i)].combine_chunks() for i in wanted]
