"""Raw inertial samples compounded to about 20 Hz, with coning and sculling terms.

A sample is a mean over its interval; what the mean hides is recovered from its two neighbours on
either side (rate and force as polynomials through five means: a smoother may look ahead), then
samples are compounded. The terms are Bortz's
`1/2 int (int w) x w` and its bilinear form for the velocity (Savage 1998), carried one order
further than the usual two-sample formula: a tenth of its error under vibration at a tenth of the
sampling rate.
"""

from dataclasses import replace

import numpy as np

from factors import so3
from factors.block import Index
from factors.preintegration import Increments
from graphnav.common.run import Array, Imu

NEIGHBOURS = 2  # samples to either side that the polynomials take
BLOCK = 100_000  # samples taken at a time: 400,000 at once take half as long again (cache)
GRID_S = 0.05  # duration of an increment the grouping aims at


def increments(imu: Imu, grid_s: float = GRID_S) -> Increments:
    """Compound samples (N) into increments (M <= N); a last short group keeps the rest.

    An increment's rotation and velocity are in the body frame of its start.
    """
    usual, count = float(np.median(imu.dt)), len(imu.dt)
    size = max(1, round(grid_s / usual))
    step = size * max(1, BLOCK // size)
    parts = [_block(imu, first, min(first + step, count), size) for first in range(0, count, step)]
    names = ("rotation", "velocity", "position", "jump", "doubt")
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    edge = np.concatenate([parts[0].edge[:1], *(part.edge[1:] for part in parts)])
    return Increments(edge=edge, **columns)


def _block(imu: Imu, first: int, end: int, size: int) -> Increments:
    """Increments of samples `first` to `end - 1`, `size` in each."""
    around = slice(max(first - NEIGHBOURS, 0), end + NEIGHBOURS)
    own = slice(first - around.start, end - around.start)
    dt = imu.dt[around]
    alpha, u = imu.gyro[around] * dt[:, None], imu.accel[around] * dt[:, None]
    regular = _regular(dt)[:, None]
    slope_w, slope_f = _slope(alpha) * regular, _slope(u) * regular
    theta = alpha + so3.cross(alpha, slope_w)
    # the left Jacobian of alpha turns the mean force to the start of the sample (third order:
    # 1e-9 at 0.1 rad), sculling adds what the means hide
    turned = so3.cross(alpha, u)
    v = u + 0.5 * turned + so3.cross(alpha, turned) / 6
    v += so3.cross(alpha, slope_f) + so3.cross(u, slope_w)
    p = (0.5 * v - turned / 12 - slope_f) * dt[:, None]
    change = np.diff(u, axis=0, prepend=u[:1])
    jump = np.sqrt(np.einsum("ij,ij->i", change, change) / 12) * dt
    lost = np.zeros((end - first, 2)) if imu.doubt is None else imu.doubt[first:end]

    at = np.arange(0, end - first, size)
    time = np.concatenate([imu.time[first : first + 1] - imu.dt[first], imu.time[first:end]])
    edge = time[np.append(at, end - first)]
    whole = _compound(theta[own], v[own], p[own], dt[own], jump[own], at, edge)
    return replace(whole, doubt=np.sqrt(np.add.reduceat(lost**2, at, axis=0)))


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
    V, P = np.zeros((len(first), 3)), np.zeros((len(first), 3))
    R = np.tile(np.eye(3), (len(first), 1, 1))
    J = np.zeros(len(first))
    for k in range(int(count.max())):
        on = np.flatnonzero(count > k) if k >= count.min() else slice(None)
        at = first[on] + k
        P[on] += V[on] * dt[at, None] + so3.mv(R[on], p[at])
        V[on] += so3.mv(R[on], v[at])
        R[on] = R[on] @ so3.exp(theta[at])
        J[on] = np.hypot(J[on], jump[at])
    return Increments(edge=edge, rotation=so3.log(R), velocity=V, position=P, jump=J)
