"""The source's own rover estimator (C1-C7): plain means, clipped k_s, integration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import rocker_bogie as rb
from graphnav.common.angles import rotation_of_angles
from graphnav.common.run import ExternalHeading, RoverGear, Run

Array = NDArray[np.float64]

K_START, K_MIN, K_MAX, RATE_THRESHOLD = 0.9, 0.8, 1.0, 0.005  # C6's own values; rad/s


@dataclass(frozen=True)
class PaperTrack:
    """The source's estimate on the gear's clock."""

    time: Array  # (N,) s
    p_n: Array  # (N, 3) m from the start, ENU
    heading: Array  # (N,) rad, clockwise from north
    slip_coefficient: Array  # (N,)


def paper_track(
    run: Run,
    linkage: rb.Linkage,
    start_heading: float,
    difference: float = 1.0,
    compensate_yaw: bool = False,
) -> PaperTrack:
    """C1-C7 as printed. Kinder readings: `difference` [s] is the span over which the sun's heading
    is differenced; `compensate_yaw` also multiplies the integrated C4 by k_s."""
    gear, heading_seen = run.rover, run.heading
    assert gear is not None
    joints = rb.Joints(
        gear.steer, gear.rocker, np.column_stack([gear.bogie_left, gear.bogie_right])
    )
    v_b, w_z = rb.mean_motion(linkage, gear.wheel, joints)
    dt = np.diff(gear.time, prepend=gear.time[0])
    yaw = np.cumsum(w_z * dt)
    k = np.full(len(gear.time), K_START)
    if heading_seen is not None:
        k = _slip(gear.time, yaw, heading_seen, difference)
    used_yaw = np.cumsum(k * w_z * dt) if compensate_yaw else yaw
    heading = _heading(gear, used_yaw, heading_seen, start_heading)
    roll, pitch = _levelled(run, gear.time)
    R_nb = rotation_of_angles(roll, pitch, heading)
    v_n = np.einsum("nij,nj->ni", R_nb, k[:, None] * v_b)
    return PaperTrack(gear.time, np.cumsum(v_n * dt[:, None], axis=0), heading, k)


def _slip(time: Array, yaw: Array, seen: ExternalHeading, difference: float) -> Array:
    """k_s, held between updates.  Source: C6."""
    back = np.searchsorted(seen.time, seen.time - difference - 1e-6)
    span = seen.time - seen.time[back]
    fresh = (span > 0.5 * difference) & (span < 1.5 * difference)
    turned = -np.angle(np.exp(1j * (seen.heading - seen.heading[back])))
    wheels = np.interp(seen.time, time, yaw) - np.interp(seen.time[back], time, yaw)
    use = fresh & (np.abs(turned) > RATE_THRESHOLD * span) & (np.abs(wheels) > 1e-6)
    k = np.clip(turned[use] / wheels[use], K_MIN, K_MAX)
    last = np.searchsorted(seen.time[use], time, side="right")
    return np.concatenate([[K_START], k])[last]


def _heading(gear: RoverGear, yaw: Array, seen: ExternalHeading | None, start: float) -> Array:
    """The sun where it is seen, else C4 integrated since.  Source: C5."""
    if seen is None:
        return start - yaw
    last = np.searchsorted(seen.time, gear.time, side="right")
    value = np.concatenate([[start], seen.heading])[last]
    at = np.concatenate([[0.0], np.interp(seen.time, gear.time, yaw)])[last]
    return np.asarray(value - (yaw - at))


def _levelled(run: Run, time: Array) -> tuple[Array, Array]:
    """Roll and pitch from the accelerometer, averaged over each cycle.  Source: C5."""
    source = run.accelerometer or run.imu
    assert source is not None
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(source.accel, axis=0)])
    upto = np.searchsorted(source.time, time + 1e-6)
    since = np.searchsorted(source.time, time - 0.1 + 1e-6)
    since = np.minimum(since, np.maximum(upto - 1, 0))
    upto = np.maximum(upto, since + 1)
    f = (total[upto] - total[since]) / (upto - since)[:, None]
    return np.arctan2(-f[:, 0], f[:, 2]), np.arcsin(f[:, 1] / np.linalg.norm(f, axis=1))
