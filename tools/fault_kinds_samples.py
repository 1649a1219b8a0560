"""Faults of single samples and stretches of the IMU."""

from functools import partial

import numpy as np
from fault_registry import ACCEL, GYRO, IMU, Drive, fault

G = 9.80665
SENSORS = {"gyro": GYRO, "accel": ACCEL}
SAYS = {"gyro": "gyro", "accel": "accelerometer"}


def _spiked(drive: Drive, column: str, size: float, count: int, length: int) -> None:
    at = drive.moment
    if count > 1:
        at = drive.rng.integers(2000, len(drive.table) - 2000, count)
    for row in np.atleast_1d(at):
        drive.table.loc[row : row + length - 1, column] += size * drive.rng.choice([-1, 1])


for sensor, sizes in (("gyro", (0.02, 0.1, 0.5, 10.0)), ("accel", (1.0, 4.0, 20.0, 981.0))):
    for axis in "xyz":
        for size in sizes:
            spike = partial(_spiked, column=f"{sensor}_{axis}", size=size, count=1, length=1)
            fault(f"spike_{sensor}_{axis}_{size:g}", says=f"{SAYS[sensor]}.*spike")(spike)
fault("spikes_many", says="accelerometer.*spike")(
    partial(_spiked, column="accel_y", size=100.0, count=20, length=1)
)
fault("spike_of_three_samples", says="gyro.*spike")(
    partial(_spiked, column="gyro_z", size=2.0, count=1, length=3)
)


def _absurd(drive: Drive, column: str, value: float) -> None:
    drive.table.loc[drive.moment, column] = value


for column in ("gyro_z", "accel_x"):
    for value in (1e300, -1e30, 1e6):
        said = f"({SAYS[column[:-2]]}|{column})"
        fault(f"absurd_{column}_{value:g}", says=said)(partial(_absurd, column=column, value=value))


def _held(drive: Drive, columns: list[str], seconds: float, zero: bool, bend: bool) -> None:
    on = drive.rows(
        (drive.turn if bend else drive.moment) - round(seconds * drive.rate / 2), seconds
    )
    value = 0.0 if zero else drive.table.loc[on.start, columns].to_numpy()
    drive.table.loc[on, columns] = value


for sensor, columns in SENSORS.items():
    for seconds in (0.5, 3.0, 10.0):
        for bend in (False, True):
            where = "turn" if bend else "drive"
            stuck = partial(_held, columns=columns, seconds=seconds, zero=False, bend=bend)
            fault(f"stuck_{sensor}_{where}_{seconds:g}", says=f"{SAYS[sensor]}.*stuck")(stuck)
    zeroed = partial(_held, columns=columns, seconds=2.0, zero=True, bend=True)
    fault(f"zeroed_{sensor}", says=f"{SAYS[sensor]}.*stuck")(zeroed)
fault("stuck_one_axis", says="gyro.*stuck")(
    partial(_held, columns=["gyro_z"], seconds=5.0, zero=False, bend=True)
)
fault("stuck_all", says="(gyro|accelerometer).*stuck")(
    partial(_held, columns=IMU, seconds=3.0, zero=False, bend=True)
)


def _clipped(drive: Drive, columns: list[str], share: float) -> None:
    for column in columns:
        x = drive.table[column]
        middle = x.median()
        most = float(np.quantile(np.abs(x - middle), share))
        drive.table[column] = x.clip(middle - most, middle + most)


fault("clipped_gyro_z", says="gyro.*clipped")(partial(_clipped, columns=["gyro_z"], share=0.995))
fault("clipped_accel_x", says="accelerometer.*clipped")(
    partial(_clipped, columns=["accel_x"], share=0.999)
)


@fault("blank_gyro_5s", says="(gyro|lost|inertial)")
def blank_gyro(drive: Drive) -> None:
    drive.table.loc[drive.rows(drive.turn, 5.0), GYRO] = np.nan


def _exchanged(drive: Drive, one: str, other: str, seconds: float) -> None:
    on = drive.rows(drive.moment, seconds)
    pair = drive.table.loc[on, [one, other]].to_numpy()
    drive.table.loc[on, [other, one]] = pair


fault("axes_exchanged_accel", says="(axes|accelerometer)")(
    partial(_exchanged, one="accel_x", other="accel_z", seconds=1e9)
)
fault("axes_exchanged_gyro", says="(axes|gyro)")(
    partial(_exchanged, one="gyro_x", other="gyro_z", seconds=1e9)
)
