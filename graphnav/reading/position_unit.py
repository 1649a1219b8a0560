"""Fixes in whole units of a small part of a degree, as receivers put them into integers."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading.vehicle import Vehicle

Array = NDArray[np.float64]
PARTS = {"1e-7 deg": 1e-7, "1e-6 deg": 1e-6}  # u-blox and MAVLink; some loggers
NEAR_DEG = 3.0  # of [start], where a fix belongs


def in_degrees(
    where: str, columns: Mapping[str, Array], vehicle: Vehicle
) -> tuple[dict[str, Array], str | None]:
    """Latitudes and longitudes in degrees, and what was taken for their unit.

    Raises InputError where more than one unit would fit.
    """
    names = ("gnss_lat", "gnss_lon")
    lat, lon = (columns.get(name, np.zeros(0)) for name in names)
    lat, lon = (x[np.isfinite(x) & (x != 0)] for x in (lat, lon))
    stated = any(name in vehicle.columns and vehicle.columns[name].unit for name in names)
    whole = (lat == np.round(lat)).all() and (lon == np.round(lon)).all()
    if stated or not len(lat) or not len(lon) or not whole or np.median(np.abs(lat)) < 1e5:
        return dict(columns), None
    lat_0, lon_0 = float(np.median(lat)), float(np.median(lon))
    fits = {u: s for u, s in PARTS.items() if abs(lat_0) * s <= 90 and abs(lon_0) * s <= 360}
    start = vehicle.start
    if len(fits) > 1 and start.lat is not None and start.lon is not None:
        fits = {u: s for u, s in fits.items() if abs(lat_0 * s - start.lat) < NEAR_DEG
                and abs(lon_0 * s - start.lon) < NEAR_DEG}  # fmt: skip
    if len(fits) != 1:
        raise InputError(
            f"{where}: gnss_lat {lat_0:.0f} is no latitude in degrees, and may be in parts of one: "
            'set [columns] gnss_lat = { unit = "1e-7 deg" }, gnss_lon likewise, in the vehicle file'
        )
    ((unit, part),) = fits.items()
    scaled = {name: np.round(columns[name]) / round(1 / part) for name in names}
    return dict(columns) | scaled, f"gnss_lat, gnss_lon are whole numbers: read in {unit}"
