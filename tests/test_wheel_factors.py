"""The rover's factors: Jacobians against numerical ones, and what makes them vanish."""

from dataclasses import replace

import numpy as np
import pytest
from factor_check import assert_jacobian, random_estimate

from factors import rover_wheels as rw
from factors import so3
from factors import terrain_slip as ts
from factors.block import Block, Scope
from factors.calibration import Component, Layout
from factors.estimate import Estimate
from factors.level import level

SEEDS = pytest.mark.parametrize("seed", range(3))
NAMES = ("accel_bias", "toe", "slip_coefficient", "side_slip", "yaw_slip")
LAYOUT = Layout(
    tuple(
        Component(
            name, np.zeros(3 if name == "accel_bias" else 1), np.ones(3)[: 3 if i == 0 else 1]
        )
        for i, name in enumerate(NAMES)
    )
)
N = 5
SEGMENT = np.array([0, 0, 1, 1])
TIME = np.linspace(0.0, N - 1.0, N)
INTERVALS = Scope(np.arange(N - 1), SEGMENT, TIME[1:])


def states(rng: np.random.Generator) -> Estimate:
    x = random_estimate(rng, N, 2, LAYOUT.dim)
    for k in range(N - 1):
        x.R_nb[k + 1] = x.R_nb[k] @ so3.exp(0.1 * rng.normal(size=3))
    x.p_n[:] = 0.1 * rng.normal(size=(N, 3))
    x.v_n[:] = 0.1 * rng.normal(size=(N, 3))
    return x


def random_sums(rng: np.random.Generator) -> rw.WheelSums:
    n = N - 1
    return rw.WheelSums(
        displacement=0.1 * rng.normal(size=(n, 3)),
        path=rng.uniform(0.05, 0.2, n),
        ahead=rng.uniform(-0.2, 0.2, n),
        yaw=0.05 * rng.normal(size=n),
        centroid_b=rng.normal(size=(N, 3)),
    )


@SEEDS
def test_wheel_displacement_jacobian(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, sums, sigma = states(rng), random_sums(rng), np.full((N - 1, 3), 0.7)

    def block(x: Estimate) -> Block:
        return rw.wheel_displacement(sums, rw.turns(x.R_nb), sigma, LAYOUT, INTERVALS, x)

    assert_jacobian(block, x)


@SEEDS
def test_wheel_yaw_tilt_level_and_speed_jacobians(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, sums, sigma = states(rng), random_sums(rng), np.full(N, 0.7)
    g_n, vectors = np.array([0.0, 0.0, -9.8]), rng.normal(size=(N, 3))
    every = Scope(np.arange(N), np.array([0, 0, 0, 1, 1]), TIME)
    for function in (
        lambda x: rw.wheel_yaw(sums, rw.turns(x.R_nb), sigma[1:], LAYOUT, INTERVALS, x),
        lambda x: rw.tilt(rw.turns(x.R_nb), sigma[1:], INTERVALS),
        lambda x: level(vectors, g_n, np.stack([sigma] * 2, -1), LAYOUT, every, x),
        lambda x: rw.wheel_speed(vectors, sigma, LAYOUT, every, x),
    ):
        assert_jacobian(function, x)


@SEEDS
def test_bounds_and_wander_jacobians(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = states(rng)
    wandering = (rw.Wandering(LAYOUT.components[2], 20.0),)
    path, time = np.array([3.0, 8.0]), np.array([5.0, 15.0])
    for which in range(2):

        def wander(x: Estimate, which: int = which) -> Block:
            return rw.wander(LAYOUT, wandering, x.calibration, path, time)[which]

        assert_jacobian(wander, x)
    x.calibration[:, LAYOUT.column("slip_coefficient")] = [1.4, 0.2]

    def block(x: Estimate) -> Block:
        return rw.bounded(rw.Bounds("slip_coefficient", 0.7, 1.0, 0.1), LAYOUT, time, x)

    assert_jacobian(block, x)
    np.testing.assert_allclose(block(x).residual[:, 0], [4.0, -5.0])
    inside = replace(x, calibration=0 * x.calibration + 0.9)
    assert not block(inside).residual.any()


def ground(s: np.ndarray) -> np.ndarray:
    return np.asarray(0.03 * np.sin(4.2 * s) + 0.04 * np.sin(2.3 * s + 1) + 0.01 * np.sin(7 * s))


def profile(k: float, L_1: float, L_2: float) -> ts.Profile:
    """What the linkage feels of `ground`, along the way the wheels count."""
    s = k * np.arange(0.0, 40.0, 0.02)
    front, middle, rear = ground(s + L_1), ground(s), ground(s - L_2)
    return ts.Profile(0.02, front - middle, middle - rear, L_1, L_2)


@pytest.mark.parametrize(("L_1", "L_2"), [(0.6, 0.6), (0.8, 0.5)])
def test_terrain_mismatch_vanishes_at_the_true_slip_only(L_1: float, L_2: float) -> None:
    felt, at = profile(0.87, L_1, L_2), np.arange(3.0, 36.0, 0.1)
    one = np.ones_like(at)
    right = np.abs(ts.mismatch(felt, at, 0.87 * one, one)[0]).max()
    wrong = [np.abs(ts.mismatch(felt, at, k * one, one)[0]).max() for k in (0.84, 0.90)]
    assert 100 * right < min(wrong)


def test_terrain_slip_jacobian() -> None:
    rng = np.random.default_rng(1)
    x = states(rng)
    x.calibration[:, LAYOUT.column("slip_coefficient")] = [0.85, 0.93]
    s = np.arange(0.0, 40.0, 0.02)
    track = ts.WheelTrack(
        side="left",
        profile=ts.Profile(0.02, 0.1 * s**2, -0.05 * s**2, 0.8, 0.5),  # np.gradient is exact on it
        at=np.round(rng.uniform(3, 36, 4), 2),
        time=np.arange(4.0),
        segment=SEGMENT,
        arc=rng.uniform(0.97, 1, 4),
        offset=np.zeros(4),
        sigma=np.full(4, 0.01),
    )

    def block(x: Estimate) -> Block:
        return ts.terrain_slip(track, LAYOUT, x)

    assert_jacobian(block, x, rtol=0.02)  # the profile is a polygon: its slope is a step function


def test_arc_share() -> None:
    share = ts.arc_share(np.array([0.0, 0.5, -0.5]), 0.6)
    np.testing.assert_allclose(share, [1, np.arctan(0.3) / 0.3, np.arctan(0.3) / 0.3])
