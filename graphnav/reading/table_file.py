"""Tables on disk (csv, csv.gz, parquet) as columns of numbers; what is wrong in one line.

A blank cell is NaN. Nothing here knows what a column means. Plain files go through pyarrow alone;
where its reader gives up, `dirty_text` takes the lines apart and says what it did.
"""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading import bounds
from graphnav.reading.archive import Unfolding, is_archive
from graphnav.reading.cell_words import PLAIN_BLANKS
from graphnav.reading.dialect import HEAD_BYTES, Dialect, check_columns, dialect_of
from graphnav.reading.dirty_cells import Cells, Wanted, understood
from graphnav.reading.dirty_text import cells_of
from graphnav.reading.left_out import LeftOut
from graphnav.reading.plain_file import check_content, check_file

Array = NDArray[np.float64]
pa.set_memory_pool(pa.system_memory_pool())  # others keep what they free from numpy's arrays
UNREADABLE = (OSError, UnicodeError, pa.ArrowException)


@dataclass(frozen=True)
class TableFile:
    """A table's header and how its text is written."""

    path: Path
    header: tuple[str, ...]  # as in the file, blanks stripped; nameless columns left out
    dialect: Dialect | None  # None: parquet
    lines: NDArray[np.intp] | None = None  # of the rows, where they do not follow one another

    def row(self, index: int) -> str:
        """How a user finds row `index` (0 is the first under the header)."""
        if self.lines is not None:
            index = int(self.lines[index])
        elif self.dialect is not None:
            index += self.dialect.skip + 1
        else:
            index += 1
        return f"{'row' if self.dialect is None else 'line'} {index}"

    def kept(self, rows: NDArray[np.intp]) -> "TableFile":
        """The same file, of which only `rows` are left."""
        start = 1 if self.dialect is None else self.dialect.skip + 1
        return replace(self, lines=rows + start if self.lines is None else self.lines[rows])


@dataclass(frozen=True)
class Table:
    """Columns read, row by row."""

    file: TableFile
    columns: dict[str, Array]  # header -> (N,)
    words: dict[str, list[str]]  # header -> N cells as text, '' where blank
    notes: tuple[str, ...] = ()  # what was read otherwise than it stands, or left out


def open_table(path: Path) -> TableFile:
    """The table at `path`; InputError when it is absent, empty or not a table."""
    check_file(path, "file", "give a .csv, .csv.gz or .parquet file")
    try:
        head = _head(path)
        check_content(path, head, is_parquet(path))
        if is_parquet(path):
            return TableFile(path, _parquet_header(path), None)
        dialect = dialect_of(path, head)
        bounds.check_text_size(path, head, len(dialect.names))
    except UNREADABLE as error:
        text = " ".join(str(error).split())
        cut = "; copy it anew: without its end it cannot be read" if is_parquet(path) else ""
        raise InputError(f"{path}: cannot be read as {_kind(path)}: {text}{cut}") from None
    return TableFile(path, tuple(name for name in dialect.names if name), dialect)


def read_table(
    file: TableFile, names: Sequence[str], words: Sequence[str] = (), clock: str = "time"
) -> Table:
    """Columns `names` as numbers and `words` as text; times as text are understood in `clock`.

    Raises InputError where more than a few lines are no table or hold something else.
    """
    try:
        table, said = _cells(file, {**dict.fromkeys(names, pa.float64()),
                                    **dict.fromkeys(words, pa.string())})  # fmt: skip
    except UNREADABLE:
        return _read_dirty(file, names, words, clock)
    texts, columns = _texts(table, words), {}
    for name in dict.fromkeys(
        names
    ):  # each column is held once only, not as pyarrow's and as numpy's
        columns[name] = np.asarray(table[name].to_numpy(), float)
        table = table.drop_columns([name])
    if any(np.isinf(column).any() for column in columns.values()):
        columns.clear()  # before as much is read again
        return _read_dirty(file, names, words, clock)
    notes = (*(file.dialect.notes if file.dialect else ()), *said)
    return Table(file, columns, texts, notes)


def is_parquet(path: Path) -> bool:
    """Whether the name says parquet."""
    return path.suffix.lower() in (".parquet", ".pq")


def _texts(table: pa.Table, words: Sequence[str]) -> dict[str, list[str]]:
    return {name: [word or "" for word in table[name].to_pylist()] for name in words}


def _cells(file: TableFile, kinds: dict[str, Any]) -> tuple[pa.Table, tuple[str, ...]]:
    """Columns cast to their kinds, by pyarrow's own reader; and what to say of it."""
    dialect = file.dialect
    if dialect is None:
        table = pa_parquet.read_table(file.path, columns=list(kinds))
        table, said = _plain_columns(file, table)
        return table.cast(pa.schema([(name, kinds[name]) for name in table.column_names])), said
    if dialect.separator == " ":
        raise pa.ArrowInvalid("runs of blanks")
    with bounds.opened(file.path, len(dialect.names)) as stream:
        table = pa_csv.read_csv(
            stream,
            pa_csv.ReadOptions(
                column_names=_unique(dialect), skip_rows=dialect.skip, encoding=dialect.encoding
            ),
            pa_csv.ParseOptions(delimiter=dialect.separator),
            pa_csv.ConvertOptions(
                column_types=kinds,
                include_columns=list(kinds),
                null_values=PLAIN_BLANKS,
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
            ),
        )
        return table, bounds.note_of(stream)


def _plain_columns(file: TableFile, table: pa.Table) -> tuple[pa.Table, tuple[str, ...]]:
    """A parquet table with durations in seconds, and what to say of it; InputError on columns whose
    cells hold more than one thing.
    """
    said: tuple[str, ...] = ()
    for i, column in enumerate(table.schema):
        if pa.types.is_nested(column.type):
            raise InputError(
                f"{file.path}: column '{column.name}' holds {column.type}, not numbers; write each "
                "of them in a column of its own"
            )
        if pa.types.is_duration(column.type):
            counts = (
                table[i].cast(pa.duration("ns")).cast(pa.int64()).cast(pa.float64(), safe=False)
            )
            table = table.set_column(i, column.name, pc.divide(counts, 1e9))
            said += (f"{column.name} is a duration: read as seconds",)
    return table, said


def _unique(dialect: Dialect) -> list[str]:
    """A name for every column, those without one included."""
    return [name or f"\0{i}" for i, name in enumerate(dialect.names)]


def _read_dirty(file: TableFile, names: Sequence[str], words: Sequence[str], clock: str) -> Table:
    """The second attempt: cell by cell, damaged lines left out and told."""
    decimal = file.dialect.decimal if file.dialect else "."
    wanted = Wanted(tuple(dict.fromkeys(names)), tuple(dict.fromkeys(words)), clock, decimal)
    left_out, kind = LeftOut(), "line" if file.dialect else "row"
    try:
        blocks = (_text_cells if file.dialect else _parquet_cells)(file, wanted, left_out)
        found = understood(blocks, wanted, left_out, str(file.path), kind)
    except UNREADABLE as error:
        text = " ".join(str(error).split())
        raise InputError(
            f"{file.path}: cannot be read: {text}; it seems damaged or cut off: copy it anew"
        ) from None
    notes = (*(file.dialect.notes if file.dialect else ()), *left_out.notes())
    return Table(replace(file, lines=found.numbers), found.columns, found.words, notes)


def _parquet_cells(file: TableFile, wanted: Wanted, left_out: LeftOut) -> Iterator[Cells]:
    """Columns of a parquet file as text, whatever their type."""
    names, row = wanted.columns, 1
    with pa_parquet.ParquetFile(file.path) as opened:
        for batch in opened.iter_batches(columns=names):
            plain, said = _plain_columns(file, pa.Table.from_batches([batch]))
            left_out.said += [each for each in said if each not in left_out.said]
            text = {name: plain[name].cast(pa.string()).combine_chunks() for name in names}
            yield Cells(text, np.arange(row, row + len(batch)))
            row += len(batch)


def _text_cells(file: TableFile, wanted: Wanted, left_out: LeftOut) -> Iterator[Cells]:
    """Columns of a text as text, line by line."""
    dialect = file.dialect
    assert dialect is not None
    with bounds.opened(file.path, len(dialect.names)) as stream:
        text = io.TextIOWrapper(io.BufferedReader(stream, 1 << 20), dialect.encoding, "replace")
        yield from cells_of(text, dialect, wanted.columns, str(file.path), left_out)
        left_out.said += bounds.note_of(stream)


def _kind(path: Path) -> str:
    return "parquet" if is_parquet(path) else "a table of text"


def _parquet_header(path: Path) -> tuple[str, ...]:
    """Names of the columns; InputError when there are too many or they cannot be held."""
    with pa_parquet.ParquetFile(path) as file:
        names, rows = tuple(file.schema_arrow.names), file.metadata.num_rows
    check_columns(path, names)
    bounds.check_need(path, bounds.need(0, rows, len(names)), f"its {rows} rows")
    return names


def _head(path: Path) -> bytes:
    with Unfolding(path) if is_archive(path) else path.open("rb") as file:
        return file.read(HEAD_BYTES)
