"""Cells that are not all plain numbers, understood as far as they allow, with what to say of it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading.cell_words import numbers_of
from graphnav.reading.dialect import MOST_DAMAGED
from graphnav.reading.stamps import times_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Cells:
    """Columns as text, row by row, and what became of the lines that are no rows."""

    text: dict[str, pa.Array]  # header -> (N,)
    numbers: NDArray[np.intp]  # (N,) of the rows' lines in the file
    decimal: str = "."
    broken: tuple[tuple[int, str], ...] = ()  # line and what is wrong with it
    notes: tuple[str, ...] = ()


@dataclass
class Understood:
    """Columns as numbers, and which rows must be left out."""

    columns: dict[str, Array]
    damaged: Mask  # (N,)
    why: list[tuple[int, str]]  # line and what is wrong, in the order of lines
    blanks: Counter[str] = field(default_factory=Counter)  # words read as blank
    said: list[str] = field(default_factory=list)

    def notes(self) -> list[str]:
        """What was read otherwise than it stands."""
        found = list(self.said)
        if self.blanks:
            words = ", ".join(f"'{word}' ({count})" for word, count in self.blanks.most_common(4))
            found.append(f"cells that say there is no sample are read as blank: {words}")
        if self.why:
            first = "; ".join(f"line {line}: {what}" for line, what in self.why[:2])
            found.append(
                f"{len(self.why)} damaged line{'s' * (len(self.why) > 1)} left out, {first}"
            )
        return found


def understood(cells: Cells, names: Sequence[str], clock: str) -> Understood:
    """Columns `names` as numbers; times as text in the column `clock` too."""
    rows = len(cells.numbers)
    found = Understood({}, np.zeros(rows, bool), list(cells.broken), said=list(cells.notes))
    for name in names:
        values, odd, bad = numbers_of(cells.text[name], cells.decimal)
        if name == clock and bad.sum() > rows / 2:
            times = times_of(cells.text[name])
            if times is not None:
                values, bad, note = times
                odd = np.zeros(rows, bool)
                found.said.append(note)
        found.columns[name] = values
        found.blanks.update(word.strip() for word in _at(cells.text[name], odd))
        fresh = np.flatnonzero(bad & ~found.damaged)
        found.why += zip(
            cells.numbers[fresh].tolist(),
            (f"{name} is '{word[:40]}', not a number" for word in _at(cells.text[name], fresh)),
            strict=True,
        )
        found.damaged |= bad
    found.why.sort()
    return found


def check_damage(where: str, found: Understood, kind: str) -> None:
    """InputError with the first damaged line when there are more of them than `MOST_DAMAGED`.

    `kind` is how rows are counted: line or row.
    """
    rows = int((~found.damaged).sum())
    if len(found.why) <= MOST_DAMAGED * (rows + len(found.why)):
        return
    line, what = found.why[0]
    cure = "leave the cell blank when there is no sample" if "not a number" in what else ""
    if what.startswith("time "):
        cure = "a time is a number [s] or ISO 8601, as 2024-05-01T12:00:00.010Z"
    raise InputError(
        f"{where}: {kind} {line}: {what} ({len(found.why)} such {kind}s of "
        f"{rows + len(found.why)}, over {MOST_DAMAGED:.0%})" + (f"; {cure}" if cure else "")
    )


def _at(text: pa.Array, where: NDArray[np.generic]) -> list[str]:
    rows = np.flatnonzero(where) if where.dtype == bool else where
    return [word or "" for word in text.take(pa.array(rows)).to_pylist()]
