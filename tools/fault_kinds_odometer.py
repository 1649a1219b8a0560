"""Faults of the odometer."""

from functools import partial

import numpy as np
from fault_registry import Drive, fault


def _heard(drive: Drive) -> tuple[str, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """The odometer's column and its rows."""
    column = "odo_pulses" if "odo_pulses" in drive.table else "odo_speed"
    return column, np.flatnonzero(drive.table[column].notna())


def _width(drive: Drive, bits: int, signed: bool = False) -> None:
    counts = drive.table["odo_pulses"].to_numpy() + 2.0**bits / (1 + signed) - 500
    wrapped = counts % 2.0**bits
    drive.table["odo_pulses"] = np.where(
        signed & (wrapped >= 2.0 ** (bits - 1)), wrapped - 2.0**bits, wrapped
    )


for bits in (8, 12, 16, 24, 32):
    fault(f"counter_{bits}_bit", says="wraps", needs="odo_pulses")(partial(_width, bits=bits))
fault("counter_16_bit_signed", says="wraps", needs="odo_pulses")(
    partial(_width, bits=16, signed=True)
)


@fault("counter_reset", says="reset", needs="odo_pulses")
def reset(drive: Drive) -> None:
    on = slice(drive.moment, None)
    drive.table.loc[on, "odo_pulses"] -= drive.table.loc[on, "odo_pulses"].min()


def _wrong(drive: Drive, count: int, size: float) -> None:
    column, rows = _heard(drive)
    unit = drive.per_pulse if column == "odo_pulses" else 0.1
    at = drive.rng.choice(rows[100:-100], count, replace=False)
    drive.table[column] = drive.table[column].astype(float)
    drive.table.loc[at, column] += np.round(size / unit) * drive.rng.choice([-1, 1], count)


for count, size in ((1, 5.0), (10, 50.0), (1, 1e6)):
    fault(f"wrong_counts_{count}_{size:g}m", says="(wrong count|odometer)")(
        partial(_wrong, count=count, size=size)
    )


def _dead(drive: Drive, seconds: float) -> None:
    column, rows = _heard(drive)
    on = rows[(rows >= drive.moment) & (rows < drive.moment + seconds * drive.rate)]
    lost = drive.table.loc[on, column].to_numpy()
    drive.table.loc[on, column] = lost[0] if column == "odo_pulses" else 0.0
    if column == "odo_pulses":  # what was not counted is never counted
        drive.table.loc[on[-1] + 1 :, column] -= lost[-1] - lost[0]


for seconds in (20.0, 1e9):
    fault(f"dead_{seconds:g}s", says="odometer")(partial(_dead, seconds=seconds))


@fault("odometer_stuck_20s", says="odometer", needs="odo_speed")
def stuck(drive: Drive) -> None:
    on = drive.rows(drive.moment, 20.0)
    there = drive.table.loc[on, "odo_speed"].dropna()
    drive.table.loc[there.index, "odo_speed"] = there.iloc[0]


@fault("odometer_jumps_about", says="odometer")
def jumping(drive: Drive) -> None:
    column, rows = _heard(drive)
    on = rows[(rows >= drive.moment) & (rows < drive.moment + 20 * drive.rate)]
    if column == "odo_speed":
        drive.table.loc[on, column] = drive.rng.uniform(-30, 60, len(on))
    else:
        drive.table[column] = drive.table[column].astype(float)
        drive.table.loc[on, column] += np.round(drive.rng.normal(0, 10 / drive.per_pulse, len(on)))


@fault("odometer_silent_20s", says="odometer")
def silent(drive: Drive) -> None:
    column, rows = _heard(drive)
    on = rows[(rows >= drive.moment) & (rows < drive.moment + 20 * drive.rate)]
    drive.table.loc[on, column] = np.nan
