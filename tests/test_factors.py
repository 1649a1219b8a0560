"""Every factor: Jacobian against numerical differences at random states, zero at truth."""

import numpy as np
import pytest
from factor_check import assert_jacobian, random_estimate

from factors import so3
from factors.block import Block
from factors.calibration import Component, Layout, walk
from factors.calibration import prior as calibration_prior
from factors.displacement import Columns, Correction, OdometerSums, displacement, phase_prior
from factors.heading import heading
from factors.inertial import Field, inertial, predict
from factors.position import Fixes, position
from factors.preintegration import Increments, InertialNoise, Preintegrated, preintegrate
from factors.standstill import StandstillNoise, standstill
from factors.start import Start, start
from factors.track_width import track_width
from factors.velocity import velocity
from graphnav.graph.estimate import Estimate

COLUMNS = Columns(scale=6, mounting=7, lever=9, delay=12, cornering=15)
DIM = 16  # biases, scale, mounting, lever, delay, one ground factor,
# one lateral offset, cornering slip
NODES = np.array([0, 20, 40, 55])
SEGMENT = np.array([0, 0, 1])
OMEGA = np.array([0.0, 5e-5, 5e-5])
SEEDS = pytest.mark.parametrize("seed", range(3))


def make_increments(rng: np.random.Generator, turning: float = 0.3) -> Increments:
    edge = np.arange(NODES[-1] + 1) * 0.05
    n = len(edge) - 1
    velocity_ = 0.05 * (np.array([0, 0, 9.8]) + rng.normal(size=(n, 3)))
    return Increments(
        edge,
        0.05 * turning * rng.normal(size=(n, 3)),
        velocity_,
        0.025 * velocity_,
        np.full(n, 1e-5),
    )


def make_pre(rng: np.random.Generator) -> Preintegrated:
    bias = 1e-3 * rng.normal(size=(3, 6))
    return preintegrate(make_increments(rng), NODES, bias, InertialNoise(1e-5, 1e-3))


def inertial_of(pre: Preintegrated, field: Field, x: Estimate) -> Block:
    bias = x.calibration[SEGMENT, :6]
    time = np.array([0, 1, 2, 2.75])
    return inertial(pre, x.R_nb, x.v_n, x.p_n, bias, field, time, SEGMENT, DIM)


@SEEDS
def test_inertial_jacobian(seed: int) -> None:
    """Whole chain: states near a prediction, biases near the linearisation point."""
    rng = np.random.default_rng(seed)
    pre = make_pre(rng)
    x = random_estimate(rng, 4, 2, DIM)
    x.calibration[:, :6] = 1e-3 * rng.normal(size=(2, 6))
    for k in range(3):  # relative rotations near the measured ones keep Log away from pi
        near = so3.exp(0.1 * rng.normal(size=3))
        x.R_nb[k + 1] = x.R_nb[k] @ pre.dR[k] @ near
    gravity = np.tile([0, 0, -9.8], (3, 1))
    field = Field(OMEGA, gravity, np.zeros((3, 3)))
    assert_jacobian(lambda e: inertial_of(pre, field, e), x, 3e-5)


def test_inertial_gravity_gradient_enters_the_jacobian() -> None:
    rng = np.random.default_rng(0)
    pre = make_pre(rng)
    x = random_estimate(rng, 4, 2, DIM)
    x.calibration[:] = 0
    for k in range(3):
        x.R_nb[k + 1] = x.R_nb[k] @ pre.dR[k]
    gradient = 0.1 * rng.normal(size=(3, 3))  # far above the Earth's, so that it shows

    def at(e: Estimate) -> Block:
        middle = 0.5 * (e.p_n[1:] + e.p_n[:-1])
        return inertial_of(pre, Field(OMEGA, middle @ gradient.T, gradient), e)

    assert_jacobian(at, x, 3e-5)


def test_inertial_is_zero_on_its_own_prediction() -> None:
    """`predict` and the residual are the same motion, told forwards and backwards."""
    rng = np.random.default_rng(5)
    pre = make_pre(rng)
    g = np.array([0.1, 0, -9.8])
    R, v, p = [so3.exp(rng.normal(size=3))], [rng.normal(size=3)], [np.zeros(3)]
    for i in range(3):
        R_j, v_j, p_j = predict(pre, i, R[-1], v[-1], p[-1], g, OMEGA)
        R.append(R_j)
        v.append(v_j)
        p.append(p_j)
    c = np.zeros((2, DIM))
    x = Estimate(np.array(R), np.array(v), np.array(p), np.zeros(4), c)
    pre0 = Preintegrated(**{**pre.__dict__, "bias": np.zeros((3, 6))})
    block = inertial_of(pre0, Field(OMEGA, np.tile(g, (3, 1)), np.zeros((3, 3))), x)
    raw = np.linalg.solve(pre.whitening, block.residual[:, :, None])[:, :, 0]
    assert np.abs(raw).max() < 1e-8


def displacement_setup(rng: np.random.Generator) -> tuple[OdometerSums, Correction]:
    sums = OdometerSums(
        distance=10 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        distance_rate=rng.normal(size=(3, 3, 3)),
        distance_late=rng.normal(size=(3, 3, 3)),
        turn=0.3 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        turn_abs=0.3 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        bend=0.5 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        R_mid=so3.exp(0.2 * rng.normal(size=(3, 3))),
        delay=0.02,
        bias=np.zeros((3, 3)),
    )
    correction = Correction(
        forward=np.array([1.0, 0.87, 0.7]),
        gauge=np.array([0.0, 1.4, 1.4]),
        lateral=np.array([0.0, 0.4, 0.3]),
        forward_column=np.array([-1, 13, 13]),
        lateral_column=np.array([-1, 14, -1]),
        sigma=np.array([[0.1, 0.02, 0.05]] * 3),
    )
    return sums, correction


@SEEDS
def test_displacement_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sums, correction = displacement_setup(rng)
    x = random_estimate(rng, 4, 2, DIM)
    sums = OdometerSums(**{**sums.__dict__, "bias": x.calibration[SEGMENT, :3]})
    node = np.arange(3)

    def at(e: Estimate) -> Block:
        c = e.calibration[SEGMENT]
        return displacement(
            sums, correction, COLUMNS, 0.03, node, e.R_nb, e.p_n, e.phase, c, SEGMENT, node + 1.0
        )

    assert_jacobian(at, x)


def test_displacement_follows_gyro_bias_and_delay() -> None:
    """The two terms that are sums over increments: against sums made anew."""
    from graphnav.common.run import Odometer
    from graphnav.inertial.odometry import odometer_steps, odometer_sums

    rng = np.random.default_rng(3)
    inc = make_increments(rng, 0.01)  # the bias term is first order in the turn of an interval
    t = np.arange(-1, 4, 0.01)
    odometer = Odometer(t, 3 * t + 0.3 * np.sin(3 * t), 3 + 0.9 * np.cos(3 * t), 0.0)
    _, correction = displacement_setup(rng)
    plain = Correction(**{**correction.__dict__, "gauge": np.zeros(3), "lateral": np.zeros(3)})
    plain = Correction(**{**plain.__dict__, "lateral_column": np.full(3, -1)})
    x = random_estimate(rng, 4, 2, DIM)
    x.calibration[:] = 0
    x.calibration[:, 13] = 0.9

    def residual(bias: np.ndarray, delay: float) -> Block:
        pre = preintegrate(
            inc, NODES, np.tile(np.append(bias, [0, 0, 0]), (3, 1)), InertialNoise(1, 1)
        )
        steps = odometer_steps(inc, odometer, delay, np.zeros(55), np.zeros(55))
        sums = odometer_sums(inc, pre, NODES, steps, np.zeros((3, 3)))
        # only the sums are compared: the axes stay, and the factor adds no first-order change
        fixed = {"R_mid": np.tile(np.eye(3), (3, 1, 1)), "delay": 0.0, "bias": np.zeros((3, 3))}
        sums = OdometerSums(**{**sums.__dict__, **fixed})
        c = x.calibration[SEGMENT]
        node = np.arange(3)
        return displacement(
            sums, plain, COLUMNS, 0.0, node, x.R_nb, x.p_n, x.phase, c, SEGMENT, node + 1.0
        )

    J = residual(np.zeros(3), 0.0).terms[2].jacobian
    h = 1e-5
    for axis in range(3):
        d = np.eye(3)[axis] * h
        numerical = (residual(d, 0.0).residual - residual(-d, 0.0).residual) / (2 * h)
        np.testing.assert_allclose(J[:, :, axis], numerical, atol=0.03 * np.abs(J[:, :, :3]).max())
    numerical = (
        residual(np.zeros(3), 0.02).residual - residual(np.zeros(3), -0.02).residual
    ) / 0.04
    np.testing.assert_allclose(J[:, :, 12], numerical, atol=0.03 * np.abs(J[:, :, 12]).max())


@SEEDS
def test_velocity_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = random_estimate(rng, 4, 2, DIM)
    node = np.arange(1, 4)
    speed, lateral, rate = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(3, 3))
    sigma = np.full((3, 3), 0.1)

    def at(e: Estimate) -> Block:
        c = e.calibration[SEGMENT]
        return velocity(
            speed, lateral, sigma, rate, COLUMNS, 0.02, node, e.R_nb, e.v_n, c, SEGMENT, node * 1.0
        )

    assert_jacobian(at, x)


@SEEDS
def test_jacobians_of_the_plain_factors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = random_estimate(rng, 4, 2, DIM)
    x.R_nb[2] = x.R_nb[1] @ so3.exp(0.3 * rng.normal(size=3))
    time = np.arange(4.0)
    noise = StandstillNoise(np.array([1e-3, 2e-3, 3e-3]), 1e-2, 1e-2)
    at_nodes = np.array([0, 2])
    fixes = Fixes(
        rng.normal(size=(2, 3)), np.ones((2, 3)), np.array([0.01, -0.02]), at_nodes,
        np.array([0, 1]), time[:2],
    )  # fmt: skip
    known = Start(x.R_nb[0] @ so3.exp(0.2 * rng.normal(size=3)), x.v_n[0], x.p_n[0], np.ones(9))
    for function in (
        lambda e: standstill(np.array([1]), e.R_nb, e.v_n, e.p_n, time[:1], noise),
        lambda e: position(fixes, 9, 12, e.R_nb, e.v_n, e.p_n, e.calibration),
        lambda e: heading(np.array([0.1, 3.0]), np.array([0.01, 0.02]), at_nodes, e.R_nb, time[:2]),
        lambda e: start(known, e.R_nb[0], e.v_n[0], e.p_n[0], 0.0),
        lambda e: phase_prior(e.phase, time, 0.02),
        lambda e: track_width(
            np.array([0.3]),
            np.array([0.05]),
            6,
            np.array([1]),
            e.R_nb,
            e.calibration[[1]],
            np.array([1]),
            time[:1],
        ),
    ):
        assert_jacobian(function, x, 1e-5)


def test_calibration_chain() -> None:
    rng = np.random.default_rng(1)
    layout = Layout(
        (
            Component("gyro_bias", np.zeros(3), np.full(3, 0.1), 0.01),
            Component("scale", np.ones(1), np.full(1, 0.02), 1e-3),
            Component("lever", np.zeros(2), np.ones(2)),
        )
    )
    assert layout.dim == 6
    assert layout.column("scale") == 3 and layout.column("delay") == -1
    x = random_estimate(rng, 2, 3, layout.dim)
    time = np.array([5.0, 15.0, 25.0])
    assert_jacobian(lambda e: calibration_prior(layout, e.calibration), x)
    blocks = walk(layout, x.calibration, time, ("scale",))
    assert [b.kind for b in blocks] == ["calibration_walk", "scale_walk"]
    for k, block in enumerate(blocks):
        assert_jacobian(lambda e, k=k: walk(layout, e.calibration, time, ("scale",))[k], x)
        assert block.robust == (k == 1)
    still = Estimate(x.R_nb, x.v_n, x.p_n, x.phase, np.tile(layout.prior, (3, 1)))
    assert np.abs(calibration_prior(layout, still.calibration).residual).max() == 0
    assert all(np.abs(b.residual).max() == 0 for b in walk(layout, still.calibration, time, ()))


def test_zero_at_truth_of_the_plain_factors() -> None:
    rng = np.random.default_rng(2)
    x = random_estimate(rng, 3, 1, DIM)
    x.R_nb[:], x.p_n[:], x.v_n[:] = x.R_nb[0], x.p_n[0], 0.0
    node, time = np.array([0, 1]), np.array([1.0, 2.0])
    lever = rng.normal(size=3)
    fix = x.p_n[node] + x.R_nb[node] @ lever
    forward = x.R_nb[node] @ np.array([0, 1.0, 0])
    azimuth = np.arctan2(forward[:, 0], forward[:, 1])
    known = Start(x.R_nb[0], x.v_n[0], x.p_n[0], np.ones(9))
    c = np.concatenate([lever, np.zeros(3)])[None]
    blocks = [
        standstill(node, x.R_nb, x.v_n, x.p_n, time, StandstillNoise(np.full(3, 1e-6), 1e-3, 1e-3)),
        position(
            Fixes(fix, np.ones((2, 3)), np.zeros(2), node, np.zeros(2, np.int64), time),
            0,
            3,
            x.R_nb,
            x.v_n,
            x.p_n,
            c,
        ),
        heading(azimuth + 2 * np.pi, np.full(2, 0.01), node, x.R_nb, time),
        start(known, x.R_nb[0], x.v_n[0], x.p_n[0], 0.0),
    ]
    turned = np.stack([x.R_nb[0], x.R_nb[0] @ so3.exp(np.array([0, 0, 0.4]))])
    width = np.full((1, DIM), 0.9)
    first = np.zeros(1, np.int64)
    swept = np.array([0.36])
    blocks.append(track_width(swept, np.ones(1), 6, first, turned, width, first, time[:1]))
    for block in blocks:
        assert np.abs(block.residual).max() < 1e-9, block.kind
