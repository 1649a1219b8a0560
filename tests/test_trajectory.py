"""Deviations at nodes and between them: nobody knows what happened in a gap of the IMU."""

import numpy as np
import pytest

from graphnav.common.angles import angles_of_rotation, rotation_of_angles
from graphnav.result.trajectory import _astray, deviations


def test_a_gap_opens_the_deviations_as_a_tied_random_walk_would() -> None:
    """Against the conditional covariance of a Wiener velocity and its integral."""
    start, T, turn, speed = 5.0, 8.0, 0.3, 2.0
    t = np.linspace(0.0, 20.0, 401)
    inside = (t > start) & (t < start + T)
    found = _astray(t, np.array([[start, start + T, turn, speed]]))
    for deviation in found:
        assert not deviation[~inside].any() and (deviation[inside] > 0).all()

    q = speed**2 / T

    def cov(a: float, b: float) -> np.ndarray:
        """Of (v, p) at a with (v, p) at b >= a, both zero at 0."""
        return q * np.array([[a, a * b - a**2 / 2], [a**2 / 2, a**2 * b / 2 - a**3 / 6]])

    for k in np.flatnonzero(inside)[::7]:
        s = t[k] - start
        cross = cov(s, T)
        tied = cov(s, s) - cross @ np.linalg.solve(cov(T, T), cross.T)
        np.testing.assert_allclose([found[1][k], found[2][k]], np.sqrt(np.diag(tied)), rtol=1e-6)
        np.testing.assert_allclose(found[0][k], turn * np.sqrt(s / T * (1 - s / T)))


def test_without_gaps_nothing_is_added() -> None:
    assert not np.any(_astray(np.arange(10.0), None))
    assert not np.any(_astray(np.arange(10.0), np.zeros((0, 4))))


@pytest.mark.parametrize("heading", [0.0, 0.5, 2.0, 4.0])
def test_deviations_of_the_angles_are_those_of_drawn_attitudes(heading: float) -> None:
    """Roll, pitch and heading each have a deviation of their own, whatever the course."""
    rng = np.random.default_rng(4)
    sd = np.array([3e-3, 1e-3, 2e-3])  # rad, about right, forward, up
    R_nb = rotation_of_angles(0.02, 0.05, heading)[None]
    covariance = np.zeros((1, 9, 9))
    covariance[0] = np.diag([*sd**2, 1, 4, 9, 4, 25, 9])
    covariance[0, 6, 7] = covariance[0, 7, 6] = -6.0
    found = deviations(covariance, R_nb)
    small = sd * rng.normal(size=(20000, 3))
    drawn = np.stack(angles_of_rotation(R_nb @ (np.eye(3) + skews(small))), -1)
    off = np.angle(np.exp(1j * (drawn - np.stack(angles_of_rotation(R_nb), -1))))
    np.testing.assert_allclose(found.angles[0], off.std(axis=0), rtol=0.03)
    np.testing.assert_allclose(found.velocity[0], [1, 2, 3])
    np.testing.assert_allclose(found.position[0], [2, 5, 3])
    np.testing.assert_allclose(found.correlation_en, -0.6)


def skews(v: np.ndarray) -> np.ndarray:
    """Cross product matrices of (n, 3)."""
    x, y, z = v.T
    o = np.zeros(len(v))
    return np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(-1, 3, 3)
