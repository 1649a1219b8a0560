"""A run file's columns under graphnav's own names, in SI units, row by row as recorded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading import columns, units
from graphnav.reading.table_file import TableFile
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

    def group(self, names: tuple[str, ...], what: str) -> tuple[Rows, Array]:
        """Rows (M,) where a sensor has a sample and its values (M, len(names)).

        Raises `InputError` when a column is missing or a row holds only some of the values.
        """
        missing = [name for name in names if name not in self.columns]
        if missing:
            raise missing_column(self.file, missing[0], f"{what} needs {', '.join(names)}")
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
    """The error for a column that is not there, with the header that looks most like it."""
    like = nearest(name, file.header)
    return InputError(
        f"{file.path}: no column '{name}' ({need}); if '{like}' is meant, map it in the vehicle "
        f'file: [columns] {name} = {{ name = "{like}", unit = "{columns.default_unit(name)}" }}'
    )


def read_samples(file: TableFile, vehicle: Vehicle) -> Samples:
    """Every column graphnav knows, scaled to SI; rows in strictly increasing time."""
    names = _file_names(file, vehicle)
    if "time" not in names:
        raise missing_column(file, "time", "every run needs its clock [s]")
    numbers = file.numbers(list(dict.fromkeys(names.values())))
    scaled = {c: _scaled(numbers[name], _factor(vehicle, c)) for c, name in names.items()}
    ignored = tuple(name for name in file.header if name not in names.values())
    samples = Samples(file, scaled, ignored)
    _check_clock(samples)
    return samples


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
    group = next((g for g, members in columns.GROUPS.items() if column in members), "")
    for name in (column, group):
        if name in vehicle.columns and (unit := vehicle.columns[name].unit) is not None:
            return units.factor(columns.dimension(column), unit)
    return 1.0


def _check_clock(samples: Samples) -> None:
    clock = samples.clock
    path, row = samples.file.path, samples.file.row
    if len(clock) < 2:
        raise InputError(f"{path}: {len(clock) or 'no'} rows under the header; nothing to smooth")
    if np.isnan(clock).any():
        raise InputError(f"{path}: {row(int(np.isnan(clock).argmax()))}: time is blank")
    bad = np.flatnonzero(np.diff(clock) <= 0)
    if len(bad):
        i = int(bad[0])
        how = "repeats" if clock[i + 1] == clock[i] else "goes backwards"
        raise InputError(
            f"{path}: time {how} at {row(i + 1)}: {clock[i]:.15g} then {clock[i + 1]:.15g}; "
            "sort the rows and merge those of one time (blank cells where no sample)"
        )
