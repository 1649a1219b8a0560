"""Satellite fixes once a second: white noise as declared, and multipath that is not declared."""

import numpy as np

from graphnav.simulation import ellipsoid
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.inertial import Truth

ANTENNA = (0.3, 0.5, 1.5)  # m, b frame
SD = (1.5, 1.5, 3.0)  # m, east, north, up, as declared
SPELL_EVERY = 150.0  # s, mean time between two spells of multipath


def fixes(rng: np.random.Generator, truth: Truth) -> dict[str, Array]:
    """Columns of run.csv (N,), NaN between the fixes."""
    rate_hz = round(1 / truth.time[1])
    rows = np.arange(rate_hz, len(truth.time), rate_hz)
    error_n = np.asarray(SD) * rng.standard_normal((len(rows), 3))
    error_n += _multipath(rng, len(rows))
    offset_n = truth.R_nb[rows] @ np.asarray(ANTENNA) + error_n
    lat, lon, height = np.radians(truth.lla[rows, 0]), truth.lla[rows, 1], truth.lla[rows, 2]
    meridian, across = ellipsoid.radii(lat, height)
    values = {
        "gnss_lat": np.round(np.degrees(lat + offset_n[:, 1] / meridian), 10),
        "gnss_lon": np.round(lon + np.degrees(offset_n[:, 0] / (across * np.cos(lat))), 10),
        "gnss_height": np.round(height + offset_n[:, 2], 4),
    }
    values |= {f"gnss_sd_{k}": np.full(len(rows), s) for k, s in zip("enu", SD, strict=True)}
    return {name: _sparse(len(truth.time) - 1, rows - 1, v) for name, v in values.items()}


def _multipath(rng: np.random.Generator, count: int) -> Array:
    """Spells of 5-20 s in which the fix stands 8-40 m aside, (K, 3) m."""
    out = np.zeros((count, 3))
    for _ in range(rng.poisson(count / SPELL_EVERY)):
        start = int(rng.integers(count))
        span = slice(start, start + int(rng.integers(5, 20)))
        direction = rng.standard_normal(3)
        out[span] += rng.uniform(8, 40) * direction / np.linalg.norm(direction)
    return out


def _sparse(size: int, rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]], value: Array) -> Array:
    out = np.full(size, np.nan)
    out[rows] = value
    return out
