"""What noise is found from: how long residuals last, how much of its noise a fit leaves them."""

import numpy as np
import pytest

from factors import kinds
from factors.block import NODE_DIM, Block, Term
from graphnav.graph.noise import _redundancy, correlation

STEPS = 20000


def test_white_noise_has_no_memory() -> None:
    white = np.random.default_rng(0).normal(size=STEPS)
    assert correlation(white, 20) == pytest.approx(1.0, abs=0.15)


def test_noise_that_lasts_counts_with_its_long_run_variance() -> None:
    """A first-order process: (1 + a) / (1 - a) times its variance, less what the window cuts."""
    rng, last, lags = np.random.default_rng(2), 0.8, 40
    lasting = np.zeros(STEPS)
    for k in range(1, STEPS):
        lasting[k] = last * lasting[k - 1] + rng.normal()
    taper = 1 - np.arange(1, lags + 1) / (lags + 1)
    expected = 1 + 2 * np.sum(taper * last ** np.arange(1, lags + 1))
    assert correlation(lasting, lags) == pytest.approx(expected, rel=0.1)


def test_redundancy_is_what_the_fit_leaves_of_a_residuals_own_noise() -> None:
    """Against the residuals of a least-squares fit: two nodes seen, one tie between them."""
    A = np.array([[1.0, 0.0], [0.0, 1.0], [-2.0, 2.0]])
    hat = A @ np.linalg.solve(A.T @ A, A.T)
    J_i, J_j = np.zeros((1, 1, NODE_DIM)), np.zeros((1, 1, NODE_DIM))
    J_i[0, 0, 0], J_j[0, 0, 0] = -2.0, 2.0
    joint = np.zeros((2 * NODE_DIM, 2 * NODE_DIM))
    first = [0, NODE_DIM]
    joint[np.ix_(first, first)] = np.linalg.inv(A.T @ A)
    node, one = np.array([4]), np.ones((1, 1))
    terms = (Term("x", node, J_i), Term("x", node + 1, J_j))
    block = Block(kinds.VELOCITY, ("forward",), np.ones(1), one, terms)
    np.testing.assert_allclose(_redundancy(block, {4: joint}), [[1 - hat[2, 2]]])
    assert np.isnan(_redundancy(block, {3: joint})).all()  # of no other interval is it known
