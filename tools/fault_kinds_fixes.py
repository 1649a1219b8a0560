"""What users get wrong about fixes, antenna, start, time and the vehicle: one mistake each."""

import re

import numpy as np
from fault_kinds_users import (
    EARTH_M,
    FIX,
    SD,
    between,
    later_fixes,
    mistake,
    moved_fixes,
    stated,
    value_of,
)
from fault_registry import Drive
from pandas import DataFrame

from graphnav.common.run import Array

# ---- fixes: where


@mistake("longitude")
def longitude_sign(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """West told as east; [start] right."""
    return run.assign(gnss_lon=-run["gnss_lon"]), vehicle


@mistake("longitude")
def longitude_sign_both(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """The same sign lost in [start]."""
    lon = -value_of(vehicle, "lon")
    return run.assign(gnss_lon=-run["gnss_lon"]), stated(vehicle, "start", "lon", lon)


@mistake("latitude")
def latitude_sign_both(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """South told as north, in [start] too."""
    lat = -value_of(vehicle, "lat")
    return run.assign(gnss_lat=-run["gnss_lat"]), stated(vehicle, "start", "lat", lat)


@mistake("lat.*lon|exchange|swap")
def lat_lon_swapped(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Latitude and longitude exchanged (where both are below 90 deg)."""
    lon = run["gnss_lon"] - round(float(run["gnss_lon"].median()) - 20)
    return run.assign(gnss_lat=lon, gnss_lon=run["gnss_lat"]), vehicle


@mistake("datum|offset|fixes|start")
def datum_shift(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Another datum: 60 to 200 m, all fixes alike."""
    return moved_fixes(run, between(m, 60, 200, True), between(m, 60, 200, True), 0.0), vehicle


@mistake("height")
def height_geoid(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Heights above sea level."""
    return moved_fixes(run, 0.0, 0.0, between(m, 15, 50, True)), vehicle


@mistake("height")
def height_in_feet(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Feet."""
    return run.assign(gnss_height=run["gnss_height"] / 0.3048), vehicle


@mistake("height")
def height_zero(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """2D fixes: height 0."""
    return run.assign(gnss_height=run["gnss_height"] * 0), vehicle


@mistake("lat|lon|minutes|fixes")
def degrees_minutes(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """NMEA's ddmm.mmmm over 100."""

    def told(column: str) -> Array:
        x = run[column].to_numpy()
        whole = np.trunc(x)
        return np.asarray(whole + (x - whole) * 0.6)

    return run.assign(gnss_lat=told("gnss_lat"), gnss_lon=told("gnss_lon")), vehicle


@mistake("fixes|rounded|digits|decimals|scatter")
def few_decimals(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Degrees with four decimals: 11 m steps."""
    return run.assign(gnss_lat=run["gnss_lat"].round(4), gnss_lon=run["gnss_lon"].round(4)), vehicle


# ---- fixes: when, how good, antenna


@mistake("late|delay|time")
def fixes_late(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Stamped when they arrive, 0.6 to 3 s late."""
    return later_fixes(run, between(m, 0.6, 3.0)), vehicle


@mistake("early|delay|time|late")
def fixes_early(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Early by 0.6 to 2 s."""
    return later_fixes(run, -between(m, 0.6, 2.0)), vehicle


@mistake("late|delay|time|leap")
def fixes_leap_seconds(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """GPS against UTC: 18 s."""
    return later_fixes(run, 18.0), vehicle


@mistake("sd|scatter|sigma|noise")
def sds_too_small(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Ten to a hundred times too good."""
    return run.assign(**{k: run[k] / between(m, 10, 100) for k in SD}), vehicle


@mistake("sd|scatter|sigma|noise")
def sds_too_large(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Ten times too bad."""
    return run.assign(**{k: run[k] * 10 for k in SD}), vehicle


@mistake("sd|scatter|sigma|noise")
def sds_are_hdop(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """A DOP of 0.8 for everybody."""
    return run.assign(**{k: run[k] * 0 + 0.8 for k in SD}), vehicle


@mistake("antenna|lever")
def antenna_sign(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """A lever arm told from the antenna to the IMU: the sign is wrong."""
    return _antenna(run, vehicle, m, (2.0, 4.0), -1.0)


@mistake("antenna|lever")
def antenna_in_cm(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Centimetres where metres are asked for."""
    return _antenna(run, vehicle, m, (0.5, 2.0), 100.0)


@mistake("antenna|lever")
def antenna_forgotten(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """On a lorry's cab, 3 to 5 m away, not told."""
    return _antenna(run, vehicle, m, (3.0, 5.0), 0.0)


def _antenna(
    run: DataFrame, vehicle: str, m: Drive, size: tuple[float, float], told: float
) -> tuple[DataFrame, str]:
    """An antenna somewhere ahead; `told` times its true lever arm is stated."""
    ahead, right = between(m, *size), 0.3 * between(m, *size, True)
    heading = np.unwrap(np.deg2rad(m.truth["heading_deg"]))
    at = np.interp(run["time"], m.truth["time"], heading)
    east = ahead * np.sin(at) + right * np.cos(at)
    north = ahead * np.cos(at) - right * np.sin(at)
    lever = f"[{told * right:.3f}, {told * ahead:.3f}, 0.0]"
    return moved_fixes(run, east, north, 0.0), stated(vehicle, "gnss", "lever_arm", lever)


# ---- [start], time, the vehicle


@mistake("start")
def start_of_another_day(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """[start] 0.5 to 3 km away, the first fix after a minute."""
    lat = value_of(vehicle, "lat") + np.rad2deg(between(m, 500, 3000, True) / EARTH_M)
    out, late = run.copy(), run["time"] < run["time"].iloc[0] + 60
    out.loc[late, FIX] = np.nan
    return out, stated(vehicle, "start", "lat", round(lat, 7))


@mistake("start|km")
def start_far_away(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """[start] of another country."""
    lat = value_of(vehicle, "lat") - 6.0
    out, late = run.copy(), run["time"] < run["time"].iloc[0] + 60
    out.loc[late, FIX] = np.nan
    return out, stated(vehicle, "start", "lat", lat)


@mistake("ms|clock|unit", fixes=False)
def time_in_ms(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Milliseconds."""
    return run.assign(time=(run["time"] * 1000).round(3)), vehicle


@mistake("grade|noise|IMU", fixes=False)
def grade_too_good(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Navigation grade said of what it is not."""
    return run, _graded(vehicle, "navigation")


@mistake("grade|noise|IMU", fixes=False)
def grade_too_bad(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """MEMS said of what is better."""
    return run, _graded(vehicle, "mems")


def _graded(vehicle: str, grade: str) -> str:
    """The vehicle file with a grade for the figures of the IMU."""
    text = re.sub(r"(?m)^(gyro|accel)_(bias|noise)_.*\n", "", vehicle)
    return stated(text, "imu", "grade", grade)


@mistake("kind|odometer|gauge", fixes=False)
def kind_wrong(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Wheels for tracks or tracks for wheels."""
    other = "tracked" if 'kind = "wheeled"' in vehicle else "wheeled"
    return run, stated(vehicle, "vehicle", "kind", other)


@mistake("gauge|odometer", fixes=False)
def gauge_in_cm(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Centimetres of track gauge, on a tracked vehicle."""
    return run, stated(
        stated(vehicle, "vehicle", "kind", "tracked"), "vehicle", "track_gauge", 28.0
    )


@mistake("gyro|Earth|latitude|clock")
def other_runs_fixes(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """Fixes of another drive: those of this one in reverse order."""
    out, on = run.copy(), run["gnss_lat"].notna()
    out.loc[on, FIX] = run.loc[on, FIX].to_numpy()[::-1]
    return out, vehicle


@mistake("mount|odometer", fixes=False)
def mounting_stated_wrong(run: DataFrame, vehicle: str, m: Drive) -> tuple[DataFrame, str]:
    """A mounting of 10 to 30 deg that is not there."""
    return run, stated(
        vehicle, "odometer", "mount_deg", f"[0.0, 0.0, {between(m, 10, 30, True):.2f}]"
    )
