"""Deviations between nodes: inside a gap of the IMU nobody knows what the vehicle did."""

import numpy as np

from graphnav.result.trajectory import _astray


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
