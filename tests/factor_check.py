"""Shared by the factor tests: random states and numerical Jacobians of whole blocks."""

from collections.abc import Callable

import numpy as np

from factors import so3
from factors.block import NODE_DIM, Block
from factors.estimate import Estimate

Function = Callable[[Estimate], Block]


def random_estimate(rng: np.random.Generator, nodes: int, segments: int, dim: int) -> Estimate:
    """States a land vehicle could have, with calibrations of order 0.1."""
    return Estimate(
        R_nb=so3.exp(rng.normal(size=(nodes, 3))),
        v_n=10 * rng.normal(size=(nodes, 3)),
        p_n=np.cumsum(10 * rng.normal(size=(nodes, 3)), 0),
        phase=0.01 * rng.normal(size=nodes),
        calibration=0.1 * rng.normal(size=(segments, dim)),
    )


def dense_jacobian(block: Block, estimate: Estimate) -> np.ndarray:
    """The block's Jacobian with every state of the estimate, (n r, N 10 + K dim)."""
    n, r = block.residual.shape
    N, (K, dim) = len(estimate.R_nb), estimate.calibration.shape
    J = np.zeros((n, r, N * NODE_DIM + K * dim))
    for term in block.terms:
        width, base = (NODE_DIM, 0) if term.family == "x" else (dim, N * NODE_DIM)
        for k, index in enumerate(term.index):
            at = base + index * width
            J[k, :, at : at + width] += term.jacobian[k]
    return J.reshape(n * r, -1)


def numerical_jacobian(function: Function, estimate: Estimate, step: float) -> np.ndarray:
    """Central differences of the block's residual over every error state."""
    N, (K, dim) = len(estimate.R_nb), estimate.calibration.shape
    columns = []
    for k in range(N * NODE_DIM + K * dim):
        delta = np.zeros(N * NODE_DIM + K * dim)
        delta[k] = step
        nodes, segments = delta[: N * NODE_DIM].reshape(N, -1), delta[N * NODE_DIM :].reshape(K, -1)
        ahead = function(estimate.retract(nodes, segments)).residual
        behind = function(estimate.retract(-nodes, -segments)).residual
        columns.append((ahead - behind).ravel() / (2 * step))
    return np.stack(columns, -1)


def assert_jacobian(function: Function, estimate: Estimate, rtol: float = 1e-6) -> None:
    """The block's Jacobian equals the numerical one, relative to each row's largest entry."""
    numerical = numerical_jacobian(function, estimate, 1e-5)
    analytic = dense_jacobian(function(estimate), estimate)
    size = np.abs(numerical).max(1, keepdims=True) + 1e-12
    np.testing.assert_allclose(analytic / size, numerical / size, atol=rtol, rtol=0)
