"""The trajectory of one point of the vehicle: the IMU, or any point rigidly fixed to it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import so3
from graphnav.result.result_directory import Results, columns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """What an export format needs, N rows; `l` is east-north-up on the spot, `n` at the origin."""

    time: Array  # (N,) s, the run file's clock
    lat_deg: Array  # (N,)
    lon_deg: Array  # (N,)
    height: Array  # (N,) m above the ellipsoid
    p_n: Array  # (N, 3) m
    v_l: Array  # (N, 3) m/s
    angles_deg: Array  # (N, 3) roll, pitch, heading of the IMU
    R_nb: Array  # (N, 3, 3)
    w_b: Array  # (N, 3) rad/s relative to the Earth


def track(results: Results, at_b: tuple[float, float, float] | None = None) -> Track:
    """The trajectory at the IMU, or at the lever arm `at_b` [m] (right, forward, up of the IMU).

    The lever arm turns with the vehicle: `p + R_nb l`, `v + R (w x l)`.
    """
    table, R_nb = results.trajectory, results.R_nb
    lever_b = np.zeros(3) if at_b is None else np.asarray(at_b, float)
    p_n = results.p_n + R_nb @ lever_b
    w_b = _rates(results.time, R_nb)
    R_ln = results.origin.level_axes(results.p_n)
    v_l = columns(table, "v_e", "v_n", "v_u") + so3.mv(R_ln @ R_nb, np.cross(w_b, lever_b))
    lat_deg, lon_deg, height = columns(table, "lat", "lon", "height").T
    if lever_b.any():
        lat, lon, height = results.origin.geodetic(p_n)
        lat_deg, lon_deg = np.degrees(lat), np.degrees(lon)
    angles_deg = columns(table, "roll_deg", "pitch_deg", "heading_deg")
    return Track(results.time, lat_deg, lon_deg, height, p_n, v_l, angles_deg, R_nb, w_b)


def _rates(time: Array, R_nb: Array) -> Array:
    """Mean angular rates about the body axes, centred on the rows, (N, 3) rad/s."""
    if len(time) < 2:
        return np.zeros((len(time), 3))
    turned = so3.log(so3.transpose(R_nb[:-1]) @ R_nb[1:])
    between = turned / np.diff(time)[:, None]
    return np.concatenate([between[:1], (between[:-1] + between[1:]) / 2, between[-1:]])
