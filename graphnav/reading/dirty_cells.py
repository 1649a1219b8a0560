"""Cells that are not all plain numbers, understood as far as they allow, with what to say of it."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from graphnav.reading.cell_words import PLAIN_BLANKS, numbers_of, trimmed
from graphnav.reading.left_out import NAMED, LeftOut
from graphnav.reading.stamps import times_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Cells:
    """Some rows' columns as text."""

    text: dict[str, pa.Array]  # header -> (N,)
    numbers: NDArray[np.intp]  # (N,) of the rows' lines in the file


@dataclass(frozen=True)
class Wanted:
    """The columns to be understood, and how."""

    names: tuple[str, ...]  # as numbers
    words: tuple[str, ...]  # as text
    clock: str  # of `names`: times as text are understood in it
    decimal: str = "."

    @property
    def columns(self) -> list[str]:
        """All of them, each once."""
        return [*dict.fromkeys([*self.names, *self.words])]


@dataclass(frozen=True)
class Understood:
    """The whole rows."""

    columns: dict[str, Array]  # (N,)
    words: dict[str, list[str]]  # N, '' where blank
    numbers: NDArray[np.intp]  # (N,)


def understood(
    blocks: Iterable[Cells], wanted: Wanted, left_out: LeftOut, where: str, kind: str
) -> Understood:
    """The rows of all `blocks` as far as they are whole; the others are counted in `left_out`.

    Block by block, so that text and numbers are never held both. Raises InputError, which names
    `where` and rows by their `kind` (line, row), when too many are damaged.
    """
    columns: dict[str, list[Array]] = {name: [np.empty(0)] for name in wanted.names}
    words: defaultdict[str, list[str]] = defaultdict(list)
    numbers: list[NDArray[np.intp]] = [np.empty(0, np.intp)]
    rows, written = 0, False
    for cells in blocks:
        written = _written(cells, wanted) if not rows else written
        found, damaged = _numbers(cells, wanted, written, left_out)
        whole = np.flatnonzero(~damaged)
        rows += len(whole)
        left_out.check(where, kind, rows, ended=False)
        numbers.append(cells.numbers[whole])
        for name, parts in columns.items():
            parts.append(found[name][whole])
        for name in wanted.words:
            words[name] += _plain(cells.text[name].take(pa.array(whole)))
    left_out.check(where, kind, rows, ended=True)
    joined = {name: np.concatenate(columns.pop(name)) for name in wanted.names}
    return Understood(joined, dict(words), np.concatenate(numbers))


def _written(cells: Cells, wanted: Wanted) -> bool:
    """Whether most times are something else than numbers."""
    if wanted.clock not in wanted.names:
        return False
    _, _, bad = numbers_of(cells.text[wanted.clock], wanted.decimal)
    return bool(bad.sum() > len(bad) / 2)


def _numbers(
    cells: Cells, wanted: Wanted, written: bool, left_out: LeftOut
) -> tuple[dict[str, Array], Mask]:
    """Columns of a block as numbers, and which of its rows are damaged."""
    columns: dict[str, Array] = {}
    damaged = np.zeros(len(cells.numbers), bool)
    for name in wanted.names:
        times = times_of(cells.text[name]) if written and name == wanted.clock else None
        if times is not None:
            values, bad, note = times
            left_out.said += [note] * (note not in left_out.said)
        else:
            values, odd, bad = numbers_of(cells.text[name], wanted.decimal)
            _count_blanks(cells.text[name].filter(pa.array(odd)), left_out)
        columns[name] = values
        fresh = np.flatnonzero(bad & ~damaged)
        if len(fresh):
            why = (f"{name} is '{word[:40]}', not a number"
                   for word in _at(cells.text[name], fresh[:NAMED]))  # fmt: skip
            left_out.damage(len(fresh), zip(cells.numbers[fresh].tolist(), why, strict=False))
        damaged |= bad
    return columns, damaged


def _count_blanks(words: pa.Array, left_out: LeftOut) -> None:
    """Words read as blank, into the count of them."""
    for count in pc.value_counts(trimmed(words)).to_pylist():
        left_out.blanks[count["values"]] += count["counts"]


def _at(text: pa.Array, rows: NDArray[np.intp]) -> list[str]:
    return [word or "" for word in text.take(pa.array(rows)).to_pylist()]


def _plain(words: pa.Array) -> list[str]:
    return ["" if word is None or word in PLAIN_BLANKS else word for word in words.to_pylist()]
