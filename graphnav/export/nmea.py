"""NMEA 0183 (pynmeagps): what a receiver on the vehicle would have said, once a second."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graphnav.export.track import Track
from graphnav.result.result_directory import Results

ESTIMATED = 6  # GGA quality: dead reckoning, not a satellite fix


def nmea(results: Results, track: Track, path: Path) -> None:
    """GGA and HDT sentences of the first row in every second.

    Time of day is the run file's clock read as UTC seconds, days dropped. The altitude field holds
    the ellipsoidal height and the geoid separation is 0, so their sum is right.
    """
    rows = each_second(track.time)
    with path.open("w", encoding="ascii", newline="") as out:
        for row in rows:
            out.write(_gga(track, int(row)) + _hdt(track, int(row)))


def each_second(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """The first row within each whole second; 1e-6 s forgives clocks a rounding short of one."""
    return np.flatnonzero(np.diff(np.floor(time + 1e-6), prepend=-np.inf) > 0)


def _gga(track: Track, row: int) -> str:
    from pynmeagps import NMEAMessage

    message = NMEAMessage(
        "GN",
        "GGA",
        0,
        hpnmeamode=True,
        time=datetime.fromtimestamp(float(track.time[row]), UTC).time(),
        lat=float(track.lat_deg[row]),
        lon=float(track.lon_deg[row]),
        quality=ESTIMATED,
        numSV=0,
        HDOP="",
        alt=round(float(track.height[row]), 4),
        altUnit="M",
        sep=0.0,
        sepUnit="M",
        diffAge="",
        diffStation="",
    )
    return str(message.serialize().decode("ascii"))


def _hdt(track: Track, row: int) -> str:
    from pynmeagps import NMEAMessage

    heading = round(float(track.angles_deg[row, 2]) % 360.0, 5)
    message = NMEAMessage("GN", "HDT", 0, headingT=heading, headingTu="T")
    return str(message.serialize().decode("ascii"))
