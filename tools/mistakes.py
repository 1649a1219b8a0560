"""What users get wrong: one mistake each, made to a clean run and its vehicle file.

Kinds of `tools/faults.py`: functions of the run's table, the vehicle file's text and the truth's
moments that give table and text anew. Amounts are drawn from the moments' generator, so that
every seed tries another.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

Array = NDArray[np.float64]
GYRO = ["gyro_x", "gyro_y", "gyro_z"]
ACCEL = ["accel_x", "accel_y", "accel_z"]
FIX = ["gnss_lat", "gnss_lon", "gnss_height", "gnss_sd_e", "gnss_sd_n", "gnss_sd_u"]
SD = FIX[3:]
EARTH_M = 6.371e6  # radius


@dataclass(frozen=True)
class Moments:
    """When the true vehicle does what a mistake needs, and the generator of its amounts."""

    truth: DataFrame
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def between(self, low: float, high: float, either_sign: bool = False) -> float:
        """An amount within limits, of either sign where asked for."""
        sign = self.random.choice([-1.0, 1.0]) if either_sign else 1.0
        return float(sign * self.random.uniform(low, high))


Mistake = Callable[[DataFrame, str, Moments], tuple[DataFrame, str]]


@dataclass(frozen=True)
class Kind:
    """A mistake and what it needs of the run it is made to."""

    make: Mistake
    fixes: bool  # good fixes are used; otherwise none (--no-gnss)
    says: str  # a regular expression that the right cause matches


KINDS: dict[str, Kind] = {}


def mistake(says: str, *, fixes: bool = True) -> Callable[[Mistake], Mistake]:
    """Keep a mistake under its function's name."""

    def keep(make: Mistake) -> Mistake:
        KINDS[make.__name__] = Kind(make, fixes, says)
        return make

    return keep


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


@mistake("heading", fixes=True)
def heading_wrong_by_much(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """[start] heading 60 to 180 deg off."""
    return run, _heading_off(vehicle, m.between(60, 180, True))


@mistake("heading", fixes=True)
def heading_wrong(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """[start] heading 10 to 60 deg off."""
    return run, _heading_off(vehicle, m.between(10, 60, True))


@mistake("heading", fixes=True)
def heading_backwards(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The course one came from is stated."""
    return run, _heading_off(vehicle, 180.0)


@mistake("heading", fixes=True)
def heading_counterclockwise(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Counted from east, counter-clockwise."""
    return run, stated(
        vehicle, "start", "heading_deg", round((90 - value_of(vehicle, "heading_deg")) % 360, 3)
    )


@mistake("heading", fixes=True)
def heading_in_radians(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Radians where degrees are asked for."""
    heading = round(float(np.deg2rad(value_of(vehicle, "heading_deg"))), 4)
    return run, stated(vehicle, "start", "heading_deg", heading)


@mistake("heading", fixes=True)
def heading_magnetic(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """A declination of 3 to 12 deg left in."""
    return run, _heading_off(vehicle, m.between(3, 12, True))


def _heading_off(vehicle: str, deg: float) -> str:
    heading = (value_of(vehicle, "heading_deg") + deg) % 360
    return stated(vehicle, "start", "heading_deg", round(heading, 3))


# ---- how the IMU lies


def _turned_kind(name: str, R_of: Callable[[Moments], Array], fixes: bool) -> None:
    def make(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
        return turned_imu(run, R_of(m)), vehicle

    make.__name__ = name
    mistake(r"axes|mount|IMU|gravity", fixes=fixes)(make)


for _fixes in (True, False):
    _of = "" if _fixes else "_no_fixes"
    _turned_kind(f"imu_yawed_45{_of}", lambda m: about(2, m.between(20, 60, True)), _fixes)
    _turned_kind(f"imu_yawed_90{_of}", lambda m: about(2, 90.0), _fixes)
    _turned_kind(f"imu_yawed_180{_of}", lambda m: about(2, 180.0), _fixes)
    _turned_kind(f"imu_on_its_side{_of}", lambda m: about(1, 90.0), _fixes)
    _turned_kind(f"imu_upside_down{_of}", lambda m: about(1, 180.0), _fixes)
    _turned_kind(f"imu_pitched{_of}", lambda m: about(0, m.between(8, 25, True)), _fixes)
    _turned_kind(f"axes_mirrored_x{_of}", lambda m: np.diag([-1.0, 1.0, 1.0]), _fixes)
    _turned_kind(f"axes_mirrored_y{_of}", lambda m: np.diag([1.0, -1.0, 1.0]), _fixes)
    _turned_kind(f"axes_exchanged{_of}", lambda m: np.eye(3)[[1, 0, 2]], _fixes)


@mistake("axes|gravity", fixes=True)
def axes_said_frd(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The file is right-forward-up, the vehicle file says FRD."""
    return run, stated(vehicle, "imu", "axes", "FRD")


@mistake("axes|mount|IMU", fixes=True)
def axes_said_flu(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The file is right-forward-up, the vehicle file says FLU."""
    return run, stated(vehicle, "imu", "axes", "FLU")


@mistake("gyro|axes|IMU", fixes=True)
def gyro_z_sign(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Yaw rate counted clockwise."""
    return run.assign(gyro_z=-run["gyro_z"]), vehicle


@mistake("gyro|axes|IMU", fixes=True)
def gyro_axes_unlike_accel(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Gyro x and y exchanged, accelerometer right."""
    out = run.copy()
    out[GYRO[:2]] = run[["gyro_y", "gyro_x"]].to_numpy()
    return out, vehicle


# ---- units of the IMU


@mistake(r"deg/s|gyro", fixes=True)
def gyro_in_deg_s(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Degrees per second."""
    return run.assign(**{k: np.rad2deg(run[k]) for k in GYRO}), vehicle


@mistake(r"deg/h|gyro", fixes=True)
def gyro_in_deg_h(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Degrees per hour."""
    return run.assign(**{k: np.rad2deg(run[k]) * 3600 for k in GYRO}), vehicle


@mistake(r"gyro|deg", fixes=True)
def gyro_said_deg_s(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """rad/s in the file, deg/s said."""
    return run, stated(vehicle, "columns", "gyro", '{ unit = "deg/s" }')


@mistake(r"\bg\b|gravity", fixes=True)
def accel_in_g(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Multiples of gravity."""
    return run.assign(**{k: run[k] / 9.80665 for k in ACCEL}), vehicle


@mistake("gravity", fixes=True)
def gravity_missing(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Gravity was taken off."""
    return run.assign(accel_z=run["accel_z"] - 9.80665), vehicle


@mistake("gravity", fixes=True)
def gravity_downwards(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Accelerations of the case, gravity down: all signs changed."""
    return run.assign(**{k: -run[k] for k in ACCEL}), vehicle


@mistake("gyro|scale", fixes=True)
def gyro_ten_percent(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """A factor of a count wrong by 5 to 12 %."""
    by = 1 + m.between(0.05, 0.12, True)
    return run.assign(**{k: run[k] * by for k in GYRO}), vehicle


# ---- the odometer


@mistake("km/h|odometer|scale", fixes=True)
def odometer_in_km_h(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Kilometres per hour; counters 3.6 times as many."""
    return scaled_odometer(run, 3.6), vehicle


@mistake("km/h|odometer|scale", fixes=False)
def odometer_in_km_h_no_fixes(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The same without fixes."""
    return scaled_odometer(run, 3.6), vehicle


@mistake("odometer|scale|pulse", fixes=True)
def odometer_twice(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Both edges of a pulse counted."""
    return scaled_odometer(run, 2.0), vehicle


@mistake("odometer|scale|pulse", fixes=True)
def odometer_in_mph(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Miles per hour."""
    return scaled_odometer(run, 2.2369), vehicle


@mistake("odometer|scale|pulse", fixes=True)
def odometer_ten_percent(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Another tyre's constant."""
    return scaled_odometer(run, 1 + m.between(0.06, 0.15, True)), vehicle


@mistake("odometer|scale|pulse", fixes=False)
def odometer_ten_percent_no_fixes(
    run: DataFrame, vehicle: str, m: Moments
) -> tuple[DataFrame, str]:
    """Another tyre's constant, nothing but the accelerometers to tell."""
    return scaled_odometer(run, 1 + m.between(0.06, 0.15, True)), vehicle


@mistake("odometer|direction|reverse|backward", fixes=True)
def odometer_reversed(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Forward counted as backward."""
    return scaled_odometer(run, -1.0), vehicle


@mistake("odometer|direction|reverse|backward", fixes=False)
def odometer_reversed_no_fixes(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The same without fixes."""
    return scaled_odometer(run, -1.0), vehicle


@mistake("odometer", fixes=True)
def odometer_late(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Its clock 1 to 3 s late."""
    out = run.copy()
    shift = round(m.between(1, 3) / float(run["time"].diff().median()))
    for name in ("odo_speed", "odo_pulses"):
        if name in out:
            out[name] = out[name].shift(shift)
    return out, vehicle


@mistake("odometer|lever", fixes=True)
def odometer_lever_in_cm(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Centimetres where metres are asked for."""
    return run, stated(vehicle, "odometer", "lever_arm", "[20.0, -140.0, 90.0]")


@mistake("mount|odometer", fixes=True)
def mounting_stated_wrong(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """A mounting of 10 to 30 deg that is not there."""
    return run, stated(
        vehicle, "odometer", "mount_deg", f"[0.0, 0.0, {m.between(10, 30, True):.2f}]"
    )


# ---- fixes: where


@mistake("longitude", fixes=True)
def longitude_sign(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """West told as east; [start] right."""
    return run.assign(gnss_lon=-run["gnss_lon"]), vehicle


@mistake("longitude", fixes=True)
def longitude_sign_both(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The same sign lost in [start]."""
    lon = -value_of(vehicle, "lon")
    return run.assign(gnss_lon=-run["gnss_lon"]), stated(vehicle, "start", "lon", lon)


@mistake("latitude", fixes=True)
def latitude_sign_both(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """South told as north, in [start] too."""
    lat = -value_of(vehicle, "lat")
    return run.assign(gnss_lat=-run["gnss_lat"]), stated(vehicle, "start", "lat", lat)


@mistake("lat.*lon|exchange|swap", fixes=True)
def lat_lon_swapped(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Latitude and longitude exchanged (where both are below 90 deg)."""
    lon = run["gnss_lon"] - round(float(run["gnss_lon"].median()) - 20)
    return run.assign(gnss_lat=lon, gnss_lon=run["gnss_lat"]), vehicle


@mistake("datum|offset|fixes|start", fixes=True)
def datum_shift(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Another datum: 60 to 200 m, all fixes alike."""
    return moved_fixes(run, m.between(60, 200, True), m.between(60, 200, True), 0.0), vehicle


@mistake("height", fixes=True)
def height_geoid(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Heights above sea level."""
    return moved_fixes(run, 0.0, 0.0, m.between(15, 50, True)), vehicle


@mistake("height", fixes=True)
def height_in_feet(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Feet."""
    return run.assign(gnss_height=run["gnss_height"] / 0.3048), vehicle


@mistake("height", fixes=True)
def height_zero(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """2D fixes: height 0."""
    return run.assign(gnss_height=run["gnss_height"] * 0), vehicle


@mistake("lat|lon|minutes|fixes", fixes=True)
def degrees_minutes(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """NMEA's ddmm.mmmm over 100."""

    def told(column: str) -> Array:
        x = run[column].to_numpy()
        whole = np.trunc(x)
        return np.asarray(whole + (x - whole) * 0.6)

    return run.assign(gnss_lat=told("gnss_lat"), gnss_lon=told("gnss_lon")), vehicle


@mistake("fixes|rounded|digits|decimals|scatter", fixes=True)
def few_decimals(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Degrees with four decimals: 11 m steps."""
    return run.assign(gnss_lat=run["gnss_lat"].round(4), gnss_lon=run["gnss_lon"].round(4)), vehicle


# ---- fixes: when, how good, antenna


@mistake("late|delay|time", fixes=True)
def fixes_late(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Stamped when they arrive, 0.6 to 3 s late."""
    return later_fixes(run, m.between(0.6, 3.0)), vehicle


@mistake("early|delay|time|late", fixes=True)
def fixes_early(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Early by 0.6 to 2 s."""
    return later_fixes(run, -m.between(0.6, 2.0)), vehicle


@mistake("late|delay|time|leap", fixes=True)
def fixes_leap_seconds(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """GPS against UTC: 18 s."""
    return later_fixes(run, 18.0), vehicle


@mistake("sd|scatter|sigma|noise", fixes=True)
def sds_too_small(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Ten to a hundred times too good."""
    return run.assign(**{k: run[k] / m.between(10, 100) for k in SD}), vehicle


@mistake("sd|scatter|sigma|noise", fixes=True)
def sds_too_large(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Ten times too bad."""
    return run.assign(**{k: run[k] * 10 for k in SD}), vehicle


@mistake("sd|scatter|sigma|noise", fixes=True)
def sds_are_hdop(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """A DOP of 0.8 for everybody."""
    return run.assign(**{k: run[k] * 0 + 0.8 for k in SD}), vehicle


@mistake("antenna|lever", fixes=True)
def antenna_sign(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """A lever arm told from the antenna to the IMU: the sign is wrong."""
    return _antenna(run, vehicle, m, (2.0, 4.0), -1.0)


@mistake("antenna|lever", fixes=True)
def antenna_in_cm(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Centimetres where metres are asked for."""
    return _antenna(run, vehicle, m, (0.5, 2.0), 100.0)


@mistake("antenna|lever", fixes=True)
def antenna_forgotten(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """On a lorry's cab, 3 to 5 m away, not told."""
    return _antenna(run, vehicle, m, (3.0, 5.0), 0.0)


def _antenna(
    run: DataFrame, vehicle: str, m: Moments, size: tuple[float, float], told: float
) -> tuple[DataFrame, str]:
    """An antenna somewhere ahead; `told` times its true lever arm is stated."""
    ahead, right = m.between(*size), 0.3 * m.between(*size, True)
    heading = np.unwrap(np.deg2rad(m.truth["heading_deg"]))
    at = np.interp(run["time"], m.truth["time"], heading)
    east = ahead * np.sin(at) + right * np.cos(at)
    north = ahead * np.cos(at) - right * np.sin(at)
    lever = f"[{told * right:.3f}, {told * ahead:.3f}, 0.0]"
    return moved_fixes(run, east, north, 0.0), stated(vehicle, "gnss", "lever_arm", lever)


# ---- [start], time, the vehicle


@mistake("start", fixes=True)
def start_of_another_day(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """[start] 0.5 to 3 km away, the first fix after a minute."""
    lat = value_of(vehicle, "lat") + np.rad2deg(m.between(500, 3000, True) / EARTH_M)
    out, late = run.copy(), run["time"] < run["time"].iloc[0] + 60
    out.loc[late, FIX] = np.nan
    return out, stated(vehicle, "start", "lat", round(lat, 7))


@mistake("start|km", fixes=True)
def start_far_away(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """[start] of another country."""
    lat = value_of(vehicle, "lat") - 6.0
    out, late = run.copy(), run["time"] < run["time"].iloc[0] + 60
    out.loc[late, FIX] = np.nan
    return out, stated(vehicle, "start", "lat", lat)


@mistake("ms|clock|unit", fixes=True)
def time_in_ms(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Milliseconds."""
    return run.assign(time=(run["time"] * 1000).round(3)), vehicle


@mistake("grade|noise|IMU", fixes=True)
def grade_too_good(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Navigation grade said of what it is not."""
    return run, _graded(vehicle, "navigation")


@mistake("grade|noise|IMU", fixes=False)
def grade_too_good_no_fixes(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The same without fixes."""
    return run, _graded(vehicle, "navigation")


@mistake("grade|noise|IMU", fixes=True)
def grade_too_bad(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """MEMS said of what is better."""
    return run, _graded(vehicle, "mems")


def _graded(vehicle: str, grade: str) -> str:
    """The vehicle file with a grade for the figures of the IMU."""
    text = re.sub(r"(?m)^(gyro|accel)_(bias|noise)_.*\n", "", vehicle)
    return stated(text, "imu", "grade", grade)


@mistake("kind|odometer|gauge", fixes=True)
def kind_wrong(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Wheels for tracks or tracks for wheels."""
    other = "tracked" if 'kind = "wheeled"' in vehicle else "wheeled"
    return run, stated(vehicle, "vehicle", "kind", other)


@mistake("kind|odometer|gauge", fixes=False)
def kind_wrong_no_fixes(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """The same without fixes."""
    return kind_wrong(run, vehicle, m)


@mistake("gauge|odometer", fixes=True)
def gauge_in_cm(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Centimetres of track gauge, on a tracked vehicle."""
    return run, stated(
        stated(vehicle, "vehicle", "kind", "tracked"), "vehicle", "track_gauge", 28.0
    )


@mistake("gyro|Earth|latitude|clock", fixes=True)
def other_runs_fixes(run: DataFrame, vehicle: str, m: Moments) -> tuple[DataFrame, str]:
    """Fixes of another drive: those of this one in reverse order."""
    out, on = run.copy(), run["gnss_lat"].notna()
    out.loc[on, FIX] = run.loc[on, FIX].to_numpy()[::-1]
    return out, vehicle
