"""Inertial increments summed between nodes: mean motion, Jacobians by the
sensors' errors and noise in closed form.

With `C_k` the gyro-integrated rotation since the node, every quantity is a sum over increments, so
all intervals of a run are integrated in a handful of array passes (Forster et al. 2017, written as
sums instead of recursions).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from factors import so3

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# columns of the sensors' errors (n, 12): biases [rad/s, m/s^2] and scale factors [1]
GYRO, ACCEL, GYRO_SCALE, ACCEL_SCALE = (slice(k, k + 3) for k in range(0, 12, 3))
SCALES = slice(6, 12)
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
class IntervalNoise:
    """Noise of [theta, v, p] over n intervals, in the frame of node i.

    With w a Wiener process of angle and F = -[f]x of the mean specific force f, theta = w(T),
    v = F int w + white, p = F iint w + int white; the moments of w are exact.
    """

    T: Array  # (n,) s
    F: Array  # (n, 3, 3) m/s^2, tilt to what is felt
    gyro: Array  # (n, 3) squared density, rad^2/s
    accel: Array  # (n, 3) squared density, m^2/s^3
    jump: Array  # (n,) m, one sigma of the position left unknown

    @cached_property
    def whitening(self) -> Array:
        """Inverse Cholesky factor of the covariance, (n, 9, 9)."""
        cov = self._covariance(self.gyro, self.accel)
        cov[:, P, P] += self.jump[:, None, None] ** 2 * np.eye(3)
        return np.linalg.inv(np.linalg.cholesky(cov))  # only the lower triangle is read

    def _covariance(self, gyro: Array, accel: Array) -> Array:
        """Of the squared densities by axis (n, 3) each; lower triangle, (n, 9, 9)."""
        T, Ft = self.T, so3.transpose(self.F)
        FG = self.F * gyro[:, None, :]
        FGF = FG @ Ft

        def white(x: Array) -> Array:
            return (x[:, None] * accel)[:, :, None] * np.eye(3)

        def c(x: Array) -> Array:
            return x[:, None, None]

        cov = np.zeros((len(T), 9, 9))
        cov[:, THETA, THETA] = (T[:, None] * gyro)[:, :, None] * np.eye(3)
        cov[:, V, THETA] = c(T**2 / 2) * FG
        cov[:, P, THETA] = c(T**3 / 6) * FG
        cov[:, V, V] = c(T**3 / 3) * FGF + white(T)
        cov[:, P, V] = c(T**4 / 8) * FGF + white(T**2 / 2)
        cov[:, P, P] = c(T**5 / 20) * FGF + white(T**3 / 3)
        return cov

    def scaled(self, scale: Array) -> Array:
        """Whitening where the noise of each axis is that of a sample taken `1 - scale` times,
        (n, 9, 9); `scale` (n, 6) of gyro and accelerometer, to first order.

        A sample less its scale error carries its noise as much less. Unless the residual is told in
        the sensor's own units, every row gains by shrinking its noise: n rows draw a scale of prior
        sd s by n s^2, whatever the truth (errors in variables; Fuller 1987).
        """
        gyro, accel = self.gyro * scale[:, :3], self.accel * scale[:, 3:]
        low = np.tril(self._covariance(gyro, accel))
        more = low + so3.transpose(np.tril(low, -1))
        W = self.whitening
        return np.asarray(W + W @ more @ so3.transpose(W) @ W)

    def by_scale(self, whitened: Array) -> Array:
        """Derivative of the whitened residual (n, 9) through `scaled` per scale, (n, 9, 6)."""
        W = self.whitening
        u = so3.mtv(W, whitened).reshape(-1, 3, 3)  # theta, v, p
        T, Ft = self.T, so3.transpose(self.F)
        moments = _moments(T)
        acts = np.stack([u[:, 0], so3.mv(Ft, u[:, 1]), so3.mv(Ft, u[:, 2])], 1)
        turned = (moments @ acts) * self.gyro[:, None, :]
        pushed = (moments[:, :2, :2] @ u[:, 1:]) * self.accel[:, None, :]
        out = np.zeros((len(T), 9, 6))
        eye = np.eye(3)
        for rows, by, k in ((THETA, eye, 0), (V, self.F, 1), (P, self.F, 2)):
            out[:, rows, :3] = by * turned[:, k, None, :]
        for rows, k in ((V, 0), (P, 1)):
            out[:, rows, 3:] = eye * pushed[:, k, None, :]
        return np.asarray(W @ out)


def _moments(T: Array) -> Array:
    """Covariances of a Wiener process after T with its first and second integral, (n, 3, 3)."""
    powers = T[:, None, None] ** np.array([[1, 2, 3], [2, 3, 4], [3, 4, 5]])
    return np.asarray(powers / np.array([[1, 2, 6], [2, 3, 8], [6, 8, 20]]))


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
    noise: "IntervalNoise"
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
        noise=IntervalNoise(
            T,
            -so3.skew(dv / T[:, None]),
            *_densities(inc, nodes, noise),
            jump=np.sqrt(total(inc.jump**2)),
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
    n = len(lost)
    gyro, accel = (np.broadcast_to(x, (n, 3)) for x in (noise.gyro, noise.accel))
    return gyro**2 + lost[:, :1], accel**2 + lost[:, 1:]
