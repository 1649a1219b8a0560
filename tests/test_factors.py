"""Every factor: Jacobian against numerical differences at random states, zero at truth."""

from dataclasses import replace

import numpy as np
import pytest
from factor_check import assert_jacobian, random_estimate

from factors import so3
from factors.block import Block, Scope
from factors.calibration import Component, Layout
from factors.displacement import DisplacementReading, OdometerSums, displacement, phase_prior
from factors.estimate import Estimate
from factors.heading import Bearing, heading
from factors.inertial import EarthField, inertial, predict
from factors.initial_state import InitialState, initial_state
from factors.odometer_model import Coefficient, OdometerModel
from factors.position import Carried, Fixes, position
from factors.preintegration import Increments, InertialNoise, Preintegrated, corrected, preintegrate
from factors.standstill import StandstillNoise, standstill
from factors.track_width import track_width
from factors.velocity import VelocityReading, velocity

SIZES = {
    "gyro_bias": 3, "accel_bias": 3, "gyro_scale": 3, "accel_scale": 3, "scale": 1,
    "mounting": 2, "lever": 3, "delay": 1, "forward:low": 1, "lateral:low": 1,
    "cornering": 1, "slope_drift": 1, "track_width": 1, "antenna": 3,
    "gnss_offset": 3, "gnss_delay": 1,
}  # fmt: skip
LAYOUT = Layout(tuple(Component(name, np.zeros(d), np.ones(d)) for name, d in SIZES.items()))
DIM, ERRORS = LAYOUT.dim, LAYOUT.imu_errors[0]
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
    errors = 1e-3 * rng.normal(size=(3, 12))
    return preintegrate(make_increments(rng), NODES, errors, InertialNoise(1e-5, 1e-3))


def scope(node: np.ndarray | list[int], segment: np.ndarray | list[int]) -> Scope:
    """Factors at some nodes, stamped a second apart."""
    return Scope(np.asarray(node), np.asarray(segment), np.arange(len(node)) + 1.0)


INTERVALS = scope(np.arange(3), SEGMENT)


def inertial_of(pre: Preintegrated, field: EarthField, x: Estimate) -> Block:
    return inertial(pre, field, LAYOUT, INTERVALS, x)


@SEEDS
def test_inertial_jacobian(seed: int) -> None:
    """Whole chain: states near a prediction, sensor errors near the linearisation point."""
    rng = np.random.default_rng(seed)
    pre = make_pre(rng)
    x = random_estimate(rng, 4, 2, DIM)
    x.calibration[:, ERRORS] = 1e-3 * rng.normal(size=(2, 12))
    for k in range(3):  # relative rotations near the measured ones keep Log away from pi
        near = so3.exp(0.1 * rng.normal(size=3))
        x.R_nb[k + 1] = x.R_nb[k] @ pre.dR[k] @ near
    gravity = np.tile([0, 0, -9.8], (3, 1))
    field = EarthField(OMEGA, gravity, np.zeros((3, 3)))
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
        return inertial_of(pre, EarthField(OMEGA, middle @ gradient.T, gradient), e)

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
    pre0 = Preintegrated(**{**pre.__dict__, "errors": np.zeros((3, 12))})
    block = inertial_of(pre0, EarthField(OMEGA, np.tile(g, (3, 1)), np.zeros((3, 3))), x)
    raw = np.linalg.solve(pre.noise.whitening, block.residual[:, :, None])[:, :, 0]
    assert np.abs(raw).max() < 1e-8


def random_reading(rng: np.random.Generator) -> DisplacementReading:
    sums = OdometerSums(
        distance=10 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        distance_rate=rng.normal(size=(3, 3, 3)),
        distance_late=rng.normal(size=(3, 3, 3)),
        turn=0.3 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        turn_abs=0.3 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        bend=0.5 * so3.exp(0.1 * rng.normal(size=(3, 3))),
        R_mid=so3.exp(0.2 * rng.normal(size=(3, 3))),
        rate=0.3 * rng.normal(size=(3, 3)),
        delay=0.02,
        drift=np.zeros((3, 3)),
    )
    forward, lateral = np.array([1.0, 0.87, 0.7]), np.array([0.0, 0.4, 0.3])
    at_f, at_l = LAYOUT.column("forward:low"), LAYOUT.column("lateral:low")
    return DisplacementReading(
        sums=sums,
        model=OdometerModel(
            forward=Coefficient(forward, np.array([1, 2]), np.array([at_f, at_f])),
            lateral=Coefficient(lateral, np.array([1]), np.array([at_l])),
            gauge=np.array([0.0, 1.4, 1.4]),
            roll=0.03,
        ),
        sigma=np.array([[0.1, 0.02, 0.05]] * 3),
    )


@SEEDS
def test_displacement_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    reading = random_reading(rng)
    x = random_estimate(rng, 4, 2, DIM)
    errors = LAYOUT.imu_errors_of(x.calibration)[SEGMENT]
    drift = errors[:, :3] + errors[:, 6:9] * reading.sums.rate
    sums = replace(reading.sums, drift=drift)
    reading = replace(reading, sums=sums)
    assert_jacobian(lambda e: displacement(reading, LAYOUT, INTERVALS, e), x)


def test_displacement_follows_gyro_errors_and_delay() -> None:
    """The terms that are sums over increments: against sums made anew."""
    from graphnav.common.run import Odometer
    from graphnav.inertial.odometer_steps import odometer_steps, odometer_sums

    rng = np.random.default_rng(3)
    inc = make_increments(rng, 0.01)  # the bias term is first order in the turn of an interval
    t = np.arange(-1, 4, 0.01)
    odometer = Odometer(t, 3 * t + 0.3 * np.sin(3 * t), 3 + 0.9 * np.cos(3 * t), 0.0)
    held = np.zeros(0, np.int64)
    reading = random_reading(rng)
    straight = Coefficient(np.zeros(3), held, held)
    plain = replace(reading.model, gauge=np.zeros(3), lateral=straight, roll=0.0)
    reading = replace(reading, model=plain)
    x = random_estimate(rng, 4, 2, DIM)
    x.calibration[:] = 0
    x.calibration[:, LAYOUT.column("forward:low")] = 0.9

    def residual(errors: np.ndarray, delay: float) -> Block:
        pre = preintegrate(inc, NODES, np.tile(errors, (3, 1)), InertialNoise(1, 1))
        steps = odometer_steps(corrected(inc, errors), odometer, delay, np.zeros(55))
        sums = odometer_sums(inc, pre, NODES, steps, np.zeros((3, 3)))
        # only the sums are compared: the axes stay, and the factor adds no first-order change
        fixed = {"R_mid": np.tile(np.eye(3), (3, 1, 1)), "delay": 0.0, "drift": np.zeros((3, 3))}
        sums = OdometerSums(**{**sums.__dict__, **fixed})
        return displacement(replace(reading, sums=sums), LAYOUT, INTERVALS, x)

    none = np.zeros(12)
    J = residual(none, 0.0).terms[2].jacobian
    h = 1e-5
    for axis in range(3):
        d = np.eye(12)[axis] * h
        numerical = (residual(d, 0.0).residual - residual(-d, 0.0).residual) / (2 * h)
        np.testing.assert_allclose(J[:, :, axis], numerical, atol=0.03 * np.abs(J[:, :, :3]).max())
    numerical = (residual(none, 0.02).residual - residual(none, -0.02).residual) / 0.04
    J_delay = J[:, :, LAYOUT.column("delay")]
    np.testing.assert_allclose(J_delay, numerical, atol=0.03 * np.abs(J_delay).max())


@SEEDS
def test_velocity_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = random_estimate(rng, 4, 2, DIM)
    reading = VelocityReading(
        speed=5 * rng.normal(size=3),
        change=rng.normal(size=3),
        delay=0.02,
        pace=5 + rng.normal(size=3),
        rate_b=rng.normal(size=(3, 3)),
        model=random_reading(rng).model,
        sigma=np.full((3, 3), 0.1),
    )
    at_ends = scope(np.arange(1, 4), SEGMENT)
    assert_jacobian(lambda e: velocity(reading, LAYOUT, at_ends, e), x)


@SEEDS
def test_jacobians_of_the_plain_factors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = random_estimate(rng, 4, 2, DIM)
    x.R_nb[2] = x.R_nb[1] @ so3.exp(0.3 * rng.normal(size=3))
    time = np.arange(4.0)
    noise = StandstillNoise(np.array([1e-3, 2e-3, 3e-3]), np.full(3, 1e-2), np.full(3, 1e-2))
    at_nodes, second = scope([0, 2], [0, 1]), scope([1], [1])
    carried = Carried(
        np.array([1.0, 0.6]), np.array([0.3, 0.8]), rng.normal(size=(2, 3)),
        rng.normal(size=(2, 3)), so3.exp(rng.normal(size=(2, 3))), rng.normal(size=(2, 3)),
    )  # fmt: skip
    fixes = Fixes(rng.normal(size=(2, 3)), np.ones((2, 3)), carried, 0.05)
    seen, sigma = np.array([0.1, 3.0]), np.array([0.01, 0.02])
    known = InitialState(
        x.R_nb[0] @ so3.exp(0.2 * rng.normal(size=3)), x.v_n[0], x.p_n[0], np.ones(9)
    )
    for function in (
        lambda e: standstill(noise, second, e),
        lambda e: position(fixes, LAYOUT, at_nodes, e),
        lambda e: heading(Bearing(seen, sigma), LAYOUT, at_nodes, e),
        lambda e: heading(Bearing(seen, sigma, roll=0.1), LAYOUT, at_nodes, e),
        lambda e: initial_state(known, 0.0, e),
        lambda e: phase_prior(0.02, time, e),
        lambda e: track_width(np.array([0.3]), np.array([0.05]), LAYOUT, second, e),
    ):
        assert_jacobian(function, x, 1e-5)


def test_zero_at_truth_of_the_plain_factors() -> None:
    rng = np.random.default_rng(2)
    x = random_estimate(rng, 3, 1, DIM)
    x.R_nb[:], x.p_n[:], x.v_n[:] = x.R_nb[0], x.p_n[0], 0.0
    at_nodes = scope([0, 1], [0, 0])
    forward = x.R_nb[:2] @ np.array([0, 1.0, 0])
    azimuth = np.arctan2(forward[:, 0], forward[:, 1])
    pitch, turned = x.calibration[0, LAYOUT.slices["mounting"]]
    ahead = x.R_nb[:2] @ so3.exp(np.array([pitch, 0.2, turned])) @ np.array([0, 1.0, 0])
    course = np.arctan2(ahead[:, 0], ahead[:, 1])
    sure = np.full(2, 0.01)
    known = InitialState(x.R_nb[0], x.v_n[0], x.p_n[0], np.ones(9))
    blocks = [
        standstill(
            StandstillNoise(np.full(3, 1e-6), np.full(3, 1e-3), np.full(3, 1e-3)), at_nodes, x
        ),
        heading(Bearing(azimuth + 2 * np.pi, sure), LAYOUT, at_nodes, x),
        heading(Bearing(course, sure, roll=0.2), LAYOUT, at_nodes, x),
        initial_state(known, 0.0, x),
    ]
    turned = np.stack([x.R_nb[0], x.R_nb[0] @ so3.exp(np.array([0, 0, 0.4]))])
    x.calibration[:, LAYOUT.column("track_width")] = 0.9
    turning = replace(x, R_nb=turned)
    blocks.append(track_width(np.array([0.36]), np.ones(1), LAYOUT, scope([0], [0]), turning))
    for block in blocks:
        assert np.abs(block.residual).max() < 1e-9, block.kind
