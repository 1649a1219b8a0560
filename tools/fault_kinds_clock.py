"""Faults of the IMU's clock, and samples that were lost."""

from functools import partial

import numpy as np
from fault_registry import IMU, Drive, fault


def _lost(drive: Drive, length: int, turn: bool) -> None:
    at = drive.turn if turn else drive.moment
    drive.drop(range(at, at + length))


for length in (1, 2, 4, 8, 50):
    for turn in (False, True):
        where = "turn" if turn else "drive"
        fault(f"lost_{length}_{where}", says="lost")(partial(_lost, length=length, turn=turn))


def _scattered(drive: Drive, share: float) -> None:
    keep = drive.rng.random(len(drive.table)) > share
    keep[:100] = True
    drive.drop(np.flatnonzero(~keep))


for share in (0.001, 0.01, 0.05):
    fault(f"lost_{share:g}", says="lost")(partial(_scattered, share=share))


def _silent(drive: Drive, seconds: float, imu_only: bool) -> None:
    on = drive.rows(drive.turn, seconds)
    if imu_only:
        drive.table.loc[on, IMU] = np.nan
    else:
        drive.drop(range(on.start, min(on.stop, len(drive.table) - 1000)))


for seconds in (2.0, 10.0, 60.0):
    fault(f"gap_of_all_{seconds:g}s", says="lost")(
        partial(_silent, seconds=seconds, imu_only=False)
    )
fault("gap_of_imu_10s", says="lost")(partial(_silent, seconds=10.0, imu_only=True))


def _late(drive: Drive, seconds: float) -> None:
    drive.restamp(drive.time + np.abs(drive.rng.normal(size=len(drive.table))) * seconds)


for seconds in (1e-4, 1e-3, 5e-3):
    fault(f"late_{1e3 * seconds:g}ms", says="stamps scatter")(partial(_late, seconds=seconds))


@fault("jitter_both_ways", says="stamps scatter")
def jitter(drive: Drive) -> None:
    drive.restamp(drive.time + drive.rng.normal(size=len(drive.table)) * 5e-4)


def _bursts(drive: Drive, size: int) -> None:
    t = drive.time
    last = np.minimum(np.arange(len(t)) // size * size + size - 1, len(t) - 1)
    drive.restamp(t[last])


for size in (5, 20):
    fault(f"bursts_of_{size}", says="stamps scatter")(partial(_bursts, size=size))


def _rounded(drive: Drive, seconds: float) -> None:
    drive.restamp(np.round(drive.time / seconds) * seconds)


for seconds in (1e-3, 2e-2):
    fault(f"rounded_{1e3 * seconds:g}ms", says="stamps scatter")(partial(_rounded, seconds=seconds))


@fault("stall_of_the_host", says="stamps scatter")
def stall(drive: Drive) -> None:
    t = drive.time
    on = slice(drive.moment, drive.moment + round(0.3 * drive.rate))
    t[on] = t[on.stop]
    drive.restamp(t)


@fault("late_and_lost", says="lost")
def late_and_lost(drive: Drive) -> None:
    _late(drive, 1e-3)
    _scattered(drive, 0.01)


@fault("clock_drifts_100ppm", says="clock")
def drifts(drive: Drive) -> None:
    drive.restamp(drive.time * (1 + 1e-4))


def _jump(drive: Drive, seconds: float) -> None:
    t = drive.time
    t[drive.moment :] += seconds
    drive.table["time"] = t


for seconds in (1.0, 100.0, 1e5, 1e12):
    fault(f"clock_jumps_{seconds:g}s", says="(clock|lost|time)")(partial(_jump, seconds=seconds))
fault("clock_set_back_0.5s", says="(clock|time)")(partial(_jump, seconds=-0.5))


def _absurd(drive: Drive, value: float) -> None:
    drive.table.loc[drive.moment, "time"] = value


for value in (1e300, -5.0):
    fault(f"absurd_time_{value:g}", says="time")(partial(_absurd, value=value))


@fault("held_samples", says="(stuck|lost|repeat)")
def held(drive: Drive) -> None:
    """The logger fills lost samples with the last one."""
    rows = drive.rng.choice(len(drive.table) - 100, len(drive.table) // 200, replace=False) + 50
    before = drive.table.loc[rows - 1, IMU].to_numpy()
    drive.table.loc[rows, IMU] = before
