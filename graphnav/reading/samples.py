"""A run file's columns under graphnav's own names, in SI units, row by row as recorded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading import columns, units
from graphnav.reading.no_sample import without_impossible
from graphnav.reading.position_unit import in_degrees
from graphnav.reading.row_order import in_order
from graphnav.reading.table_file import TableFile, read_table
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import nearest

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Samples:
    """Columns that the file and the vehicle file agree on; a blank cell is NaN."""

    file: TableFile
    columns: dict[str, Array]  # canonical name -> (N,), SI except degrees where the name says so
    ignored: tuple[str, ...]  # headers nothing was read from
    notes: tuple[str, ...] = ()  # what was read otherwise than it stands

    @property
    def clock(self) -> Array:
        """The file's own clock (N,) s."""
        return self.columns["time"]

    def has(self, names: tuple[str, ...]) -> bool:
        """Whether the file has any of these columns."""
        return any(name in self.columns for name in names)

    def error(self, row: int, text: str) -> InputError:
        """An `InputError` at `row`, with its line and time."""
        where = f"{self.file.row(row)} (time {self.clock[row]:.15g})"
        return InputError(f"{self.file.path}: {where}: {text}")

    def need(self, names: tuple[str, ...], what: str) -> None:
        """InputError when one of the columns is not there."""
        missing = [name for name in names if name not in self.columns]
        if missing:
            raise missing_column(self.file, missing[0], f"{what} needs {', '.join(names)}")

    def group(self, names: tuple[str, ...], what: str) -> tuple[Rows, Array]:
        """Rows (M,) where a sensor has a sample and its values (M, len(names)).

        Raises `InputError` when a column is missing or a row holds only some of the values.
        """
        self.need(names, what)
        values = [self.columns[name] for name in names]
        filled = np.zeros(len(self.clock), np.uint8)
        for column in values:
            filled += np.isfinite(column)
        partial = np.flatnonzero((filled > 0) & (filled < len(names)))
        if len(partial):
            row = int(partial[0])
            blank = next(n for n, v in zip(names, values, strict=True) if not np.isfinite(v[row]))
            raise self.error(row, f"{what} is half filled: {blank} is blank; fill or blank all")
        rows = np.flatnonzero(filled)
        every = slice(None) if len(rows) == len(filled) else rows
        return rows, np.stack([column[every] for column in values], -1)


def missing_column(file: TableFile, name: str, need: str) -> InputError:
    """The error for a column that is not there, with the header that looks most like it, of those
    that are not another column's own name.
    """
    others = [header for header in file.header if header not in columns.DIMENSION]
    if not others:
        return InputError(f"{file.path}: no column '{name}' ({need}); record it, no other fits")
    like = nearest(name, others)
    return InputError(
        f"{file.path}: no column '{name}' ({need}); if '{like}' is meant, map it in the vehicle "
        f'file: [columns] {name} = {{ name = "{like}", unit = "{columns.default_unit(name)}" }}'
    )


def read_samples(file: TableFile, vehicle: Vehicle) -> Samples:
    """Every column graphnav knows, scaled to SI; rows in strictly increasing time."""
    names = _file_names(file, vehicle)
    if "time" not in names:
        raise missing_column(file, "time", "every run needs its clock [s]")
    table = read_table(file, list(dict.fromkeys(names.values())), clock=names["time"])
    scaled = {c: _scaled(table.columns[n], _factor(vehicle, c)) for c, n in names.items()}
    _check_rows(file, len(scaled["time"]), "under the header")
    ordered = in_order(table.file, scaled)
    _check_rows(file, len(ordered.rows), "of different times")
    degrees, note = in_degrees(str(file.path), ordered.columns, vehicle)
    possible, notes = without_impossible(ordered.file, degrees)
    ignored = tuple(name for name in file.header if name not in names.values())
    notes = [*table.notes, *ordered.notes, *([note] if note else []), *notes]
    return Samples(ordered.file, _rates(possible, vehicle), ignored, tuple(notes))


def _check_rows(file: TableFile, count: int, which: str) -> None:
    """InputError where there are too few rows to smooth; `which` says of what kind."""
    if count < 2:
        raise InputError(f"{file.path}: {count or 'no'} rows {which}; nothing to smooth")


def _rates(read: dict[str, Array], vehicle: Vehicle) -> dict[str, Array]:
    """Columns that hold increments over a sample, divided by the interval it stands for."""
    clock = read["time"]
    found = dict(read)
    for name in read.keys() & {*columns.GYRO, *columns.ACCEL}:
        unit = _unit(vehicle, name)
        if unit and units.is_increment(columns.dimension(name), unit):
            there = np.flatnonzero(np.isfinite(read[name]))
            found[name] = np.full(len(clock), np.nan)
            found[name][there] = read[name][there] / _intervals(clock[there])
    return found


def _intervals(clock: Array) -> Array:
    """Sampling interval of every sample (M,); after a loss the usual one, which it still spans."""
    step = np.diff(clock)
    usual = np.median(step) if len(step) else 1.0
    return np.concatenate([[usual], np.where(step > 1.5 * usual, usual, step)])[: len(clock)]


def _file_names(file: TableFile, vehicle: Vehicle) -> dict[str, str]:
    """Canonical column -> header in the file, for the columns that are there."""
    mapped = {c: m.name for c, m in vehicle.columns.items() if m.name is not None}
    for column, name in mapped.items():
        if column in columns.GROUPS:
            raise InputError(
                f"{file.path}: [columns] {column} stands for several columns and takes only a unit;"
                f" name {', '.join(columns.GROUPS[column])} one by one"
            )
        if name not in file.header:
            raise InputError(
                f"{file.path}: no column '{name}', which the vehicle file names for {column}; "
                f"nearest is '{nearest(name, file.header)}'"
            )
    names = {c: mapped.get(c, c) for c in columns.DIMENSION}
    return {c: name for c, name in names.items() if name in file.header}


def _scaled(values: Array, factor: float) -> Array:
    return values if factor == 1.0 else values * factor  # a copy of a long run takes its time


def _factor(vehicle: Vehicle, column: str) -> float:
    unit = _unit(vehicle, column)
    return 1.0 if unit is None else units.factor(columns.dimension(column), unit)


def _unit(vehicle: Vehicle, column: str) -> str | None:
    """The unit the vehicle file states for a column, or for the group it is in."""
    group = next((g for g, members in columns.GROUPS.items() if column in members), "")
    stated = (vehicle.columns[name].unit for name in (column, group) if name in vehicle.columns)
    return next((unit for unit in stated if unit is not None), None)
