"""A run file (csv, csv.gz, parquet) as a `Run`: SI, right-forward-up, every sensor on its clock.

Nothing is dropped, clipped or guessed here that is not told in `Run.notes`.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.common.run import (
    EVERY_AXIS,
    Accelerometer,
    ExternalHeading,
    Gnss,
    Imu,
    Odometer,
    RoverGear,
    Run,
    SideSpeeds,
)
from graphnav.reading.columns import ACCEL, GNSS, GYRO, LINKS, SIDE_PULSES, SIDES, STEERS, WHEELS
from graphnav.reading.counter import counted
from graphnav.reading.fixes import read_fixes
from graphnav.reading.inertial_rows import inertial
from graphnav.reading.samples import Rows, Samples, missing_column, read_samples
from graphnav.reading.table_file import open_table
from graphnav.reading.vehicle import Vehicle

Array = NDArray[np.float64]
SLOWEST_S = 1.5  # between inertial samples: slower is another unit, nothing to integrate
FULL_TURN_DEG = 360.0  # receivers write figures beyond it while they have no heading


@dataclass(frozen=True)
class _Reader:
    """Samples, the vehicle that explains them, and what is worth telling about the reading."""

    samples: Samples
    vehicle: Vehicle
    notes: list[str] = field(default_factory=list)

    def time(self, rows: Rows) -> Array:
        """Seconds from the run's start at `rows`."""
        clock = self.samples.clock
        return np.asarray(clock[rows] - clock[0])


def read_run(path: Path, vehicle: Vehicle) -> Run:
    """The run at `path`. Raises `InputError` (file, line, time, cure) on whatever is malformed."""
    samples = read_samples(open_table(path), vehicle)
    reader = _Reader(samples, vehicle, list(samples.notes))
    _note_ignored(reader)
    sides = _sides(reader)
    imu, sensed = _imu(reader)
    return Run(
        path=path,
        clock_start=float(reader.samples.clock[0]),
        end=float(reader.samples.clock[-1] - reader.samples.clock[0]),
        imu=imu,
        sensed=sensed,
        odometer=_odometer(reader, sides),
        sides=sides,
        gnss=_gnss(reader),
        heading=_heading(reader),
        rover=_rover(reader),
        accelerometer=_accelerometer(reader),
        notes=tuple(reader.notes),
    )


def _note_ignored(reader: _Reader) -> None:
    ignored = reader.samples.ignored
    if ignored:
        names = ", ".join(f"'{name}'" for name in ignored[:8]) + (", ..." if ignored[8:] else "")
        reader.notes.append(
            f"columns without a meaning to graphnav were not read: {names}; "
            "map them under [columns] in the vehicle file if they are sensors"
        )


def _imu(reader: _Reader) -> tuple[Imu | None, tuple[bool, ...]]:
    """Inertial samples in RFU and which axes of gyro and accelerometer were recorded."""
    samples = reader.samples
    if reader.vehicle.kind == "rover" and not samples.has(GYRO):
        return None, EVERY_AXIS
    axes = reader.vehicle.imu.axes_matrix
    found = inertial(samples, axes)
    reader.notes.extend(found.notes)
    if len(found.rows) < 2:
        raise InputError(f"{samples.file.path}: fewer than two inertial samples; need {GYRO[0]}...")
    time = reader.time(found.rows)
    step = np.diff(time)
    _check_pace(samples, float(np.median(step)))
    imu = Imu(
        time=time,
        dt=np.concatenate([[np.median(step)], step]),
        gyro=_turned(found.gyro, axes),
        accel=_turned(found.accel, axes),
    )
    which = np.abs(axes).argmax(1)
    return imu, tuple(found.sensed[k] for k in (*which, *(which + 3)))


def _check_pace(samples: Samples, step: float) -> None:
    if step > SLOWEST_S:
        raise InputError(
            f"{samples.file.path}: the IMU comes every {step:g} s: is its clock in ms, us or ns? "
            'set [columns] time = { unit = "ms" } in the vehicle file'
        )


def _turned(vectors: Array, axes: Array) -> Array:
    """Recorded vectors (N, 3) in RFU; a signed permutation is quicker picked than multiplied."""
    if (axes == np.eye(3)).all():
        return vectors
    return np.asarray(vectors[:, np.abs(axes).argmax(1)] * axes.sum(1))


def _accelerometer(reader: _Reader) -> Accelerometer | None:
    """Specific force alone: the attitude of a rover without gyros (C5)."""
    if reader.samples.has(GYRO) or not reader.samples.has(ACCEL):
        return None
    rows, values = reader.samples.group(ACCEL, "an accelerometer sample")
    return Accelerometer(reader.time(rows), _turned(values, reader.vehicle.imu.axes_matrix))


def _odometer(reader: _Reader, sides: SideSpeeds | None) -> Odometer | None:
    samples, spec = reader.samples, reader.vehicle.odometer
    there = [name for name in ("odo_pulses", "odo_speed") if name in samples.columns]
    column = spec.column or (there[0] if there else None)
    if column is not None and column not in there:
        if there or samples.ignored:  # one of them may be it under another name
            raise missing_column(samples.file, column, "[odometer] column of the vehicle file")
        reader.notes.append(
            f"the vehicle file names {column}, but the run has no such column: smoothed without "
            "an odometer, on the non-holonomic constraint alone"
        )
        column = None
    if column == "odo_pulses":
        return _counted(reader)
    if column == "odo_speed":
        rows, values = samples.group(("odo_speed",), "the odometer")
        return _integrated(reader.time(rows), values[:, 0])
    if sides is None:
        return None
    reader.notes.append("no odometer column: the mean of odo_left and odo_right is used")
    return _integrated(sides.time, (sides.left + sides.right) / 2)


def _integrated(time: Array, speed: Array) -> Odometer | None:
    if len(time) < 2:
        return None
    steps = np.diff(time) * (speed[1:] + speed[:-1]) / 2
    return Odometer(time, np.concatenate([[0.0], np.cumsum(steps)]), speed, 0.0)


def _per_pulse(reader: _Reader, why: str) -> float:
    per_pulse = reader.vehicle.odometer.metres_per_pulse
    if per_pulse is None:
        raise InputError(
            f"{reader.samples.file.path}: {why}, but the vehicle file does not say what a count is "
            "worth; add [odometer] metres_per_pulse [m]"
        )
    return per_pulse


def _counted(reader: _Reader) -> Odometer | None:
    """Pulses as distance.  Source: B1."""
    per_pulse = _per_pulse(reader, "odo_pulses is a counter")
    rows, values = reader.samples.group(("odo_pulses",), "the odometer")
    if len(rows) < 2:
        return None
    found = counted(reader.time(rows), values[:, 0], per_pulse, float(reader.samples.clock[0]))
    reader.notes.extend(found.notes)
    return found.odometer


def _sides(reader: _Reader) -> SideSpeeds | None:
    samples = reader.samples
    if not samples.has(SIDES):
        return _counted_sides(reader) if samples.has(SIDE_PULSES) else None
    rows, values = samples.group(SIDES, "a pair of side speeds")
    return SideSpeeds(reader.time(rows), values[:, 0], values[:, 1]) if len(rows) > 1 else None


def _counted_sides(reader: _Reader) -> SideSpeeds | None:
    """Both sides' counters as speeds, each differenced over the step that ends at its reading."""
    per_pulse = _per_pulse(reader, "odo_pulses_left and odo_pulses_right are counters")
    rows, values = reader.samples.group(SIDE_PULSES, "a pair of side counters")
    if len(rows) < 2:
        return None
    time, clock = reader.time(rows), float(reader.samples.clock[0])
    speeds = []
    for name, counts in zip(("left", "right"), values.T, strict=True):
        found = counted(time, counts, per_pulse, clock)
        reader.notes.extend(
            note.replace("the odometer", f"the {name} odometer") for note in found.notes
        )
        speeds.append(
            np.gradient(np.interp(time, found.odometer.time, found.odometer.distance), time)
        )
    return SideSpeeds(time, speeds[0], speeds[1])


def _gnss(reader: _Reader) -> Gnss | None:
    if not reader.samples.has(GNSS):
        return None
    found, notes = read_fixes(reader.samples, reader.vehicle)
    reader.notes.extend(notes)
    return found


def _heading(reader: _Reader) -> ExternalHeading | None:
    if not reader.samples.has(("heading_deg",)):
        return None
    rows, values = reader.samples.group(("heading_deg",), "the external heading")
    heading = values[:, 0]
    blank = np.abs(heading) > FULL_TURN_DEG
    if blank.any():
        first = reader.samples.clock[rows[blank.argmax()]]
        reader.notes.append(
            f"{int(blank.sum())} cells of heading_deg are no heading, first "
            f"{heading[blank.argmax()]:g} at {first:.3f}: read as blank"
        )
        rows, heading = rows[~blank], heading[~blank]
    return ExternalHeading(reader.time(rows), np.deg2rad(heading)) if len(rows) else None


def _rover(reader: _Reader) -> RoverGear | None:
    """Running gear at the wheels' rows; a silent wheel is NaN, angles may come at other times."""
    samples = reader.samples
    if not samples.has(WHEELS):
        return None
    blank = np.full(len(samples.clock), np.nan)
    wheel = np.stack([samples.columns.get(name, blank) for name in WHEELS], -1)
    rows = np.flatnonzero(np.isfinite(wheel).any(-1))
    if len(rows) < 2:
        return None
    for names, what in ((STEERS, "steering"), (LINKS, "rocker and bogie")):
        if not samples.has(names):
            reader.notes.append(f"no {what} columns: taken as 0, straight and level")
    silent = [name for name, w in zip(WHEELS, wheel.T, strict=True) if not np.isfinite(w).any()]
    if silent:
        reader.notes.append(f"{', '.join(silent)} never reported: the other wheels decide")
    steer = np.stack([_angle(reader, name, rows) for name in STEERS], -1)
    link = [_angle(reader, name, rows) for name in LINKS]
    return RoverGear(reader.time(rows), wheel[rows], steer, link[0], link[1], link[2])


def _angle(reader: _Reader, name: str, rows: Rows) -> Array:
    """A joint's angle at `rows`, interpolated between its own samples; 0 without any."""
    column = reader.samples.columns.get(name)
    if column is None or not np.isfinite(column).any():
        return np.zeros(len(rows))
    known, clock = np.isfinite(column), reader.samples.clock
    return np.interp(clock[rows], clock[known], column[known])
