"""Trajectories for other tools: Google Earth, GIS, GPS tools, evo, spreadsheets, mapping software.

Every format can be told at the IMU or at a point fixed to the vehicle (lever arm in the b frame).

In: a result directory. Out: one file of another format, whole.
Not here: formats that are read; a result is never made from them.
"""

import difflib
from collections.abc import Callable
from pathlib import Path

from graphnav.common.errors import InputError
from graphnav.common.replacing import whole
from graphnav.export import maps, tables
from graphnav.export.nmea import nmea
from graphnav.export.track import Track, track
from graphnav.result.result_directory import Results

__all__ = ["FORMATS", "SUFFIX", "Track", "track", "write"]

FORMATS: dict[str, Callable[[Results, Track, Path], None]] = {
    "kml": maps.kml,
    "geojson": maps.geojson,
    "gpx": maps.gpx,
    "tum": tables.tum,
    "csv": tables.csv,
    "sbet": tables.sbet,
    "nmea": nmea,
}
SUFFIX = {name: f".{name}" for name in FORMATS} | {"sbet": ".out"}


def write(
    results: Results, fmt: str, path: Path, at_b: tuple[float, float, float] | None = None
) -> None:
    """Write the trajectory as `fmt` at the IMU or at the lever arm `at_b` [m].

    Raises InputError for a format graphnav does not write.
    """
    if fmt not in FORMATS:
        near = difflib.get_close_matches(fmt, FORMATS, 1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise InputError(f"export format {fmt!r} unknown; {hint}choose from {', '.join(FORMATS)}")
    with whole(path) as part:
        FORMATS[fmt](results, track(results, at_b), part)
