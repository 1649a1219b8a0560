"""Factors in the place of accelerometers: Jacobians by differences, zero at truth."""

import numpy as np
import pytest
from factor_check import assert_jacobian, random_estimate

from factors import so3
from factors.block import Scope
from factors.driving import ExpectedDriving, driving
from factors.estimate import Estimate
from graphnav.graph.unfelt import gains_told

INTERVALS = Scope(np.arange(4), np.zeros(4, np.int64), np.arange(1.0, 5.0))


def expected(rng: np.random.Generator, turn: np.ndarray, change: np.ndarray) -> ExpectedDriving:
    """Over intervals of 1 s that turn by `turn` (4, 3) rad each, evenly."""
    even = np.linspace(0.005, 0.995, 100)
    mean = so3.exp(even[:, None, None] * turn).mean(0)
    return ExpectedDriving(np.ones(4), change, mean, *rng.uniform(0.1, 1.0, (2, 4, 3)))


@pytest.mark.parametrize(
    ("missing", "untold"), [((), []), ((0,), [1]), ((1,), [0]), ((0, 1), [0, 1]), ((5,), [2])]
)
def test_without_the_gyro_of_a_tilt_force_is_as_well_a_slope(
    missing: tuple[int, ...], untold: list[int]
) -> None:
    sensed = ~np.isin(np.arange(6), missing)
    assert np.flatnonzero(~gains_told(sensed)).tolist() == untold


@pytest.mark.parametrize("seed", range(3))
def test_driving_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = random_estimate(rng, 5, 1, 1)
    known = expected(rng, 0.3 * rng.normal(size=(4, 3)), rng.normal(size=(4, 3)))
    assert_jacobian(lambda x: driving(known, INTERVALS, x), x)


def test_driving_vanishes_on_an_arc() -> None:
    """A steady bend of radius 30 m up a slope: zero."""
    w, v = 0.4, 12.0
    angle = w * np.arange(5.0)
    slope = so3.exp(np.array([0.1, 0.05, 0.0]))
    R = slope @ so3.exp(np.outer(angle, [0, 0, 1.0]))
    p = v / w * np.stack([np.cos(angle) - 1, np.sin(angle), 0 * angle], -1) @ slope.T
    x = Estimate(R, R @ np.array([0, v, 0.0]), p, np.zeros(5), np.zeros((1, 1)))
    known = expected(np.random.default_rng(0), np.tile([0, 0, w], (4, 1)), np.zeros((4, 3)))
    np.testing.assert_allclose(driving(known, INTERVALS, x).residual, 0, atol=1e-3)
    slower = Estimate(R, 0.99 * x.v_n, p, x.phase, x.calibration)
    assert np.abs(driving(known, INTERVALS, slower).residual).max() > 0.1


def test_driving_expects_the_change_it_is_told() -> None:
    """Straight ahead at 2 m/s^2."""
    t = np.arange(5.0)
    v, p = np.zeros((5, 3)), np.zeros((5, 3))
    v[:, 1], p[:, 1] = 2 * t, t**2
    x = Estimate(np.tile(np.eye(3), (5, 1, 1)), v, p, np.zeros(5), np.zeros((1, 1)))
    change = np.tile([0, 2.0, 0], (4, 1))
    known = expected(np.random.default_rng(0), np.zeros((4, 3)), change)
    np.testing.assert_allclose(driving(known, INTERVALS, x).residual, 0, atol=1e-12)
