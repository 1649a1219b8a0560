"""Rows brought into the order of time: late rows sorted in, rows of one time merged.

Only where every sensor's own rows are in order and no two rows of one time say different things;
anything else has another cause, which the error names.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading.dialect import MOST_DAMAGED
from graphnav.reading.stamps import unrolled
from graphnav.reading.table_file import TableFile

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
FAR, FAR_S = 10.0, 600.0  # a gap so many times as long as all else, and so many s


@dataclass(frozen=True)
class Ordered:
    """Columns in strictly increasing time, and what was done to get there."""

    file: TableFile  # knows which rows are left
    columns: dict[str, Array]  # "time" among them
    rows: Rows  # of the table that are left, the first of those merged
    notes: tuple[str, ...] = ()


def in_order(file: TableFile, columns: Mapping[str, Array]) -> Ordered:
    """Rows in strictly increasing time. Raises InputError (line, times, cause, cure)."""
    now = Ordered(file, dict(columns), np.arange(len(columns["time"])))
    for step in (_without_blanks, _counted_on, _without_stray, _sorted, _merged):
        if _increases(now.columns["time"]):
            break
        now = step(now)
    if not _increases(now.columns["time"]):
        raise _out_of_order(now)
    return _without_far_ends(now)


def _increases(clock: Array) -> bool:
    return bool((np.diff(clock) > 0).all()) and not np.isnan(clock).any()


def _kept(now: Ordered, rows: Rows, note: str) -> Ordered:
    columns = {name: column[rows] for name, column in now.columns.items()}
    return Ordered(now.file.kept(rows), columns, now.rows[rows], (*now.notes, note))


def _without_blanks(now: Ordered) -> Ordered:
    """Rows without a time cannot be placed: left out while they are few."""
    blank = np.isnan(now.columns["time"])
    if not blank.any():
        return now
    row = now.file.row(int(blank.argmax()))
    if blank.sum() > MOST_DAMAGED * len(blank):
        raise InputError(
            f"{now.file.path}: {row}: time is blank, in {int(blank.sum())} of {len(blank)} rows; "
            "every row needs its time"
        )
    note = f"{int(blank.sum())} rows without a time left out, the first in {row}"
    return _kept(now, np.flatnonzero(~blank), note)


def _counted_on(now: Ordered) -> Ordered:
    """A clock that begins anew after a known period is counted on."""
    clock, note = unrolled(now.columns["time"])
    if note is None:
        return now
    return Ordered(now.file, now.columns | {"time": clock}, now.rows, (*now.notes, note))


def _without_stray(now: Ordered) -> Ordered:
    """Single rows whose time fits neither neighbour, while those fit each other: damaged."""
    clock = now.columns["time"]
    if len(clock) < 4:
        return now
    before, here, after = clock[:-2], clock[1:-1], clock[2:]
    stray = np.flatnonzero((before < after) & ((here < before) | (here > after))) + 1
    # of a swapped pair both look astray, and neither is damaged
    stray = stray[~np.isin(stray - 1, stray) & ~np.isin(stray + 1, stray)]
    # at the ends: the second row before the first, the last before the one it follows
    if clock[0] > clock[1] and clock[0] > clock[2] and clock[1] < clock[2]:
        stray = np.append(0, stray[stray != 1])
    if clock[-1] < clock[-2] and clock[-1] < clock[-3] and clock[-3] < clock[-2]:
        stray = np.append(stray[stray != len(clock) - 2], len(clock) - 1)
    left = np.delete(np.arange(len(clock)), stray)
    if not len(stray) or len(stray) > MOST_DAMAGED * len(clock) or (np.diff(clock[left]) < 0).any():
        return now
    first = int(stray[0])
    times = "" if len(stray) == 1 else f", {len(stray)} such rows"
    note = (
        f"a row whose time is astray left out: {now.file.row(first)} says {clock[first]:.15g} "
        f"between {clock[max(first - 1, 0)]:.15g} and {clock[min(first + 1, len(clock) - 1)]:.15g}"
        + times
    )
    return _kept(now, left, note)


def _sorted(now: Ordered) -> Ordered:
    """Rows of different sensors that came late, sorted in; each sensor's own are in order."""
    clock = now.columns["time"]
    late = np.flatnonzero(np.diff(clock) < 0)
    if not len(late):
        return now
    for name, column in now.columns.items():
        if name != "time" and (np.diff(clock[np.isfinite(column)]) < 0).any():
            return now
    row = now.file.row(int(late[0]) + 1)
    note = f"{len(late)} times a row comes later than its time, first {row}: sorted by time"
    return _kept(now, np.argsort(clock, kind="stable"), note)


def _merged(now: Ordered) -> Ordered:
    """Rows of one time as one row, unless they say different things."""
    clock = now.columns["time"]
    if (np.diff(clock) < 0).any():
        return now
    starts = np.flatnonzero(np.append(True, np.diff(clock) > 0))
    merged: dict[str, Array] = {}
    contradict = np.zeros(len(starts), bool)
    for name, column in now.columns.items():
        merged[name] = np.fmax.reduceat(column, starts)
        contradict |= np.fmin.reduceat(column, starts) < merged[name]
    doubled = len(clock) - len(starts)
    if contradict.sum() > MOST_DAMAGED * len(starts):
        raise _contradiction(now, starts[int(contradict.argmax())], int(contradict.sum()))
    for name, column in now.columns.items():  # of rows that contradict the first stands
        merged[name][contradict] = column[starts[contradict]]
    note = f"rows of one time merged: {doubled} of {len(clock)} rows"
    if contradict.any():
        row = now.file.row(int(starts[int(contradict.argmax())]) + 1)
        note += f"; {int(contradict.sum())} contradict the row before and are left out, first {row}"
    return Ordered(now.file.kept(starts), merged, now.rows[starts], (*now.notes, note))


def _without_far_ends(now: Ordered) -> Ordered:
    """The few first or last rows, where a gap longer than all else parts them from the others.

    Raises InputError where there are many on either side.
    """
    clock = now.columns["time"]
    if len(clock) < 2:
        return now
    step = np.diff(clock)
    k = int(step.argmax())
    if step[k] < FAR_S or step[k] < FAR * (clock[-1] - clock[0] - step[k]):
        return now
    where = (
        f"time jumps from {clock[k]:.15g} to {clock[k + 1]:.15g} at {now.file.row(k + 1)}, further "
        "than all else the run spans"
    )
    few = min(k + 1, len(clock) - k - 1)
    if few > MOST_DAMAGED * len(clock):
        raise InputError(
            f"{now.file.path}: {where}: are there two runs in the file, or is the time in another "
            "unit? split it there, or set [columns] time = { unit = ... } in the vehicle file"
        )
    last = few == len(clock) - k - 1
    rows = np.arange(k + 1) if last else np.arange(k + 1, len(clock))
    return _kept(now, rows, f"{where}: the {few} rows {'after' if last else 'before'} are left out")


def _contradiction(now: Ordered, start: int, count: int) -> InputError:
    clock = now.columns["time"]
    names = [n for n, c in now.columns.items() if n != "time" and c[start] != c[start + 1]
             and np.isfinite(c[start : start + 2]).all()]  # fmt: skip
    differ = f" in {names[0]}" if names else ""
    if clock[0] == clock[-1]:
        return InputError(
            f"{now.file.path}: every row has the time {clock[0]:.15g}: the clock stands still; "
            "name the column that counts on under [columns] time in the vehicle file"
        )
    return InputError(
        f"{now.file.path}: time repeats at {now.file.row(start + 1)}: two rows at "
        f"{clock[start]:.15g} differ{differ}, so in {count} places: is the clock written with too "
        "few decimals, or another column the clock? Write the times with all their digits"
    )


def _out_of_order(now: Ordered) -> InputError:
    """Why the clock runs back, as far as it can be told."""
    clock = now.columns["time"]
    back = np.flatnonzero(np.diff(clock) < 0)
    i = int(back[0])
    where = (
        f"{now.file.path}: time goes backwards at {now.file.row(i + 1)}: {clock[i]:.12g} then "
        f"{clock[i + 1]:.12g}"
    )
    if len(back) <= 3 and abs(clock[i + 1] - clock[0]) < 0.05 * max(clock[i] - clock[0], 1e-9):
        return InputError(f"{where}: the recording seems to begin anew there; split it in two runs")
    if len(back) > MOST_DAMAGED * len(clock):
        return InputError(f"{where}, {len(back)} times in all: sort the rows by time")
    return InputError(
        f"{where}: the clock seems to have been set back, so what lies before and after is not on "
        "one clock; give graphnav a column that counts on (the IMU's own), or split the run there"
    )
