"""Satellite fixes as receivers and loggers write them: what is no fix, what a deviation is worth.

A cell that stands for "not known" (a deviation of 0 or 9999, a height of 0 among others) is read as
not known. What was left out or read otherwise than it stands is told in notes.
"""

import numpy as np
from numpy.typing import NDArray

from graphnav.common.angles import wrapped
from graphnav.common.earth import Origin
from graphnav.common.run import Gnss
from graphnav.reading.columns import GNSS, GNSS_SD
from graphnav.reading.samples import Samples
from graphnav.reading.vehicle import Vehicle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNKNOWN_SD = 999.0  # m: what a receiver writes that does not know
BLIND_SD = 1e4  # m, of a height that is not known
FASTEST, AROUND_M = 150.0, 10e3  # m/s and m: a fix further from the middle of all is none
JERK = 1.0  # m/s^3, usual of a driven vehicle
CONTRADICTED = 3.0  # times the stated deviation by which fixes may scatter
CARRIED_S = 0.2  # a fix repeated sooner is no new one, where nothing else tells
ENOUGH = 20  # steps between fixes that tell a scatter
THIRD = np.sqrt(20.0)  # deviation of the third difference of white noise


def read_fixes(samples: Samples, vehicle: Vehicle) -> tuple[Gnss | None, list[str]]:
    """The fixes of a run and what is to be told of them."""
    rows, fix = samples.group(GNSS[:2], "a GNSS fix")
    notes: list[str] = []

    def without(bad: Mask, what: str) -> None:
        nonlocal rows, fix
        if bad.any():
            first = samples.clock[rows[bad.argmax()]]
            notes.append(f"{int(bad.sum())} {what}, first at {first:.15g}: left out")
            rows, fix = rows[~bad], fix[~bad]

    without((fix == 0).all(axis=1), "GNSS fixes at 0, 0 are receivers' blanks")
    time = samples.clock - samples.clock[0]
    if len(rows):
        fix[:, 1] = _continuous(fix[:, 1])
        without(_unreachable(time[rows], fix), "GNSS fixes are where no vehicle can get to")
    if not len(rows):
        return None, notes
    height = samples.columns.get(GNSS[2], np.full(len(time), np.nan))
    without(
        _repeated(time[rows], np.column_stack([fix, height[rows]])),
        "GNSS rows repeat the fix before",
    )
    sd, stated = _deviations(samples, rows, vehicle.gnss.sd)
    up, flat = _heights(height[rows], vehicle.start.height or 0.0)
    if flat.any():
        notes.append(f"{int(flat.sum())} of {len(rows)} fixes have no height: used horizontally")
        sd[flat, 2] = BLIND_SD
    found = Gnss(time[rows], fix[:, 0], fix[:, 1], up, sd)
    scattered, more = _scattered(found)
    return scattered, [*notes, *stated, *more]


def _continuous(lon_deg: Array) -> Array:
    """Longitudes (n,) without a jump where they cross the 180th meridian."""
    if np.ptp(lon_deg) < 180:
        return lon_deg
    middle = float(np.rad2deg(np.angle(np.exp(1j * np.deg2rad(lon_deg)).sum())))
    return wrapped(lon_deg - middle, 360.0) + middle


def _unreachable(time: Array, fix: Array) -> Mask:
    """Fixes further from the middle of all than anything drives in the time, (n,)."""
    lat, lon = np.deg2rad(fix).T
    origin = Origin(float(np.median(lat)), float(np.median(lon)), 0.0)
    away = np.linalg.norm(origin.local(lat, lon, np.zeros(len(lat)))[:, :2], axis=1)
    return np.asarray(away > AROUND_M + FASTEST * (time[-1] - time[0]))


def _repeated(time: Array, fix: Array) -> Mask:
    """Rows that only carry the last fix on, as loggers do that ask faster than the receiver
    measures: the same again, sooner than fixes usually change, (n,).
    """
    same = ((fix[1:] == fix[:-1]) | (np.isnan(fix[1:]) & np.isnan(fix[:-1]))).all(axis=1)
    fresh = time[np.append(True, ~same)]
    period = float(np.median(np.diff(fresh))) if len(fresh) > ENOUGH else 2 * CARRIED_S
    return np.append(np.zeros(min(len(fix), 1), bool), same & (np.diff(time) < 0.6 * period))


def _heights(height: Array, otherwise: float) -> tuple[Array, Mask]:
    """Heights (n,) m, those not known at the middle of the others; and which are not known."""
    flat = ~np.isfinite(height) | (height == 0)
    middle = otherwise if flat.all() else float(np.median(height[~flat]))
    return np.where(flat, middle, height), flat


def _deviations(
    samples: Samples, rows: NDArray[np.intp], default: float
) -> tuple[Array, list[str]]:
    """Standard deviations (n, 3); those not known are the vehicle file's, and said to be."""
    blank = np.full(len(samples.clock), np.nan)
    sd = np.stack([samples.columns.get(name, blank)[rows] for name in GNSS_SD], -1)
    bad = np.flatnonzero((sd < 0).any(-1))
    if len(bad):
        raise samples.error(int(rows[bad[0]]), "a GNSS standard deviation is below 0; blank it")
    unknown = ~((sd > 0) & (sd < UNKNOWN_SD))
    if not unknown.any():
        return sd, []
    which = [name for name, u in zip(GNSS_SD, unknown.T, strict=True) if u.any()]
    stated = (
        f"{', '.join(which)} not given for {int(unknown.any(-1).sum())} of {len(rows)} fixes: "
        f"{default:g} m assumed; set [gnss] sd [m]"
    )
    return np.where(unknown, default, sd), [stated]


def _scattered(gnss: Gnss) -> tuple[Gnss, list[str]]:
    """Fixes that scatter far beyond their deviations get those that they show.

    Scatter is told from smooth driving by third differences of evenly spaced fixes.
    """
    step = np.diff(gnss.time)
    usual = float(np.median(step)) if len(step) else 0.0
    even = np.abs(step - usual) < 0.1 * usual
    on = np.flatnonzero(even[2:] & even[1:-1] & even[:-2])
    if len(on) < ENOUGH:
        return gnss, []
    lat, lon = np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg)
    origin = Origin(float(lat[0]), float(lon[0]), float(gnss.height[0]))
    third = np.diff(origin.local(lat, lon, gnss.height), 3, axis=0)[on]
    shown = 1.4826 * np.median(np.abs(third), axis=0) / THIRD
    stated = np.median(gnss.sd_enu, axis=0)
    grown = np.where(shown > CONTRADICTED * stated + JERK * usual**3 / THIRD, shown / stated, 1.0)
    if (grown == 1.0).all():
        return gnss, []
    axis = int(grown.argmax())
    note = (
        f"the fixes scatter by {shown[axis]:.2g} m where their standard deviations say "
        f"{stated[axis]:.2g} m: the scatter counts"
    )
    return Gnss(gnss.time, gnss.lat_deg, gnss.lon_deg, gnss.height, gnss.sd_enu * grown), [note]
