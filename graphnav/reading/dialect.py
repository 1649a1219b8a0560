"""How a text table is written: encoding, separator, decimal mark, comments, where its rows begin.

Told from the file's first bytes alone; what can be read in two ways is refused, not guessed.
"""

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from graphnav.common.errors import InputError
from graphnav.reading.cell_words import is_blank, is_number, is_time

HEAD_BYTES = 256 * 1024  # enough for the longest header allowed and hundreds of rows
MOST_COLUMNS = 4096
COMMENTS = ("#", "%", "//")
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
LOOKED_AT = 100  # rows that tell separator and decimal mark
MOST_ABOVE = 500  # lines, comments among them, in which they must be found
COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
POINT = re.compile(r"[+-]?(\d+\.\d*|\.\d+)([eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
LINE_END = re.compile(r"\r\n|\n|\r")
MOST_DAMAGED = 0.01  # of the lines: a file with more is another kind of file, or ruined
CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")


@dataclass(frozen=True)
class Dialect:
    """How the text of a table is to be taken apart."""

    encoding: str
    separator: str  # " " stands for any run of blanks
    decimal: str
    skip: int  # lines above the first row
    names: tuple[str, ...]  # of every column, nameless ones included (as '')
    units: tuple[str, ...] = ()  # a row of units under the header
    notes: tuple[str, ...] = ()  # what is read otherwise than a plain file would be

    def cells(self, line: str) -> list[str]:
        """The cells of one line, without quotes and blanks around them."""
        if self.separator == " ":
            return line.split()
        if '"' in line:
            with suppress(csv.Error):  # a quote that is never closed
                return [c.strip() for c in next(csv.reader([line], delimiter=self.separator), [])]
        return [cell.strip() for cell in line.split(self.separator)]


def dialect_of(path: Path, head: bytes) -> Dialect:
    """The dialect of a file that begins with `head` (`HEAD_BYTES` at most).

    Raises `InputError` when the head is no table, or when it can be read in more than one way.
    """
    encoding = _encoding(head)
    text = _decoded(head, encoding)
    lines = LINE_END.split(text, maxsplit=MOST_ABOVE)
    if len(head) >= HEAD_BYTES or len(lines) > MOST_ABOVE:
        if len(lines) < 2:
            raise InputError(
                f"{path}: its first line is longer than {HEAD_BYTES // 1024} kB: not a table, or "
                "its lines do not end; save it as text with one row per line"
            )
        lines.pop()
    at = _header_line(path, lines)
    separator = _separator(lines[at])
    plain = Dialect(encoding, separator, ".", at + 1, ())
    names = [name.strip().strip('"') for name in plain.cells(_uncommented(lines[at]))]
    if not any(names):
        raise InputError(f"{path}: line {at + 1} names no column; the first line must name them")
    rows = [(i, row) for i, row in enumerate(lines[at + 1 :], at + 1) if not is_aside(row)]
    units: tuple[str, ...] = ()
    skip = at + 1
    if rows and _no_samples(cells := plain.cells(rows[0][1])):
        units, skip = tuple(cells), rows[0][0] + 1
        rows = rows[1:]
    table = [plain.cells(row) for _, row in rows[:LOOKED_AT]]
    decimal = _decimal(path, separator, table, len(names))
    extra = _trailing(table, len(names))
    check_columns(path, names)
    how = [*_read_as(encoding, separator, decimal), *_header_note(lines[at], at)]
    how += [f"line {skip} as units, not as samples"] * bool(units)
    how += ["blank cells at the end of lines"] * bool(extra or not names[-1])
    notes = (f"{path.name} is read with " + ", ".join(how),) if how else ()
    return Dialect(encoding, separator, decimal, skip, (*names, *[""] * extra), units, notes)


def is_aside(line: str) -> bool:
    """Whether a line is blank or a comment."""
    line = line.lstrip()
    return not line or line.startswith(COMMENTS)


def _encoding(head: bytes) -> str:
    """By its mark, by where its zero bytes stand, or by what does decode."""
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"),
                       (b"\xfe\xff", "utf-16")):  # fmt: skip
        if head.startswith(mark):
            return name
    first = head[:400]  # of plain ASCII every other byte is zero in UTF-16
    if first[1::2].count(0) > len(first) // 3:
        return "utf-16-le"
    if first[0::2].count(0) > len(first) // 3:
        return "utf-16-be"
    try:
        head[:-4].decode("utf-8")  # without the last, perhaps cut character
    except UnicodeDecodeError as error:
        # a damaged line further down is no reason to read all of it in another encoding
        return "cp1252" if b"\n" not in head[: error.start] else "utf-8"
    return "utf-8"


def _decoded(head: bytes, encoding: str) -> str:
    return head.decode(encoding, errors="replace").lstrip("\ufeff")


def _header_line(path: Path, lines: Sequence[str]) -> int:
    """Where the names stand: the first line that is no comment, or the comment right above it."""
    at = next((i for i, line in enumerate(lines) if not _before_header(line)), None)
    if at is None:
        raise InputError(f"{path}: empty file; the first line must name the columns")
    if CONTROL.search(lines[at]):
        raise InputError(f"{path}: cannot be read as text: its first line holds control characters")
    cells = re.split(r"[,;\t| ]+", lines[at].strip())
    if all(is_number(c) or is_blank(c) or is_time(c) for c in cells):
        above = next((i for i in range(at - 1, -1, -1) if lines[i].strip()), None)
        if above is not None and len(re.split(r"[,;\t| ]+", _uncommented(lines[above]))) > 1:
            return above
        if not all(c.isdigit() for c in cells):  # a program may name columns by their number
            raise InputError(
                f"{path}: line {at + 1} holds numbers where the columns' names are to be; write a "
                "line with them above it"
            )
    return at


def _before_header(line: str) -> bool:
    return is_aside(line) or bool(re.fullmatch(r"sep=.\s*", line))  # Excel's own first line


def _uncommented(line: str) -> str:
    return line.lstrip().lstrip("#%/").strip(" ") if is_aside(line) else line


def _separator(header: str) -> str:
    """The mark that stands most often between the names."""
    counts = {mark: header.count(mark) for mark in ",;\t|"}
    best = max(counts, key=lambda mark: counts[mark])
    if counts[best]:
        return best
    return " " if len(_uncommented(header).split()) > 1 else ","


def _no_samples(cells: Sequence[str]) -> bool:
    """Whether a row holds words alone, and more than a damaged one would: units."""
    words = [c for c in cells if c and not is_blank(c)]
    return len(words) > 1 and not any(is_number(c) or is_time(c) or COMMA.fullmatch(c)
                                      for c in words)  # fmt: skip


def _decimal(path: Path, separator: str, table: Sequence[Sequence[str]], columns: int) -> str:
    """'.' or ','. Raises InputError where the rows do not tell which."""
    wide = sum(len(row) >= max(2 * columns - 2, columns + 2) and all(row) for row in table)
    if separator == "," and columns > 1 and wide > len(table) / 2:
        raise InputError(
            f"{path}: the header has {columns} cells, the rows {len(table[0])}: commas seem to be "
            "both decimal mark and separator; save it with ';' between the columns"
        )
    cells = [cell for row in table for cell in row]
    commas = [cell for cell in cells if COMMA.fullmatch(cell)]
    if not commas:
        return "."
    points = sum(bool(POINT.fullmatch(cell)) for cell in cells)
    few = MOST_DAMAGED * (len(commas) + points)
    if len(commas) <= few:
        return "."  # the lines they stand in are damaged
    if points > few:
        raise InputError(
            f"{path}: numbers are written both with decimal commas ('{commas[0]}') and with "
            "decimal points; save it with one of them"
        )
    if all(THOUSANDS.fullmatch(cell) for cell in commas):
        raise InputError(
            f"{path}: '{commas[0]}' may be a decimal comma or a mark of thousands, and no number "
            "tells which; save it with decimal points"
        )
    return ","


def _trailing(table: Sequence[Sequence[str]], columns: int) -> int:
    """Blank cells that the rows have beyond the header."""
    longer = [row for row in table if len(row) > columns]
    if not longer or any(any(row[columns:]) for row in longer):
        return 0
    lengths = {len(row) for row in table}
    return max(lengths) - columns if len(lengths) == 1 else 0


def check_columns(path: Path, names: Sequence[str]) -> None:
    """InputError when there are too many columns, or two of one name."""
    if len(names) > MOST_COLUMNS:
        raise InputError(f"{path}: {len(names)} columns, over {MOST_COLUMNS}: keep those needed")
    twice = next((n for n in names if n and names.count(n) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: column '{twice}' occurs twice; rename or remove one")


def _read_as(encoding: str, separator: str, decimal: str) -> list[str]:
    """What a reader of the file may not expect of its characters."""
    how = []
    if not encoding.startswith("utf-8"):
        how.append(f"{encoding.upper()} characters")
    if separator != ",":
        how.append(f"{SEPARATORS[separator]} between the columns")
    if decimal == ",":
        how.append("decimal commas")
    return how


def _header_note(header: str, at: int) -> list[str]:
    if is_aside(header):
        return [f"the comment in line {at + 1} as header"]
    return [f"line {at + 1} as header"] if at else []
