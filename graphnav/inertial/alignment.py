"""How the vehicle stood at the start: levelling, heading, origin and the first gyro bias.

The graph refines all of it; here only what an iteration needs to begin with, and the priors the
vehicle file states. Tilt gets a loose prior: the accelerometers enter once, through the factors.
"""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.preintegration import Increments
from factors.start import Start
from graphnav.common import earth
from graphnav.common.angles import rotation_of_angles
from graphnav.common.earth import Origin
from graphnav.common.errors import InputError
from graphnav.common.run import Array, Gnss, Odometer, Run
from graphnav.inertial.odometry import speed_at
from graphnav.reading.vehicle import Vehicle

LOOSE_TILT, LOOSE_HEADING = np.deg2rad(5.0), np.deg2rad(30.0)
LOOSE_SPEED, LOOSE_POSITION = 30.0, 300.0  # m/s, m
LEVELLING_S = 20.0
COMPASS_SD = np.deg2rad(5.0)  # a gyrocompass worse than this is not used
LATE_FIX_S = 30.0  # a first fix later than this leaves the start to what is stated
TRAVEL_M = 60.0  # displacement that makes a course


@dataclass(frozen=True)
class Alignment:
    """Where and how the run begins."""

    origin: Origin
    start: Start  # prior of the first node
    gyro_bias: Array  # (3,) rad/s, first guess
    source: str  # where the heading comes from, in words


def align(run: Run, vehicle: Vehicle, inc: Increments, still_until: float) -> Alignment:
    """Align at the first increment edge; `still_until` is the end of a standing start (0: none).

    Raises `InputError` saying what is missing when position or heading cannot be known.
    """
    origin = frame_origin(run, vehicle)
    standing = still_until > 0
    R_level = _levelled(run, inc, still_until)
    rate = _mean_rate(inc, still_until) if standing else np.zeros(3)
    heading, sd, source = _heading(run, vehicle, inc, R_level, rate, origin)
    R_nb = _turned(R_level, heading)
    bias = rate - R_nb.T @ origin.Omega_n if standing else np.zeros(3)
    limit = 3 * np.deg2rad(vehicle.imu.gyro_bias_deg_h) / 3600
    p_0, p_sd = first_position(run, vehicle, origin, float(inc.edge[0]))
    v_sd = LOOSE_SPEED
    tilt = LOOSE_TILT
    start = Start(R_nb, np.zeros(3), p_0, np.repeat([tilt, v_sd, p_sd], 3))
    start.sd[2] = sd
    return Alignment(origin, start, np.clip(bias, -limit, limit), source)


def frame_origin(run: Run, vehicle: Vehicle) -> Origin:
    """The frame's origin: the first fixes, or the stated start."""
    if run.gnss is not None:
        few = slice(0, 10)
        lat, lon = np.median(run.gnss.lat_deg[few]), np.median(run.gnss.lon_deg[few])
        return Origin(np.deg2rad(lat), np.deg2rad(lon), float(np.median(run.gnss.height[few])))
    at = vehicle.start
    if at.lat is None or at.lon is None:
        raise InputError(
            f"{run.path}: no GNSS fix is used and the vehicle file states no start: "
            "give [start] lat, lon, height and heading_deg"
        )
    return Origin(np.deg2rad(at.lat), np.deg2rad(at.lon), at.height or 0.0)


def first_position(run: Run, vehicle: Vehicle, origin: Origin, begin: float) -> tuple[Array, float]:
    """Prior position in n [m] and its sigma at `begin` s: the first fix; where fixes are late, what
    is stated.

    Fixes from the start on make a stated position needless (and may be told in another datum).
    """
    gnss, at = run.gnss, vehicle.start
    wait = np.inf if gnss is None else float(gnss.time[0] - begin)
    if at.lat is not None and at.lon is not None and wait > LATE_FIX_S:
        lat, lon = np.deg2rad(at.lat), np.deg2rad(at.lon)
        height = origin.height if at.height is None else at.height
        known = origin.local(np.asarray(lat), np.asarray(lon), np.asarray(height))
        return known, at.position_sd_m
    assert gnss is not None  # `frame_origin` has refused a run with neither
    first = origin.local(
        np.deg2rad(gnss.lat_deg[0]), np.deg2rad(gnss.lon_deg[0]), np.asarray(gnss.height[0])
    )
    return first, LOOSE_POSITION + LOOSE_SPEED * max(wait, 0.0)


def _mean_rate(inc: Increments, until: float) -> Array:
    """Mean angular rate of the standing start, (3,) rad/s."""
    on = inc.edge[1:] <= until + 1e-9
    return np.asarray(inc.rotation[on].sum(0) / np.diff(inc.edge)[on].sum())


def _levelled(run: Run, inc: Increments, still_until: float) -> Array:
    """Attitude with heading zero from the mean specific force at the start, (3, 3).

    On the move the force is turned back to the start with the gyro, and what the odometer says of
    forward and centripetal acceleration is taken off.
    """
    until = still_until if still_until > 0 else inc.edge[0] + LEVELLING_S
    on = np.flatnonzero(inc.edge[1:] <= until + 1e-9)
    dt = np.diff(inc.edge)[on]
    force = inc.velocity[on] / dt[:, None]
    if still_until <= 0:
        if run.odometer is not None:
            speed = speed_at(run.odometer, inc.edge[: len(on) + 1], 0.25)
            force[:, 1] -= np.diff(speed) / dt
            force[:, 0] += speed[1:] * inc.rotation[on, 2] / dt
        R = np.eye(3)
        for k, step in enumerate(so3.exp(inc.rotation[on])):
            force[k] = R @ force[k]
            R = R @ step
    up = (force * dt[:, None]).sum(0)
    up /= np.linalg.norm(up)
    pitch, roll = np.arcsin(np.clip(up[1], -1, 1)), np.arctan2(-up[0], up[2])
    return rotation_of_angles(roll, pitch, 0.0)


def _turned(R_level: Array, heading: float) -> Array:
    """Turn a levelled attitude to a heading."""
    return so3.exp(np.array([0.0, 0.0, -heading])) @ R_level


def _heading(
    run: Run, vehicle: Vehicle, inc: Increments, R_level: Array, rate: Array, origin: Origin
) -> tuple[float, float, str]:
    """Heading [rad], prior sigma and source: stated, sensed, satellite course or Earth rate."""
    stated = vehicle.start
    if stated.heading_deg is not None:
        sd = np.deg2rad(stated.heading_sd_deg)
        return np.deg2rad(stated.heading_deg), float(sd), "stated in [start]"
    sensed = run.heading
    if sensed is not None and sensed.time[0] < inc.edge[0] + LEVELLING_S:
        return float(sensed.heading[0]), float(LOOSE_HEADING), "external heading"
    if run.gnss is not None:
        course = _course(inc, R_level, run.gnss, run.odometer, rate, origin)
        if course is not None:
            return course, float(LOOSE_HEADING), "satellite course"
    level = R_level @ rate
    compass_sd = np.deg2rad(vehicle.imu.gyro_bias_deg_h) / 3600 / (earth.RATE * np.cos(origin.lat))
    if np.any(rate) and compass_sd < COMPASS_SD:
        return float(np.arctan2(-level[0], level[1])), float(LOOSE_HEADING), "gyrocompass"
    raise InputError(
        f"{run.path}: the heading at the start is unknown (no GNSS course, no heading sensor, gyro "
        "or standstill not good enough to gyrocompass): give [start] heading_deg"
    )


def _course(
    inc: Increments,
    R_level: Array,
    gnss: Gnss,
    odometer: Odometer | None,
    rate: Array,
    origin: Origin,
) -> float | None:
    """Heading that lays the dead-reckoned path on the fixes, or None when they hardly move.

    The path runs at the odometer's speed (without one, at the speed of the fixes) along the
    gyro-integrated heading; one complex ratio turns it on to the fixes.
    """
    fixes = origin.local(np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg), gnss.height)[:, :2]
    far = np.flatnonzero(np.hypot(*(fixes - fixes[0]).T) > TRAVEL_M)
    if not len(far):
        return None
    until = gnss.time[min(far[0] + 5, len(fixes) - 1)]
    on = inc.edge[1:] <= until
    dt = np.diff(inc.edge)[on]
    turn = (inc.rotation[on] - rate * dt[:, None]) @ R_level[2]  # about the vertical, left positive
    angle = np.concatenate([[0.0], np.cumsum(turn)])
    edge = inc.edge[: len(angle)]
    if odometer is not None:
        speed = speed_at(odometer, edge, 0.25)
    else:
        pace = np.hypot(*np.gradient(fixes, gnss.time, axis=0).T)
        speed = np.interp(edge, gnss.time, pace)
    velocity = speed * np.exp(1j * angle) * 1j  # heading zero is north: +i
    path = np.concatenate([[0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt)])
    near = (gnss.time >= edge[0]) & (gnss.time <= edge[-1])
    reckoned = np.interp(gnss.time[near], edge, path)
    seen = fixes[near, 0] + 1j * fixes[near, 1]
    ratio = np.vdot(reckoned - reckoned.mean(), seen - seen.mean())
    return float(-np.angle(ratio)) if abs(ratio) > 0 else None
