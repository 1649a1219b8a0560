"""Raw inertial samples compounded to about 20 Hz, with coning and sculling terms.

A sample is a mean over its interval; what the mean hides is recovered from its two neighbours on
either side (rate and force as polynomials through five means: a smoother may look ahead), then
samples are compounded to fourth order in their angles. The terms are Bortz's
`1/2 int (int w) x w` and its bilinear form for the velocity (Savage 1998), carried one order
further than the usual two-sample formula: a tenth of its error under vibration at a tenth of the
sampling rate.
"""

from dataclasses import replace

import numpy as np

from factors import so3
from factors.block import Index
from factors.preintegration import Increments
from graphnav.run import Array, Imu

GAP_FACTOR, GAP_S = 3.0, 0.1  # of the usual interval, and s: a longer sample stands for a gap
USUAL_RATE, USUAL_FORCE = 0.02, 0.5  # rad/s, m/s^2
GRID_S = 0.05  # duration of an increment the grouping aims at


def increments(imu: Imu, grid_s: float = GRID_S) -> Increments:
    """Compound samples (N) into increments (M <= N); a last short group keeps the rest.

    An increment's rotation and velocity are in the body frame of its start.
    """
    dt = imu.dt
    alpha, u = imu.gyro * dt[:, None], imu.accel * dt[:, None]
    regular = _regular(dt)[:, None]
    slope_w, slope_f = np.where(regular, _slope(alpha), 0.0), np.where(regular, _slope(u), 0.0)
    theta = alpha + so3.cross(alpha, slope_w)
    # the left Jacobian of alpha turns the mean force to the start of the sample (third order:
    # 1e-9 at 0.1 rad), sculling adds what the means hide
    turned = so3.cross(alpha, u)
    v = u + 0.5 * turned + so3.cross(alpha, turned) / 6
    v += so3.cross(alpha, slope_f) + so3.cross(u, slope_w)
    p = (0.5 * v - turned / 12 - slope_f) * dt[:, None]
    change = np.diff(u, axis=0, prepend=u[:1])
    jump = np.sqrt(np.einsum("ij,ij->i", change, change) / 12) * dt

    doubt = _gap_doubt(imu)
    size = max(1, round(grid_s / float(np.median(dt))))
    first = np.arange(0, len(dt), size)
    edge = np.concatenate([imu.time[:1] - dt[:1], imu.time])[np.append(first, len(dt))]
    whole = _compound(theta, v, p, dt, jump, first, edge)
    return replace(whole, doubt=np.sqrt(np.add.reduceat(doubt**2, first, axis=0)))


def _gap_doubt(imu: Imu) -> Array:
    """Turn [rad] and speed [m/s] a sample that stands for a gap may miss, one sigma, (N, 2).

    The rate and force are held over the gap; what they do meanwhile may change by half of what they
    are or of what they are found changed by, and by a driver's usual at least.
    """
    dt = imu.dt
    gap = (dt > GAP_FACTOR * np.median(dt)) & (dt > GAP_S)
    out = np.zeros((len(dt), 2))
    for column, values, least in ((0, imu.gyro, USUAL_RATE), (1, imu.accel, USUAL_FORCE)):
        change = np.linalg.norm(np.diff(values, axis=0, prepend=values[:1]), axis=1)
        own = np.linalg.norm(values, axis=1) if column == 0 else 0.0
        out[:, column] = 0.5 * np.maximum(np.maximum(change, own), least) * dt
    return np.where(gap[:, None], out, 0.0)


def _slope(x: Array) -> Array:
    """`s` (N, 3) with `1/2 int (int x) x x dt = x_k x s` over sample k, from five means."""
    q = np.pad(x, ((2, 2), (0, 0)), mode="edge")
    near, far = q[3:-1] - q[1:-3], q[4:] - q[:-4]
    return (82 * near - 11 * far) / 1440


def _regular(dt: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Whether a sample and its neighbours on both sides follow each other without a gap, (N,)."""
    q = np.pad(dt, 2, mode="edge")
    window = np.stack([q[k : k + len(dt)] for k in range(5)])
    regular = window.max(0) < 1.5 * window.min(0)
    regular[:2] = regular[-2:] = False
    return np.asarray(regular)


def _compound(
    theta: Array, v: Array, p: Array, dt: Array, jump: Array, first: Index, edge: Array
) -> Increments:
    """Compound consecutive samples starting at `first` into one increment each."""
    count = np.diff(np.append(first, len(dt)))
    turn, V, P = (np.zeros((len(first), 3)) for _ in range(3))
    J = np.zeros(len(first))
    for k in range(int(count.max())):
        on = np.flatnonzero(count > k) if k >= count.min() else slice(None)
        at = first[on] + k
        P[on] += V[on] * dt[at, None] + so3.rotated(turn[on], p[at])
        V[on] += so3.rotated(turn[on], v[at])
        turn[on] = so3.compound(turn[on], theta[at])
        J[on] = np.hypot(J[on], jump[at])
    return Increments(edge=edge, rotation=turn, velocity=V, position=P, jump=J)
