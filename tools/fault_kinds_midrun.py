"""What happens to a recording in mid-run: loose connectors, reboots, other units, other vehicles.

Amounts are drawn from the drive's generator, so that every seed tries another.
"""

import numpy as np
from fault_kinds_users import FIX, between, moved_fixes, turned_imu
from fault_kinds_users import about as turned_about
from fault_registry import ACCEL, GYRO, IMU, Drive, fault

from graphnav.common.run import Array

G = 9.80665
DEG_H = np.deg2rad(1) / 3600


def _later(drive: Drive) -> slice:
    return slice(drive.moment, None)


def _odometer(drive: Drive) -> list[str]:
    """Columns of the odometer, of one or two sides."""
    names = ("odo_pulses", "odo_speed", "odo_left", "odo_right")
    return [name for name in names if name in drive.table]


def _with_fixes(drive: Drive, start: int, seconds: float) -> Array:
    """Rows with a fix from a row on for some seconds."""
    on = np.flatnonzero(drive.table["gnss_lat"].notna())
    return np.asarray(on[(on >= start) & (on < start + seconds * drive.rate)])


# ---- the IMU


@fault("connector_loose", says="lost|gyro|accelerometer")
def connector(drive: Drive) -> None:
    """For 20 s some 30 drop-outs of up to 0.3 s."""
    for _ in range(30):
        first = drive.moment + int(drive.rng.uniform(0, 20) * drive.rate)
        drive.table.loc[drive.rows(first, drive.rng.uniform(0.02, 0.3)), IMU] = np.nan


@fault("imu_rebooted", says="lost|bias")
def rebooted(drive: Drive) -> None:
    """Silent for 2 s, with biases of 20 deg/h and 1 mg more thereafter."""
    drive.table.loc[_later(drive), GYRO] += drive.rng.normal(0, 20 * DEG_H, 3)
    drive.table.loc[_later(drive), ACCEL] += drive.rng.normal(0, 1e-3 * G, 3)
    drive.table.loc[drive.rows(drive.moment, 2.0), IMU] = np.nan


@fault("gyro_deg_s_from_there", says="gyro")
def gyro_unit(drive: Drive) -> None:
    drive.table.loc[_later(drive), GYRO] = np.rad2deg(drive.table.loc[_later(drive), GYRO])


@fault("accel_in_g_from_there", says="accel|gravity")
def accel_unit(drive: Drive) -> None:
    drive.table.loc[_later(drive), ACCEL] /= G


def _sign(axis: str) -> None:
    @fault(f"sign_of_{axis}", says="gyro|axes|accel")
    def sign(drive: Drive) -> None:
        drive.table[axis] = -drive.table[axis]


for axis in ("gyro_x", "gyro_y", "accel_x", "accel_y"):
    _sign(axis)


def _dead(axis: str) -> None:
    @fault(f"dead_{axis}", says="gyro|accel|stuck")
    def dead(drive: Drive) -> None:
        drive.table.loc[_later(drive), axis] = 0.0


for axis in ("gyro_z", "gyro_y", "accel_y"):
    _dead(axis)


@fault("imu_knocked", says="axes|mount|IMU|accel|gyro")
def knocked(drive: Drive) -> None:
    """Turned in its mount by 5 to 15 deg about each axis."""
    R = np.eye(3)
    for k in range(3):
        R = turned_about(k, float(drive.rng.choice([-1, 1]) * drive.rng.uniform(5, 15))) @ R
    later = turned_imu(drive.table, R)
    drive.table.loc[_later(drive), IMU] = later.loc[_later(drive), IMU]


@fault("accel_saturates", says="accelerometer.*clipped|accelerometer")
def saturates(drive: Drive) -> None:
    """A range that the harder bumps exceed."""
    most = float(np.quantile(np.abs(drive.table["accel_z"].dropna()), 0.995))
    drive.table[ACCEL] = drive.table[ACCEL].clip(-most, most)


@fault("temperature_ramp", says="bias|gyro")
def ramp(drive: Drive) -> None:
    """Biases that grow by 60 deg/h and 3 mg over the run."""
    share = np.linspace(0, 1, len(drive.table))[:, None]
    drive.table[GYRO] += share * drive.rng.choice([-1, 1], 3) * 60 * DEG_H
    drive.table[ACCEL] += share * drive.rng.choice([-1, 1], 3) * 3e-3 * G


@fault("imu_filtered", says="late|filter|IMU|fixes")
def filtered(drive: Drive) -> None:
    """Means of the last 0.3 s."""
    width = max(2, round(0.3 * drive.rate))
    drive.table[IMU] = drive.table[IMU].rolling(width, min_periods=1).mean()


# ---- rows and clocks


@fault("imu_clock_drifts_500ppm", says="clock|late|delay")
def imu_clock(drive: Drive) -> None:
    """The odometer's and the receiver's samples come later and later against the IMU's."""
    for sensor in (_odometer(drive), FIX):
        names = [column for column in sensor if column in drive.table]
        on = np.flatnonzero(drive.table[names[0]].notna()) if names else np.zeros(0, int)
        rows = np.round(on * (1 + 5e-4)).astype(int)
        values = drive.table.loc[on, names].to_numpy()[rows < len(drive.table)]
        drive.table[names] = np.nan
        drive.table.loc[rows[rows < len(drive.table)], names] = values


@fault("rows_twice", says="twice|repeat|time|duplicate")
def twice(drive: Drive) -> None:
    """One row in a hundred stands twice."""
    extra = drive.rng.random(len(drive.table)) < 0.01
    drive.table = drive.table.loc[
        np.repeat(np.arange(len(extra)), 1 + extra)
    ].reset_index(drop=True)  # fmt: skip


@fault("rows_out_of_order", says="order|time")
def disorder(drive: Drive) -> None:
    """Rows overtake each other by up to five places."""
    place = np.arange(len(drive.table)) + drive.rng.uniform(0, 5, len(drive.table))
    drive.table = drive.table.iloc[np.argsort(place)].reset_index(drop=True)


@fault("half_the_rate_from_there", says="lost|rate|clock|uneven")
def half_rate(drive: Drive) -> None:
    """Every other row has no IMU, the one after it the mean of both."""
    pair = np.arange(drive.moment, len(drive.table) - 1, 2)
    mean = (drive.table.loc[pair, IMU].to_numpy() + drive.table.loc[pair + 1, IMU].to_numpy()) / 2
    drive.table.loc[pair + 1, IMU] = mean
    drive.table.loc[pair, IMU] = np.nan


def _zone(hours: float) -> None:
    @fault(f"time_zone_{hours:+g}h", says="clock|time|lost")
    def zone(drive: Drive) -> None:
        t = drive.time
        t[drive.moment :] += 3600 * hours
        drive.table["time"] = t


_zone(1.0)
_zone(-1.0)


@fault("files_concatenated", says="jump|clock|time|fixes|odometer")
def concatenated(drive: Drive) -> None:
    """A second recording, begun a minute later, with the stamps of the first continued."""
    t, skipped = drive.time, round(60 * drive.rate)
    cut = drive.moment
    if cut + 2 * skipped > len(t):
        skipped = (len(t) - cut) // 2
    drive.drop(range(cut, cut + skipped))
    drive.table["time"] = t[: len(drive.table)]


# ---- the odometer


def _scaled_from_there(name: str, by: float, says: str) -> None:
    @fault(name, says=says)
    def scaled(drive: Drive) -> None:
        for column in _odometer(drive):
            x = drive.table[column].astype(float).to_numpy(copy=True)
            there = x[: drive.moment]
            before = there[~np.isnan(there)][-1] if column == "odo_pulses" else 0.0
            x[drive.moment :] = before + by * (x[drive.moment :] - before)
            drive.table[column] = np.round(x) if column == "odo_pulses" else x


_scaled_from_there("pulses_doubled_from_there", 2.0, "odometer")
_scaled_from_there("wheel_changed", 1.03, "odometer scale|scale")
_scaled_from_there("odometer_reversed_from_there", -1.0, "odometer")


@fault("odometer_smoothed", says="odometer")
def smoothed(drive: Drive) -> None:
    """Means of a second, half a second late."""
    for column in _odometer(drive):
        told = drive.table[column].dropna().astype(float)
        width = max(2, round(len(told) / len(drive.table) * drive.rate))
        mean = told.rolling(width, min_periods=1).mean()
        drive.table[column] = mean.round() if column == "odo_pulses" else mean


@fault("odometer_single_zeros", says="odometer|count", needs="odo_speed")
def zeros(drive: Drive) -> None:
    """One speed in fifty reads zero."""
    on = np.flatnonzero(drive.table["odo_speed"].notna())
    drive.table.loc[on[drive.rng.random(len(on)) < 0.02], "odo_speed"] = 0.0


# ---- the fixes


@fault("multipath_under_a_bridge", says="fixes|gnss", needs="gnss_lat")
def bridge(drive: Drive) -> None:
    """15 s of fixes 30 to 60 m aside."""
    on = _with_fixes(drive, drive.moment, 15.0)
    aside = moved_fixes(drive.table, between(drive, 30, 60, True), between(drive, 30, 60, True), 5)
    drive.table.loc[on, FIX] = aside.loc[on, FIX]


@fault("fixes_of_another", says="fixes|gnss", needs="gnss_lat")
def another(drive: Drive) -> None:
    """For 30 s those of a vehicle that drives elsewhere."""
    on = _with_fixes(drive, drive.moment, 30.0)
    every = np.flatnonzero(drive.table["gnss_lat"].notna())
    elsewhere = every[: len(on)][::-1]
    drive.table.loc[on, FIX] = drive.table.loc[elsewhere, FIX].to_numpy()


@fault("fixes_frozen", says="fixes|gnss", needs="gnss_lat")
def frozen(drive: Drive) -> None:
    """For 30 s the same fix again and again."""
    on = _with_fixes(drive, drive.moment, 30.0)
    drive.table.loc[on, FIX] = drive.table.loc[on[0], FIX].to_numpy()


@fault("fixes_wrongly_fixed", says="fixes|gnss|sd|scatter|stray", needs="gnss_lat")
def wrongly_fixed(drive: Drive) -> None:
    """For 40 s 2 m aside, with an sd of 2 cm."""
    on = _with_fixes(drive, drive.moment, 40.0)
    aside = moved_fixes(drive.table, between(drive, 1, 3, True), between(drive, 1, 3, True), 0.5)
    drive.table.loc[on, FIX] = aside.loc[on, FIX]
    drive.table.loc[on, FIX[3:]] = 0.02


@fault("fixes_dragged_slowly", says="fixes|gnss", needs="gnss_lat")
def dragged(drive: Drive) -> None:
    """From there on the fixes leave at 0.05 to 0.3 m/s."""
    gone = np.maximum(drive.time - drive.time[drive.moment], 0.0) * between(drive, 0.05, 0.3)
    along = drive.rng.uniform(0, 2 * np.pi)
    drive.table = moved_fixes(drive.table, gone * np.cos(along), gone * np.sin(along), 0.0)


@fault("fixes_at_null_island", says="fixes|start|gnss|lat", needs="gnss_lat")
def null_island(drive: Drive) -> None:
    """Before the receiver knows, it says 0, 0."""
    drive.table.loc[_with_fixes(drive, 0, 20.0), FIX[:3]] = 0.0


@fault("fixes_in_bursts", says="fixes|late|delay", needs="gnss_lat")
def fix_bursts(drive: Drive) -> None:
    """Fixes wait until there are five and are stamped as they are sent."""
    on = np.flatnonzero(drive.table["gnss_lat"].notna())
    values = drive.table.loc[on, FIX].to_numpy()
    sent = on[np.minimum(np.arange(len(on)) // 5 * 5 + 4, len(on) - 1)] + np.arange(len(on)) % 5
    drive.table[FIX] = np.nan
    inside = sent < len(drive.table)
    drive.table.loc[sent[inside], FIX] = values[inside]


@fault("fixes_polled", says="fixes|repeat", needs="gnss_lat")
def polled(drive: Drive) -> None:
    """Each fix read five times before the next."""
    on = np.flatnonzero(drive.table["gnss_lat"].notna())
    apart = int(np.median(np.diff(on)))
    for k in range(1, 5):
        rows = on + k * apart // 5
        inside = rows < len(drive.table)
        drive.table.loc[rows[inside], FIX] = drive.table.loc[on[inside], FIX].to_numpy()


@fault("heading_sensor_magnetic", says="heading")
def magnetic(drive: Drive) -> None:
    """A sensor that leaves out the declination of 8 deg, once a second."""
    heading = np.unwrap(np.deg2rad(drive.truth["heading_deg"]))
    told = np.rad2deg(np.interp(drive.time, drive.truth["time"], heading)) + between(
        drive, 5, 12, True
    )
    told = (told + drive.rng.normal(0, 0.5, len(told))) % 360
    once = np.arange(len(told)) % max(1, round(drive.rate)) == 0
    drive.table["heading_deg"] = np.where(once, told, np.nan)
