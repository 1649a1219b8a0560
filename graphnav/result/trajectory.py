"""The trajectory as a table: interface.md's columns at a constant rate."""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import POSITION, ROTATION, VELOCITY
from graphnav.common.angles import angles_of_rotation
from graphnav.common.run import Array
from graphnav.result.solved import Solved, row_weights

VEHICLE_KINDS = (kinds.DISPLACEMENT, kinds.VELOCITY, kinds.WHEEL_DISPLACEMENT)


@dataclass(frozen=True)
class Deviations:
    """Standard deviations at the nodes in level axes."""

    position: Array  # (N, 3) m, east north up
    velocity: Array  # (N, 3) m/s
    angles: Array  # (N, 3) rad, roll, pitch, heading
    correlation_en: Array  # (N,)


def deviations(covariance: Array, R_nb: Array) -> Deviations:
    """Told from node covariances (N, 9, 9) of [theta (b), v (n), p (n)] and attitudes (N, 3, 3).

    Roll, pitch and heading errors are the attitude error about the vehicle's level forward axis,
    its level right axis and the vertical.
    """
    variance = np.einsum("nii->ni", covariance)
    theta_n = R_nb @ covariance[:, ROTATION, ROTATION] @ so3.transpose(R_nb)
    forward = R_nb[:, :2, 1] / np.linalg.norm(R_nb[:, :2, 1], axis=1, keepdims=True)
    zero, one = np.zeros(len(forward)), np.ones(len(forward))
    f_n = np.stack([forward[:, 0], forward[:, 1], zero], -1)
    r_n = np.stack([forward[:, 1], -forward[:, 0], zero], -1)
    up_n = np.stack([zero, zero, one], -1)
    axes = np.stack([f_n, r_n, up_n], 1)
    angle = np.einsum("nai,nij,naj->na", axes, theta_n, axes)
    position, velocity = np.sqrt(variance[:, POSITION]), np.sqrt(variance[:, VELOCITY])
    place = covariance[:, POSITION, POSITION]
    east_north = place[:, 0, 1] / np.sqrt(place[:, 0, 0] * place[:, 1, 1])
    return Deviations(position, velocity, np.sqrt(angle), east_north)


def table(solved: Solved, rate_hz: float) -> dict[str, Array]:
    """Columns of trajectory.parquet (plus `corr_en`, `w_x w_y w_z`), one row per sample."""
    path, origin = solved.path, solved.origin
    first = path.time[0]
    count = int(np.floor((path.time[-1] - first) * rate_hz + 1e-6)) + 1
    t = first + np.arange(count) / rate_hz
    R_nb, v_n, p_n = path.at(t)
    level = origin.level_axes(p_n)
    lat, lon, height = origin.geodetic(p_n)
    roll, pitch, heading = angles_of_rotation(level @ R_nb)
    v_l, v_m = so3.mv(level, v_n), so3.mtv(R_nb, v_n) @ solved.R_bm

    at_nodes = np.clip(np.searchsorted(path.time, solved.node_time - 1e-6), 0, len(path.time) - 1)
    sd = deviations(solved.node_covariance, path.R_nb[at_nodes])
    end, weight = row_weights(solved, VEHICLE_KINDS)
    columns = {"time": t + solved.run.clock_start - solved.imu_late}
    columns |= {"lat": np.rad2deg(lat), "lon": np.rad2deg(lon), "height": height}
    columns |= dict(zip(("e", "n", "u"), p_n.T, strict=True))
    columns |= dict(zip(("v_e", "v_n", "v_u"), v_l.T, strict=True))
    columns |= dict(zip(("v_x", "v_y", "v_z"), v_m.T, strict=True))
    for name, angle in (("roll", roll), ("pitch", pitch), ("heading", heading)):
        columns[f"{name}_deg"] = np.rad2deg(angle)

    turn, speed, place = _astray(t, solved.gaps)

    def between(values: Array, more: Array | float = 0.0) -> Array:
        return np.asarray(np.hypot(np.interp(t, solved.node_time, values), more))

    for k, axis in enumerate(("e", "n", "u")):
        columns[f"sd_{axis}"] = between(sd.position[:, k], place)
    for k, axis in enumerate(("e", "n", "u")):
        columns[f"sd_v_{axis}"] = between(sd.velocity[:, k], speed)
    for k, name in enumerate(("roll", "pitch", "heading")):
        columns[f"sd_{name}_deg"] = np.rad2deg(between(sd.angles[:, k], turn))
    columns["state"] = solved.timeline.state_at(t)
    columns["corr_en"] = np.interp(t, solved.node_time, sd.correlation_en)
    held = _held(t, end, weight, solved.node_time)
    columns |= dict(zip(("w_x", "w_y", "w_z"), held.T, strict=True))
    return columns


def _astray(t: Array, gaps: Array | None) -> tuple[Array, Array, Array]:
    """How far attitude [rad], velocity [m/s] and position [m] may stray inside gaps of the IMU.

    A random walk of the turn and of the speed, tied to what is known at both ends: of a Wiener
    velocity with both its ends and both positions fixed the variances are
    `s (1-s) (1 - 3 s (1-s))` and `T^2 (s (1-s))^3 / 3` at the share s of the gap T.
    """
    out = np.zeros((3, len(t)))
    for start, end, turn, speed in [] if gaps is None else gaps:
        on = slice(*np.searchsorted(t, [start, end]).tolist())
        s = (t[on] - start) / (end - start)
        u = s * (1 - s)
        out[0, on] = turn * np.sqrt(u)
        out[1, on] = speed * np.sqrt(u * (1 - 3 * u))
        out[2, on] = speed * (end - start) * np.sqrt(u**3 / 3)
    return out[0], out[1], out[2]


def _held(t: Array, end: Array, weight: Array, node_time: Array) -> Array:
    """Weights of the interval each time lies in, NaN where no vehicle factor acts, (n, 3)."""
    out = np.full((len(t), 3), np.nan)
    if not len(end):
        return out
    k = np.minimum(np.searchsorted(end, t), len(end) - 1)
    begin = node_time[np.maximum(np.searchsorted(node_time, end - 1e-6) - 1, 0)]
    inside = (t <= end[k]) & (t >= begin[k])
    out[inside] = weight[k[inside]]
    return out
