"""Tables on disk (csv, csv.gz, parquet) as columns of numbers; what is wrong in one line.

A blank cell is NaN. Nothing here knows what a column means.
"""

import gzip
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.common.side_by_side import side_by_side

Array = NDArray[np.float64]
pa.set_memory_pool(pa.system_memory_pool())  # others keep what they free from numpy's arrays
BLANK = ["", "nan", "NaN", "NAN", "null", "NULL", "NA", "N/A"]


@dataclass(frozen=True)
class TableFile:
    """A table's header; cells are read by `numbers` and `words`."""

    path: Path
    header: tuple[str, ...]  # as in the file, blanks stripped

    def row(self, index: int) -> str:
        """How a user finds row `index` (0 is the first under the header)."""
        return f"row {index + 1}" if is_parquet(self.path) else f"line {index + 2}"

    def numbers(self, names: Sequence[str]) -> dict[str, Array]:
        """Columns `names` as float64 (N,); InputError names the first cell that is no number."""
        try:
            table = self._cells(names, pa.float64())
        except (pa.ArrowException, OSError) as error:
            raise InputError(self._not_a_number(names) or self._broken(error)) from None
        columns = side_by_side(lambda name: np.asarray(table[name].to_numpy(), float), names)
        endless = side_by_side(lambda column: np.flatnonzero(np.isinf(column))[:1], columns)
        for name, row in zip(names, endless, strict=True):
            if len(row):
                where = f"{self.path}: {self.row(int(row[0]))}"
                raise InputError(f"{where}: {name} is infinite; leave the cell blank")
        return dict(zip(names, columns, strict=True))

    def words(self, name: str) -> list[str]:
        """Column `name` as text, blank cells as ''."""
        try:
            column = self._cells([name], pa.string())[name]
        except (pa.ArrowException, OSError) as error:
            raise InputError(self._broken(error)) from None
        return [word or "" for word in column.to_pylist()]

    def _cells(self, names: Sequence[str], kind: Any, threads: bool = True) -> Any:
        """The columns under stripped `names`, cast to `kind`."""
        if is_parquet(self.path):
            table = pa_parquet.read_table(self.path, columns=list(names))
            return table.cast(pa.schema([(column, kind) for column in table.column_names]))
        with pa.input_stream(str(self.path), compression=_compression(self.path)) as stream:
            return pa_csv.read_csv(
                stream,
                pa_csv.ReadOptions(
                    column_names=list(self.header), skip_rows=1, use_threads=threads
                ),
                convert_options=pa_csv.ConvertOptions(
                    column_types=dict.fromkeys(names, kind),
                    include_columns=list(names),
                    null_values=BLANK,
                    strings_can_be_null=True,
                ),
            )

    def _not_a_number(self, names: Sequence[str]) -> str | None:
        """The first cell, by row, that holds something else than a number."""
        found: list[tuple[int, str, str]] = []
        for name in names:
            try:
                words = self.words(name)
            except InputError:
                return None
            bad = next((i for i, word in enumerate(words) if not _is_number(word)), None)
            if bad is not None:
                found.append((bad, name, words[bad]))
        if not found:
            return None
        row, name, word = min(found)
        return (
            f"{self.path}: {self.row(row)}: {name} is '{word}', not a number; "
            "leave the cell blank when there is no sample"
        )

    def _broken(self, error: Exception) -> str:
        """The reader's own words, with the line where a single thread can tell it."""
        if not is_parquet(self.path):
            try:
                self._cells(self.header, pa.string(), threads=False)
            except (pa.ArrowException, OSError) as same:
                error = same
        text = " ".join(str(error).split()).removeprefix("CSV parse error: ")
        found = re.match(r"Row #(\d+): Expected (\d+) columns, got (\d+)", text)
        if found:
            row, wanted, got = found.groups()
            return f"{self.path}: line {row} has {got} cells, the header has {wanted}"
        return f"{self.path}: cannot be read: {text}"


def open_table(path: Path) -> TableFile:
    """The table at `path`; InputError when it is absent, empty or not a table."""
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "no such file"
        raise InputError(f"{path}: {what}; give a .csv, .csv.gz or .parquet file")
    try:
        header = _header(path)
    except (OSError, UnicodeDecodeError, EOFError, pa.ArrowInvalid) as error:
        text = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as {_kind(path)}: {text}") from None
    if header == [""]:
        raise InputError(f"{path}: empty file; the first line must name the columns")
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise InputError(f"{path}: columns are not separated by commas; save it with ','")
    twice = next((name for name in header if header.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path}: column '{twice}' occurs twice; rename or remove one")
    return TableFile(path, tuple(header))


def is_parquet(path: Path) -> bool:
    """Whether the name says parquet."""
    return path.suffix.lower() in (".parquet", ".pq")


def _compression(path: Path) -> str | None:
    return "gzip" if path.suffix.lower() == ".gz" else None


def _kind(path: Path) -> str:
    return "parquet" if is_parquet(path) else "comma-separated text"


def _header(path: Path) -> list[str]:
    if is_parquet(path):
        return list(pa_parquet.read_schema(path).names)
    opener = gzip.open if _compression(path) else open
    with opener(path, "rt", encoding="utf-8-sig") as file:
        return [name.strip().strip('"') for name in file.readline().split(",")]


def _is_number(word: str) -> bool:
    if word.strip() in BLANK:
        return True
    try:
        float(word)
    except ValueError:
        return False
    return True
