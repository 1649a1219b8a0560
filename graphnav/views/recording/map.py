"""The run on the map: only drawn when the user opens the map view (it asks tile servers)."""

import numpy as np
from numpy.typing import NDArray

from graphnav.result import palette
from graphnav.result.result_directory import Results, columns, thin
from graphnav.views.recording.entry import STRIP_LIMIT, Entry, over_time, static
from graphnav.views.recording.paths import coloured_strips, fix_colours

Array = NDArray[np.float64]


def entries(results: Results) -> list[Entry]:
    """Everything below `/map`: smoothed path by state, fixes, the vehicle's place."""
    import rerun as rr

    place = columns(results.trajectory, "lat", "lon")
    rows, colours = coloured_strips(results)
    path = rr.GeoLineStrings(
        lat_lon=[place[r] for r in rows], colors=colours, radii=rr.Radius.ui_points(2.5)
    )
    few = thin(len(place), STRIP_LIMIT)
    time = results.time[few] - results.clock_start
    marker = rr.GeoPoints.from_fields(
        colors=np.array([palette.rgba32("#f2f4f8")], np.uint32), radii=rr.Radius.ui_points(6.0)
    )
    return [
        *static("/map/smoothed", path),
        *_fixes(results),
        *static("/map/vehicle", marker),
        over_time("/map/vehicle", time, rr.GeoPoints.columns(positions=place[few])),
    ]


def _fixes(results: Results) -> list[Entry]:
    import rerun as rr

    if results.gnss is None:
        return []
    gnss = results.gnss.iloc[thin(len(results.gnss), STRIP_LIMIT)]
    lat, lon, _ = results.origin.geodetic(columns(gnss, "e", "n", "u"))
    points = rr.GeoPoints(
        lat_lon=np.degrees(np.stack([lat, lon], -1)),
        colors=fix_colours(gnss),
        radii=rr.Radius.ui_points(3.0),
    )
    return static("/map/gnss", points)


def zoom(results: Results, pixels: float = 450.0) -> float:
    """Web-Mercator zoom level that shows the whole run across `pixels`."""
    lat, lon = columns(results.trajectory, "lat", "lon").T
    width = np.ptp(lon)
    height = np.ptp(lat) / np.cos(np.radians(lat.mean()))
    return float(np.clip(np.log2(360.0 * pixels / 256.0 / max(width, height, 1e-5)), 1.0, 19.0))
