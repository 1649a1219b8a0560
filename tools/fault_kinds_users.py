"""What users get wrong: one mistake each, made to a run's table and the text of its vehicle file.

Amounts are drawn from the drive's generator, so that every seed tries another.
"""

import re
from collections.abc import Callable

import numpy as np
from fault_registry import ACCEL, GYRO, Drive, fault
from pandas import DataFrame

from graphnav.common.run import Array

FIX = ["gnss_lat", "gnss_lon", "gnss_height", "gnss_sd_e", "gnss_sd_n", "gnss_sd_u"]
SD = FIX[3:]
EARTH_M = 6.371e6  # radius

Mistake = Callable[[DataFrame, str, Drive], tuple[DataFrame, str]]


def mistake(says: str, *, fixes: bool = True) -> Callable[[Mistake], Mistake]:
    """Register a mistake under its function's name; with `fixes`, for runs that have some."""

    def keep(make: Mistake) -> Mistake:
        def spoil(drive: Drive) -> None:
            drive.table, drive.vehicle = make(drive.table, drive.vehicle, drive)

        fault(make.__name__, says.lower(), "gnss_lat" if fixes else "")(spoil)
        return make

    return keep


def between(m: Drive, low: float, high: float, either_sign: bool = False) -> float:
    """An amount within limits, of either sign where asked for."""
    sign = m.rng.choice([-1.0, 1.0]) if either_sign else 1.0
    return float(sign * m.rng.uniform(low, high))


def stated(text: str, section: str, key: str, value: object) -> str:
    """The vehicle file with a key of a section set anew."""
    told = f'"{value}"' if isinstance(value, str) and not value.startswith(("{", "[")) else value
    line = f"{key} = {told}"
    parts = re.split(r"(?m)^(?=\[)", text)
    for k, part in enumerate(parts):
        if part.startswith(f"[{section}]"):
            kept = [row for row in part.rstrip().split("\n") if not re.match(rf"{key}\s*=", row)]
            parts[k] = "\n".join([*kept, line]) + "\n\n"
            return "".join(parts)
    return f"{text.rstrip()}\n\n[{section}]\n{line}\n"


def value_of(text: str, key: str) -> float:
    """A number the vehicle file states."""
    found = re.search(rf"(?m)^{key}\s*=\s*(\S+)", text)
    assert found, key
    return float(found[1])


def turned_imu(run: DataFrame, R: Array) -> DataFrame:
    """The run with IMU axes turned: `R` (3, 3) from the old axes to the new."""
    out = run.copy()
    for names in (GYRO, ACCEL):
        out[names] = run[names].to_numpy() @ R.T
    return out


def about(axis: int, deg: float) -> Array:
    """Rotation matrix about one axis."""
    c, s = np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg))
    R = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def moved_fixes(run: DataFrame, east: Array | float, north: Array | float, up: float) -> DataFrame:
    """The run with its fixes moved by metres."""
    out = run.copy()
    per = np.rad2deg(1 / EARTH_M)
    out["gnss_lat"] += north * per
    out["gnss_lon"] += east * per / np.cos(np.deg2rad(run["gnss_lat"]))
    out["gnss_height"] += up
    return out


def later_fixes(run: DataFrame, seconds: float) -> DataFrame:
    """The run with its fixes told later, at the next row of the IMU."""
    out, on = run.copy(), run["gnss_lat"].notna().to_numpy()
    rows = np.searchsorted(run["time"], run["time"][on] + seconds)
    inside = (rows < len(run)) & (run["time"][on].to_numpy() + seconds >= run["time"].iloc[0])
    values = run.loc[on, FIX].to_numpy()[inside]
    out[FIX] = np.nan
    out.iloc[rows[inside], [out.columns.get_loc(c) for c in FIX]] = values
    return out


def scaled_odometer(run: DataFrame, by: float) -> DataFrame:
    """The run with the odometer's column scaled."""
    out = run.copy()
    for name in ("odo_speed", "odo_pulses"):
        if name in out:
            scaled = out[name] * by
            out[name] = np.round(scaled) if name == "odo_pulses" else scaled
    return out


# ---- where it points


@mistake("heading")
def heading_wrong_by_much(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """[start] heading 60 to 180 deg off."""
    return run, _heading_off(vehicle, between(m, 60, 180, True))


@mistake("heading")
def heading_wrong(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """[start] heading 10 to 60 deg off."""
    return run, _heading_off(vehicle, between(m, 10, 60, True))


@mistake("heading")
def heading_backwards(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """The course one came from is stated."""
    return run, _heading_off(vehicle, 180.0)


@mistake("heading")
def heading_counterclockwise(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Counted from east, counter-clockwise."""
    return run, stated(
        vehicle, "start", "heading_deg", round((90 - value_of(vehicle, "heading_deg")) % 360, 3)
    )


@mistake("heading")
def heading_in_radians(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Radians where degrees are asked for."""
    heading = round(float(np.deg2rad(value_of(vehicle, "heading_deg"))), 4)
    return run, stated(vehicle, "start", "heading_deg", heading)


@mistake("heading")
def heading_magnetic(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """A declination of 3 to 12 deg left in."""
    return run, _heading_off(vehicle, between(m, 3, 12, True))


def _heading_off(vehicle: str, deg: float) -> str:
    heading = (value_of(vehicle, "heading_deg") + deg) % 360
    return stated(vehicle, "start", "heading_deg", round(heading, 3))


# ---- how the IMU lies


def _turned_kind(name: str, R_of: Callable[[Drive], Array]) -> None:
    def make(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
        return turned_imu(run, R_of(m)), vehicle

    make.__name__ = name
    mistake(r"axes|mount|IMU|gravity", fixes=False)(make)


_turned_kind("imu_yawed_45", lambda m: about(2, between(m, 20, 60, True)))
_turned_kind("imu_yawed_90", lambda m: about(2, 90.0))
_turned_kind("imu_yawed_180", lambda m: about(2, 180.0))
_turned_kind("imu_on_its_side", lambda m: about(1, 90.0))
_turned_kind("imu_upside_down", lambda m: about(1, 180.0))
_turned_kind("imu_pitched", lambda m: about(0, between(m, 8, 25, True)))
_turned_kind("axes_mirrored_x", lambda m: np.diag([-1.0, 1.0, 1.0]))
_turned_kind("axes_mirrored_y", lambda m: np.diag([1.0, -1.0, 1.0]))
_turned_kind("axes_exchanged", lambda m: np.eye(3)[[1, 0, 2]])


@mistake("axes|gravity", fixes=False)
def axes_said_frd(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """The file is right-forward-up, the vehicle file says FRD."""
    return run, stated(vehicle, "imu", "axes", "FRD")


@mistake("axes|mount|IMU", fixes=False)
def axes_said_flu(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """The file is right-forward-up, the vehicle file says FLU."""
    return run, stated(vehicle, "imu", "axes", "FLU")


@mistake("gyro|axes|IMU", fixes=False)
def gyro_z_sign(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Yaw rate counted clockwise."""
    return run.assign(gyro_z=-run["gyro_z"]), vehicle


@mistake("gyro|axes|IMU", fixes=False)
def gyro_axes_unlike_accel(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Gyro x and y exchanged, accelerometer right."""
    out = run.copy()
    out[GYRO[:2]] = run[["gyro_y", "gyro_x"]].to_numpy()
    return out, vehicle


# ---- units of the IMU


@mistake(r"deg/s|gyro", fixes=False)
def gyro_in_deg_s(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Degrees per second."""
    return run.assign(**{k: np.rad2deg(run[k]) for k in GYRO}), vehicle


@mistake(r"deg/h|gyro", fixes=False)
def gyro_in_deg_h(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Degrees per hour."""
    return run.assign(**{k: np.rad2deg(run[k]) * 3600 for k in GYRO}), vehicle


@mistake(r"gyro|deg", fixes=False)
def gyro_said_deg_s(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """rad/s in the file, deg/s said."""
    return run, stated(vehicle, "columns", "gyro", '{ unit = "deg/s" }')


@mistake(r"\bg\b|gravity", fixes=False)
def accel_in_g(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Multiples of gravity."""
    return run.assign(**{k: run[k] / 9.80665 for k in ACCEL}), vehicle


@mistake("gravity", fixes=False)
def gravity_missing(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Gravity was taken off."""
    return run.assign(accel_z=run["accel_z"] - 9.80665), vehicle


@mistake("gravity", fixes=False)
def gravity_downwards(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Accelerations of the case, gravity down: all signs changed."""
    return run.assign(**{k: -run[k] for k in ACCEL}), vehicle


@mistake("gyro|scale", fixes=False)
def gyro_ten_percent(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """A factor of a count wrong by 5 to 12 %."""
    by = 1 + between(m, 0.05, 0.12, True)
    return run.assign(**{k: run[k] * by for k in GYRO}), vehicle


# ---- the odometer


@mistake("km/h|odometer|scale", fixes=False)
def odometer_in_km_h(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Kilometres per hour; counters 3.6 times as many."""
    return scaled_odometer(run, 3.6), vehicle


@mistake("odometer|scale|pulse", fixes=False)
def odometer_twice(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Both edges of a pulse counted."""
    return scaled_odometer(run, 2.0), vehicle


@mistake("odometer|scale|pulse", fixes=False)
def odometer_in_mph(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Miles per hour."""
    return scaled_odometer(run, 2.2369), vehicle


@mistake("odometer|scale|pulse", fixes=False)
def odometer_ten_percent(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Another tyre's constant."""
    return scaled_odometer(run, 1 + between(m, 0.06, 0.15, True)), vehicle


@mistake("odometer|direction|reverse|backward", fixes=False)
def odometer_reversed(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Forward counted as backward."""
    return scaled_odometer(run, -1.0), vehicle


@mistake("odometer", fixes=False)
def odometer_late(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Its clock 1 to 3 s late."""
    out = run.copy()
    shift = round(between(m, 1, 3) / float(run["time"].diff().median()))
    for name in ("odo_speed", "odo_pulses"):
        if name in out:
            out[name] = out[name].shift(shift)
    return out, vehicle


@mistake("odometer|lever", fixes=False)
def odometer_lever_in_cm(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Centimetres where metres are asked for."""
    return run, stated(vehicle, "odometer", "lever_arm", "[20.0, -140.0, 90.0]")
