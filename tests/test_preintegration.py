"""Sums between nodes against plain recursion, their Jacobians against re-integration."""

import numpy as np
import pytest

from factors import so3
from factors.preintegration import (
    SCALES,
    Increments,
    InertialNoise,
    Preintegrated,
    interval_of_increment,
    preintegrate,
    since_node,
)
from factors.so3 import Array
from graphnav.common.run import Imu
from graphnav.inertial.increments import increments

NODES = np.array([0, 20, 23, 60, 100])
NOISE = InertialNoise(gyro=2e-4, accel=3e-3)
ERRORS = np.tile(
    [2e-3, -1e-3, 3e-3, 0.02, -0.03, 0.01, 3e-3, -2e-3, 1e-3, 2e-3, 4e-3, -3e-3],
    (len(NODES) - 1, 1),
)


def made(count: int = 100, seed: int = 3) -> Increments:
    """Increments of uneven length; a bend, a bumpy road."""
    rng = np.random.default_rng(seed)
    dt = rng.uniform(0.03, 0.06, count)
    velocity = rng.normal((0, 0, 9.8), 1, (count, 3)) * dt[:, None]
    position = velocity * dt[:, None] / 2
    rate = rng.normal((0, 0, 0.3), 0.05, (count, 3))
    edge = np.concatenate([[0.0], np.cumsum(dt)])
    return Increments(edge, rate * dt[:, None], velocity, position, np.full(count, 1e-4))


def recursion(inc: Increments, first: int, last: int, errors: Array) -> tuple[Array, Array, Array]:
    """The definition: one increment after the other."""
    R, v, p = np.eye(3), np.zeros(3), np.zeros(3)
    for k in range(first, last):
        T = inc.edge[k + 1] - inc.edge[k]
        b_g, b_a, s_g, s_a = errors.reshape(4, 3)
        p = p + v * T + R @ (inc.position[k] * (1 - s_a) - b_a * T * T / 2)
        v = v + R @ (inc.velocity[k] * (1 - s_a) - b_a * T)
        R = R @ so3.exp(inc.rotation[k] * (1 - s_g) - b_g * T)
    return R, v, p


def test_sums_are_the_recursion() -> None:
    inc = made()
    pre = preintegrate(inc, NODES, ERRORS, NOISE)
    for k in range(len(NODES) - 1):
        R, v, p = recursion(inc, NODES[k], NODES[k + 1], ERRORS[k])
        np.testing.assert_allclose(pre.dR[k], R, atol=1e-13)
        np.testing.assert_allclose(pre.dv[k], v, atol=1e-13)
        np.testing.assert_allclose(pre.dp[k], p, atol=1e-13)
        assert pre.T[k] == pytest.approx(inc.edge[NODES[k + 1]] - inc.edge[NODES[k]])


@pytest.mark.parametrize("column", range(12))
def test_jacobians_are_what_the_samples_without_the_error_give(column: int) -> None:
    """The whole way from raw samples, a bend on a bumpy road."""
    rng = np.random.default_rng(3)
    dt = np.full(500, 0.01)
    signal = 0.05 * rng.normal(size=(500, 6)) + [0, 0, 0.3, 1, 0, 9.8]

    def integrated(errors: Array) -> Preintegrated:
        true = signal * (1 - errors[6:]) - errors[:6]
        imu = Imu(np.cumsum(dt), dt, true[:, :3], true[:, 3:])
        return preintegrate(increments(imu), NODES, np.zeros((len(NODES) - 1, 12)), NOISE)

    step = np.zeros(12)
    step[column] = 1e-5
    pre, more, less = integrated(0 * step), integrated(step), integrated(-step)
    turned = so3.log(so3.transpose(less.dR) @ more.dR) / 2e-5
    v, p = (more.dv - less.dv) / 2e-5, (more.dp - less.dp) / 2e-5
    pairs = ((turned, pre.dR_de), (v, pre.dv_de), (p, pre.dp_de))
    if column % 6 > 2:
        np.testing.assert_allclose(turned, 0, atol=1e-9)
        pairs = pairs[1:]
    kind = slice(column - column % 3, column - column % 3 + 3)
    for found, jacobian in pairs:
        said = jacobian[:, :, column]
        size = np.linalg.norm(jacobian[:, :, kind], axis=(1, 2))
        # an interval of only three increments is off by 4 % in the position; a scale factor acts
        # on samples, and where inside an increment white ones turned it its sum does not tell
        off = np.array([1e-3, 0.05, 1e-3, 1e-3]) * (1 if column < 6 else 10)
        assert (np.linalg.norm(found - said, axis=1) < off * size).all()


def test_whitening_is_the_noise_that_samples_would_bring() -> None:
    """2000 noisy copies of one interval: whitened errors have unit covariance."""
    copies, count = 2000, 100
    rng = np.random.default_rng(5)
    dt = np.full(copies * count, 0.05)
    force = np.array([0.5, -1.0, 9.8])

    def made(noise: float) -> Increments:
        turn, push = noise * np.sqrt(0.05) * rng.normal(size=(2, len(dt), 3))
        velocity = force * 0.05 + NOISE.accel * push
        edge = np.concatenate([[0.0], np.cumsum(dt)])
        return Increments(edge, NOISE.gyro * turn, velocity, velocity * 0.025, 0 * dt)

    nodes = np.arange(copies + 1) * count
    none = np.zeros((copies, 12))
    clean, noisy = (preintegrate(made(n), nodes, none, NOISE) for n in (0.0, 1.0))
    turned = so3.log(so3.transpose(clean.dR) @ noisy.dR)
    errors = np.concatenate([turned, noisy.dv - clean.dv, noisy.dp - clean.dp], 1)
    whitened = np.einsum("nij,nj->ni", clean.noise.whitening, errors)
    # 2000 samples scatter a variance by 3 %; steps of 50 ms leave the closed form another 2 %
    np.testing.assert_allclose(np.cov(whitened, rowvar=False), np.eye(9), atol=0.15)


def test_rotation_since_the_node_starts_anew_at_every_node() -> None:
    inc = made()
    C = since_node(inc.rotation, NODES)
    np.testing.assert_array_equal(C[NODES[:-1]], np.broadcast_to(np.eye(3), (4, 3, 3)))
    np.testing.assert_allclose(C[25], recursion(inc, 23, 25, np.zeros(12))[0], atol=1e-15)


def test_every_increment_knows_its_interval() -> None:
    np.testing.assert_array_equal(interval_of_increment(np.array([0, 2, 3, 6])), [0, 0, 1, 2, 2, 2])


def test_noise_alone_does_not_draw_a_scale() -> None:
    """Told in the sensors' own units, white noise on a standing or turning IMU has no slope by the
    scale factors; told in corrected units, 2000 intervals would each pull by one.
    """
    copies, count = 2000, 20
    rng = np.random.default_rng(6)
    turn, push = np.array([0.02, -0.01, 0.03]), np.array([0.05, -0.1, 9.8])
    noise = np.sqrt(0.05) * rng.normal(size=(2, copies * count, 3))
    edge = np.arange(copies * count + 1) * 0.05
    loud = InertialNoise(gyro=0.02, accel=0.3)
    nodes, none = np.arange(copies + 1) * count, np.zeros((copies, 12))

    def summed(share: float) -> Preintegrated:
        rotation = turn * 0.05 + share * loud.gyro * noise[0]
        velocity = push * 0.05 + share * loud.accel * noise[1]
        inc = Increments(edge, rotation, velocity, velocity * 0.025, 0 * edge[1:])
        return preintegrate(inc, nodes, none, loud)

    clean, noisy = summed(0.0), summed(1.0)
    turned = so3.log(so3.transpose(noisy.dR) @ clean.dR)  # what the states say less what is felt
    r = np.concatenate([turned, clean.dv - noisy.dv, clean.dp - noisy.dp], 1)
    W = noisy.noise.whitening
    felt = -np.concatenate([noisy.dR_de, noisy.dv_de, noisy.dp_de], 1)[:, :, SCALES]
    white = so3.mv(W, r)
    by_sensor = np.einsum("nik,ni->nk", W @ felt, white)
    by_units = np.einsum("nik,ni->nk", noisy.noise.by_scale(white), white)
    slope = by_sensor + by_units
    spread = slope.std(0) / np.sqrt(copies)
    assert (np.abs(slope.mean(0)) < 4 * spread).all()
    assert (by_sensor.mean(0)[:2] < -0.8).all()  # the bias that is taken away
