"""Exports that are plain numbers: CSV, TUM (evo and other SLAM tools), SBET (mapping tools)."""

from pathlib import Path

import numpy as np

from factors import so3
from graphnav.export.track import Track
from graphnav.result.result_directory import Results

SBET_FIELDS = (
    "time", "lat", "lon", "height", "v_north", "v_east", "v_down", "roll", "pitch", "heading",
    "wander", "a_forward", "a_right", "a_down", "w_forward", "w_right", "w_down",
)  # fmt: skip
NED_OF_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # also FRD of RFU


def csv(results: Results, track: Track, path: Path) -> None:
    """The columns of trajectory.parquet, places and ground velocities at the chosen point.

    `v_x v_y v_z` and the standard deviations stay the IMU's.
    """
    places = {"lat": track.lat_deg, "lon": track.lon_deg, "height": track.height}
    places |= {name: track.p_n[:, k] for k, name in enumerate("enu")}
    places |= {f"v_{name}": track.v_l[:, k] for k, name in enumerate("enu")}
    results.trajectory.assign(**places).to_csv(path, index=False)


def tum(results: Results, track: Track, path: Path) -> None:
    """`time x y z qx qy qz qw`, metres in n, rotation n <- b: what evo reads."""
    rows = np.column_stack([track.time, track.p_n, so3.quaternion(track.R_nb)])
    np.savetxt(path, rows, fmt=["%.9f"] + ["%.6f"] * 3 + ["%.12f"] * 4)


def sbet(results: Results, track: Track, path: Path) -> None:
    """Applanix SBET: 17 little-endian doubles a record (`SBET_FIELDS`), radians, metres, seconds.

    Wander angle 0, so the heading is true and velocities are north, east, down; body axes are
    forward, right, down; accelerations are of the motion alone (gravity removed). Times are the run
    file's own clock: readers expect GPS seconds of the week. Altitude is above the ellipsoid.
    """
    R_ln = results.origin.level_axes(track.p_n)
    a_l = np.gradient(track.v_l, track.time, axis=0) if len(track.time) > 1 else 0 * track.v_l
    a_b = so3.mtv(R_ln @ track.R_nb, a_l)
    roll, pitch, heading = np.radians(track.angles_deg).T
    record = np.column_stack([
        track.time, np.radians(track.lat_deg), np.radians(track.lon_deg), track.height,
        track.v_l @ NED_OF_ENU.T, roll, pitch, heading, np.zeros_like(roll),
        a_b @ NED_OF_ENU.T, track.w_b @ NED_OF_ENU.T,
    ])  # fmt: skip
    record.astype("<f8").tofile(path)
