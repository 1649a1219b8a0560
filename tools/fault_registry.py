"""Faults to put into a run: each kind a function, found by its name.

    @fault("one_row_lost", says="lost")
    def one_row_lost(drive: Drive) -> None:
        drive.drop([drive.moment])

`says` is what a finding that names the cause has to hold (a regular expression, in small letters).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from graphnav.common.run import Array

GYRO = ["gyro_x", "gyro_y", "gyro_z"]
ACCEL = ["accel_x", "accel_y", "accel_z"]
IMU = [*GYRO, *ACCEL]


@dataclass
class Drive:
    """A run to be spoilt, in place, and where in it something happens."""

    table: pd.DataFrame
    vehicle: str  # text of the vehicle file
    rng: np.random.Generator
    moment: int  # a row of brisk driving
    turn: int  # a row of the sharpest turn
    per_pulse: float  # m
    rate: float  # Hz
    truth: pd.DataFrame

    @property
    def time(self) -> Array:
        """Stamps of the rows (N,) s."""
        return np.array(self.table["time"], float)

    def drop(self, rows: Iterable[int] | Array) -> None:
        """Take rows out."""
        self.table = self.table.drop(index=list(rows)).reset_index(drop=True)

    def restamp(self, time: Array) -> None:
        """Other stamps, in increasing order by a microsecond at least."""
        least = 1e-6 * np.arange(len(time))
        self.table["time"] = np.maximum.accumulate(time - least) + least

    def rows(self, start: int, seconds: float) -> slice:
        """Row labels from `start` for some seconds."""
        return slice(start, start + round(seconds * self.rate) - 1)


Spoil = Callable[[Drive], None]


@dataclass(frozen=True)
class Fault:
    """A kind of fault."""

    name: str
    spoil: Spoil
    says: str
    needs: str = ""  # a column the run must have


FAULTS: dict[str, Fault] = {}


def fault(name: str, says: str, needs: str = "") -> Callable[[Spoil], Spoil]:
    """Register a kind of fault."""

    def keep(spoil: Spoil) -> Spoil:
        FAULTS[name] = Fault(name, spoil, says, needs)
        return spoil

    return keep
