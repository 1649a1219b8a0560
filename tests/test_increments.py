"""Compounded samples against a fine integration of the motion they come from."""

import numpy as np
import pytest

from factors import so3
from graphnav.common.run import Array, Imu
from graphnav.inertial import increments as module
from graphnav.inertial.increments import increments


def motion(t: Array, hz: float) -> tuple[Array, Array]:
    """A cone and a rocking force at `hz`, on a slow turn: (n, 3) rad/s and m/s^2."""
    a = 2 * np.pi * hz * t
    zero = np.zeros_like(t)
    gyro = np.stack([0.3 * np.cos(a), 0.3 * np.sin(a), 0.2 + zero], -1)
    accel = np.stack([np.sin(a), 2 * np.cos(a), 9.8 + 0.5 * np.sin(a)], -1)
    return gyro, accel


def sampled(seconds: float, rate: float, hz: float) -> Imu:
    """Exact means over the samples of an IMU at `rate`."""
    fine = 40
    count = round(seconds * rate)
    t = (np.arange(count * fine) + 0.5) / (rate * fine)
    gyro, accel = (x.reshape(count, fine, 3).mean(1) for x in motion(t, hz))
    return Imu(np.arange(1, count + 1) / rate, np.full(count, 1 / rate), gyro, accel)


def integrated(seconds: float, hz: float, step: float = 1e-4) -> tuple[Array, Array]:
    """Rotation and velocity change in the first body frame by midpoint steps."""
    t = (np.arange(round(seconds / step)) + 0.5) * step
    gyro, accel = motion(t, hz)
    R, v = np.eye(3), np.zeros(3)
    for turn, push in zip(so3.exp(gyro * step / 2), accel * step, strict=True):
        middle = R @ turn
        v, R = v + middle @ push, middle @ turn
    return R, v


def compounded(imu: Imu, grid: float = 0.05) -> tuple[Array, Array]:
    """All increments in a row."""
    inc = increments(imu, grid)
    R, v = np.eye(3), np.zeros(3)
    for turn, push in zip(so3.exp(inc.rotation), inc.velocity, strict=True):
        v, R = v + R @ push, R @ turn
    return R, v


def test_coning_and_sculling_are_recovered_from_the_means() -> None:
    """8 Hz seen at 100 Hz: compounding the means alone misses fifty times more.

    The first and last two samples, which lack neighbours, are most of what is left.
    """
    imu = sampled(8.0, 100, 8.0)
    R, v = integrated(8.0, 8.0)
    found_R, found_v = compounded(imu)
    plain = np.eye(3)
    for turn in so3.exp(imu.gyro * imu.dt[:, None]):
        plain = plain @ turn
    coning = np.linalg.norm(so3.log(R.T @ plain))
    assert np.linalg.norm(so3.log(R.T @ found_R)) < 0.02 * coning
    assert np.linalg.norm(found_v - v) < 1e-3


@pytest.mark.parametrize("grid", [0.01, 0.02, 0.05, 0.1, 0.5])
def test_the_grid_does_not_matter(grid: float) -> None:
    imu = sampled(3.0, 100, 3.0)
    R, v = compounded(imu, 0.01)
    found_R, found_v = compounded(imu, grid)
    np.testing.assert_allclose(found_R, R, atol=1e-12)
    np.testing.assert_allclose(found_v, v, atol=1e-12)


def test_position_inside_an_increment_is_the_double_integral() -> None:
    imu = sampled(0.5, 100, 2.0)
    inc = increments(imu, 0.5)
    step = 1e-4
    t = (np.arange(5000) + 0.5) * step
    gyro, accel = motion(t, 2.0)
    R, v, p = np.eye(3), np.zeros(3), np.zeros(3)
    for turn, push in zip(so3.exp(gyro * step / 2), accel * step, strict=True):
        middle = R @ turn
        p = p + v * step + middle @ push * step / 2
        v, R = v + middle @ push, middle @ turn
    assert len(inc.position) == 1
    np.testing.assert_allclose(inc.position[0], p, atol=2e-5)


def test_edges_follow_the_samples_and_the_last_group_is_short() -> None:
    imu = sampled(1.07, 100, 1.0)
    inc = increments(imu, 0.05)
    np.testing.assert_allclose(inc.edge[:3], [0, 0.05, 0.1], atol=1e-12)
    np.testing.assert_allclose(inc.edge[-2:], [1.05, 1.07], atol=1e-12)
    assert len(inc.rotation) == len(inc.edge) - 1 == 22


def test_slow_imu_is_not_compounded() -> None:
    assert len(increments(sampled(5.0, 10, 1.0)).rotation) == 50


def test_a_gap_in_time_is_carried_by_its_sample() -> None:
    """A sample that covers a gap keeps its own duration; no neighbour's slope reaches over it."""
    imu = sampled(2.0, 100, 1.0)
    keep = np.r_[0:100, 130:200]
    dt = imu.dt[keep].copy()
    dt[100] = 0.31
    cut = Imu(imu.time[keep], dt, imu.gyro[keep], imu.accel[keep])
    inc = increments(cut)
    assert np.diff(inc.edge).max() == pytest.approx(0.35)
    assert np.diff(inc.edge).sum() == pytest.approx(2.0)
    assert np.isfinite(inc.rotation).all()


def test_blocks_on_several_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    dt = np.full(997, 0.01)
    dt[400] = 2.0
    imu = Imu(np.cumsum(dt), dt, rng.normal(0, 0.3, (997, 3)), rng.normal(0, 3.0, (997, 3)))
    whole = increments(imu)
    monkeypatch.setattr(module, "BLOCK", 50)
    parts = increments(imu)
    for name in ("edge", "rotation", "velocity", "position", "jump", "doubt"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
