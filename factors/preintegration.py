"""Inertial increments summed between nodes: mean motion, Jacobians by the
sensors' errors and noise in closed form.

With `C_k` the gyro-integrated rotation since the node, every quantity is a sum over increments, so
all intervals of a run are integrated in a handful of array passes (Forster et al. 2017, written as
sums instead of recursions).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from factors import so3

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# columns of the sensors' errors (n, 12): biases [rad/s, m/s^2] and scale factors [1]
GYRO, ACCEL, GYRO_SCALE, ACCEL_SCALE = (slice(k, k + 3) for k in range(0, 12, 3))
THETA, V, P = slice(0, 3), slice(3, 6), slice(6, 9)  # rows of the covariance of an interval


@dataclass(frozen=True)
class Increments:
    """Compounded inertial increments on a grid of edges; each in the body frame of its start."""

    edge: Array  # (M + 1,) s
    rotation: Array  # (M, 3) rad, rotation vector
    velocity: Array  # (M, 3) m/s
    position: Array  # (M, 3) m, double integral of specific force inside the increment
    jump: Array  # (M,) m, 1 sigma of the position left unknown by motion inside a sample
    doubt: Array | None = (
        None  # (M, 2) rad, m/s: 1 sigma of turn and speed lost in a gap of the data
    )


@dataclass(frozen=True)
class InertialNoise:
    """White noise of the sensors, by axis of b and by interval where it differs: broadcast to
    (n, 3).
    """

    gyro: Array | float  # rad/sqrt(s)
    accel: Array | float  # m/s/sqrt(s)


@dataclass(frozen=True)
class Preintegrated:
    """Motion between consecutive nodes i, j in the body frame of node i (n intervals)."""

    T: Array  # (n,) s
    dR: Array  # (n, 3, 3) body j to body i, non-rotating
    dv: Array  # (n, 3) m/s
    dp: Array  # (n, 3) m
    dR_de: Array  # (n, 3, 12) right perturbation of dR per error of the sensors
    dv_de: Array  # (n, 3, 12)
    dp_de: Array
    whitening: Array  # (n, 9, 9) inverse Cholesky factor of the covariance of [theta, v, p]
    C: Array  # (M + 1, 3, 3) rotation since its node at every edge; the first of each interval is I
    errors: Array  # (n, 12) of the sensors, that it was integrated with


def interval_of_increment(nodes: Index) -> Index:
    """Interval number of every increment between the first and the last node, (M,)."""
    return np.repeat(np.arange(len(nodes) - 1), np.diff(nodes))


def since_node(rotation: Array, nodes: Index) -> Array:
    """`C_k`, the rotation since the last node at the start of every increment, (M, 3, 3).

    A loop over the position inside the interval, each step over all intervals at once.
    """
    step = so3.exp(rotation)
    C = np.empty_like(step)
    start, count = nodes[:-1], np.diff(nodes)
    current = np.broadcast_to(np.eye(3), (len(start), 3, 3)).copy()
    for k in range(int(count.max(initial=0))):
        active = np.flatnonzero(count > k)
        at = start[active] + k
        C[at] = current[active]
        current[active] = current[active] @ step[at]
    return C


def corrected(inc: Increments, errors: Array) -> Increments:
    """Increments less what the sensors' errors (M, 12) or (12,) add: `measured - b dt - s measured`
    by axis (Source: Groves 2013, 4.4).

    An increment's own rotation turns its bias only by half its angle: well below the noise.
    """
    dt = np.diff(inc.edge)[:, None]
    push = errors[..., ACCEL]
    kept = 1 - errors[..., ACCEL_SCALE]
    return replace(
        inc,
        rotation=inc.rotation * (1 - errors[..., GYRO_SCALE]) - errors[..., GYRO] * dt,
        velocity=inc.velocity * kept - push * dt,
        position=inc.position * kept - 0.5 * push * dt * dt,
    )


def preintegrate(
    inc: Increments, nodes: Index, errors: Array, noise: InertialNoise
) -> Preintegrated:
    """Integrate between nodes given as edge numbers (N,) with the sensors' errors (N - 1, 12).

    The nodes must span all increments: `nodes[0] == 0`, `nodes[-1] == M`.
    """
    owner = interval_of_increment(nodes)
    true = corrected(inc, errors[owner])
    C = since_node(true.rotation, nodes)
    total = _summer(nodes[:-1])
    T = np.diff(inc.edge[nodes])
    rest = inc.edge[nodes[1:]][owner] - inc.edge[1:]  # time left after each increment
    a = so3.mv(C, true.velocity)
    dv = total(a)
    last = nodes[1:] - 1
    dR = C[last] @ so3.exp(true.rotation[last])
    by_error = _by_error(inc, true, C, nodes)
    return Preintegrated(
        T=T,
        dR=dR,
        dv=dv,
        dp=total(a * rest[:, None] + so3.mv(C, true.position)),
        dR_de=-so3.transpose(dR) @ by_error[0],
        dv_de=by_error[1],
        dp_de=by_error[2],
        whitening=_whitening(
            T, dv / T[:, None], np.sqrt(total(inc.jump**2)), _densities(inc, nodes, noise)
        ),
        C=np.concatenate([C, dR[-1:]]),
        errors=errors,
    )


def _by_error(
    inc: Increments, true: Increments, C: Array, nodes: Index
) -> tuple[Array, Array, Array]:
    """Angle taken off in the frame of the node, and derivatives of velocity and position change,
    per error of the sensors, (n, 3, 12) each.
    """
    first, owner, total = nodes[:-1], interval_of_increment(nodes), _summer(nodes[:-1])
    dt = np.diff(inc.edge)[:, None]
    rest_mid = (inc.edge[nodes[1:]][owner] - 0.5 * (inc.edge[1:] + inc.edge[:-1]))[:, None, None]
    C_mid = C @ so3.exp(0.5 * true.rotation)
    felt = so3.skew(so3.mv(C, true.velocity))

    def turned(by: Array) -> tuple[Array, Array, Array]:
        """Gyro errors that turn an increment by `by` (M, 3 or 1) rad, and through the angle built
        up so far what is felt later.
        """
        angle = C_mid * by[:, None, :]
        before = np.cumsum(angle, 0)
        before = before - 0.5 * angle - (before - angle)[first][owner]
        tilt = felt @ before
        return total(angle), total(tilt), total(tilt * rest_mid)

    def pushed(by: Array) -> tuple[Array, Array, Array]:
        """Accelerometer errors that push an increment by `by` (M, 3 or 1) m/s."""
        push = -C_mid * by[:, None, :]
        dv = total(push)
        return np.zeros_like(dv), dv, total(push * rest_mid)

    parts = turned(dt), pushed(dt), turned(inc.rotation), pushed(inc.velocity)
    by_R, by_v, by_p = (np.concatenate(x, 2) for x in zip(*parts, strict=True))
    return by_R, by_v, by_p


class _summer:
    """Sum of per-increment arrays over each interval."""

    def __init__(self, first: Index) -> None:
        self.first = first

    def __call__(self, x: Array) -> Array:
        return np.add.reduceat(x, self.first, axis=0)


def doubt_of(inc: Increments, nodes: Index) -> Array:
    """Turn [rad] and speed [m/s] lost in gaps of each interval, one sigma, (n, 2)."""
    if inc.doubt is None:
        return np.zeros((len(nodes) - 1, 2))
    return np.sqrt(np.add.reduceat(inc.doubt**2, nodes[:-1], axis=0))


def _densities(inc: Increments, nodes: Index, noise: InertialNoise) -> tuple[Array, Array]:
    """Squared noise densities of gyro and accelerometer in each interval, gaps spread over it,
    (n, 3) each.
    """
    lost = doubt_of(inc, nodes) ** 2 / np.diff(inc.edge[nodes])[:, None]
    return np.square(noise.gyro) + lost[:, :1], np.square(noise.accel) + lost[:, 1:]


def _whitening(T: Array, f: Array, jump: Array, density: tuple[Array, Array]) -> Array:
    """Inverse Cholesky factor of the covariance of [theta, v, p] after T, in the frame of node i.

    `density` (n, 3) each: squared noise of gyro and accelerometer. With w a Wiener process of angle
    and f the mean specific force, theta = w(T), v = -[f]x int w + white, p = -[f]x iint w +
    int white; the moments of w are exact.
    """
    n = len(T)
    F = -so3.skew(f)
    Ft = so3.transpose(F)

    def c(x: Array) -> Array:
        return x[:, None, None]

    gyro, accel = (np.broadcast_to(x, (n, 3))[:, :, None] * np.eye(3) for x in density)
    FG = F @ gyro
    FGF = FG @ Ft
    cov = np.empty((n, 9, 9))
    cov[:, THETA, THETA] = c(T) * gyro
    cov[:, V, THETA] = c(T**2 / 2) * FG
    cov[:, P, THETA] = c(T**3 / 6) * FG
    cov[:, V, V] = c(T**3 / 3) * FGF + c(T) * accel
    cov[:, P, V] = c(T**4 / 8) * FGF + c(T**2 / 2) * accel
    cov[:, P, P] = c(T**5 / 20) * FGF + c(T**3 / 3) * accel + c(jump**2) * np.eye(3)
    return np.linalg.inv(np.linalg.cholesky(cov))  # only the lower triangle is read
