"""Exact inertial truth: the specific forces and rates that carry an IMU along a given drive.

Between two internal nodes the body turns at a constant rate and feels a constant specific force;
both follow from the inertial motion of the nodes (Earth rotation, curvature, gravitation) without
integrating anything, so strapdown integration of the samples returns to the nodes.
"""

from dataclasses import dataclass

import numpy as np

from graphnav.simulation import ellipsoid
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.rotation import Rotations, about


@dataclass(frozen=True)
class Body:
    """Where the IMU sits: mounting `R_bm` and the lever from IMU to the vehicle point, in b."""

    lla: Array  # (3,) rad, rad, m of the IMU at the start
    R_bm: Rotations
    lever_b: Array  # (3,) m


@dataclass(frozen=True)
class Truth:
    """What truly happened at the IMU; node k + 1 ends sample k."""

    time: Array  # (N + 1,) s, from 0
    lla: Array  # (N + 1, 3) deg, deg, m
    v_n: Array  # (N + 1, 3) m/s, local east, north, up
    R_nb: Array  # (N + 1, 3, 3), b right-forward-up
    gyro: Array  # (N, 3) rad/s, mean over the sample
    accel: Array  # (N, 3) m/s^2, mean specific force
    gyro_end: Array  # (N, 3) rad/s, at the sample's end: mean over its last internal step
    accel_end: Array  # (N, 3) m/s^2, likewise

    @property
    def angles_deg(self) -> Array:
        """Roll, pitch, heading (N + 1, 3) deg; heading in 0..360."""
        R = self.R_nb
        roll = np.arctan2(-R[:, 2, 0], R[:, 2, 2])
        pitch = np.arcsin(np.clip(R[:, 2, 1], -1, 1))
        heading = np.arctan2(R[:, 0, 1], R[:, 1, 1])
        out = np.degrees(np.stack([roll, pitch, heading], -1))
        out[:, 2] %= 360
        return np.asarray(out)


def attitude(roll: Array, pitch: Array, heading: Array) -> Rotations:
    """`R_nb` (N) of angles in rad: heading clockwise from north, pitch nose up, roll right down."""
    return about("z", -heading) * about("x", pitch) * about("y", roll)


def truth(time: Array, R_nb: Rotations, v_m: Array, body: Body, every: int) -> Truth:
    """The IMU's truth for a vehicle point moving at `v_m` (M, 3) m/s, an IMU turned by `R_nb` (M).

    `time` (M,) is the internal grid; `every` internal steps make one sample, M = N * every + 1.
    """
    dt = float(time[1] - time[0])
    w_b = _node_rate(R_nb, dt)
    v_n = R_nb.apply(body.R_bm.apply(v_m) - np.cross(w_b, body.lever_b))
    lla = ellipsoid.geodetic(body.lla, v_n, dt)
    gyro, accel = _steps(time, R_nb, v_n, lla)
    nodes = slice(None, None, every)
    degrees = np.array([180 / np.pi, 180 / np.pi, 1.0])
    R = R_nb[nodes].matrices()
    ends = slice(every - 1, None, every)

    def mean(x: Array) -> Array:
        return np.asarray(x.reshape(-1, every, 3).mean(1))

    return Truth(
        time[nodes], lla[nodes] * degrees, v_n[nodes], R,
        mean(gyro), mean(accel), gyro[ends], accel[ends],
    )  # fmt: skip


def _node_rate(R_nb: Rotations, dt: float) -> Array:
    """Rate of b against n at the nodes (M, 3) rad/s: the mean of the two steps beside each."""
    step = (R_nb[:-1].inverse() * R_nb[1:]).rotvec() / dt
    ends = np.concatenate([step[:1], step, step[-1:]])
    return np.asarray(0.5 * (ends[1:] + ends[:-1]))


def _steps(time: Array, R_nb: Rotations, v_n: Array, lla: Array) -> tuple[Array, Array]:
    """Rates and specific forces (M - 1, 3) of the internal steps."""
    dt = float(time[1] - time[0])
    lat, lon_i = lla[:, 0], lla[:, 1] + ellipsoid.RATE * time
    R_in = about("z", lon_i + np.pi / 2) * about("x", np.pi / 2 - lat)
    R_ib = R_in * R_nb
    earth_i = np.array([0.0, 0.0, ellipsoid.RATE])
    v_i = R_in.apply(v_n) + np.cross(earth_i, ellipsoid.inertial_position(lla, time))
    g_i = R_in.apply(ellipsoid.gravitation(lla))
    force_i = np.diff(v_i, axis=0) / dt - 0.5 * (g_i[1:] + g_i[:-1])

    turn = (R_ib[:-1].inverse() * R_ib[1:]).rotvec()
    mean_b = R_ib[:-1].inverse().apply(force_i)
    # inverse left Jacobian: the constant body force whose turning mean this is (next term turn^4)
    across = np.cross(turn, mean_b)
    force_b = mean_b - 0.5 * across + np.cross(turn, across) / 12
    return turn / dt, force_b
