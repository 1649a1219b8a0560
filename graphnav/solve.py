"""Gauss-Newton over all factors, iteratively reweighted, with step halving."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from factors.block import POSITION, ROTATION, Block
from factors.weights import Robust
from graphnav.elimination import Chain, eliminate, step
from graphnav.errors import SolutionError
from graphnav.estimate import Estimate, finite
from graphnav.run import Array

Linearise = Callable[[Estimate], list[Block]]

POSITION_M, ROTATION_RAD = 3e-3, 1e-5  # a step below both everywhere ends the iteration
MAX_ITERATIONS = 30


@dataclass(frozen=True)
class Solution:
    """Where the iteration ended, with the factors and the square-root system there."""

    estimate: Estimate
    blocks: list[Block]  # unweighted, at the estimate before the last step
    weights: list[Array]  # (n, r) of each block
    bayes_net: gtsam.GaussianBayesNet
    iterations: int
    cost: float  # 0.5 sum w r^2


def weights_of(block: Block, robust: Mapping[str, Robust]) -> Array:
    """Weight of every row; 1 for factors that are not robust."""
    if not block.robust or block.kind not in robust:
        return np.ones_like(block.residual)
    return robust[block.kind].weight(block.residual)


def cost_of(blocks: list[Block], weights: list[Array]) -> float:
    """Weighted cost `0.5 sum w r^2`."""
    return 0.5 * sum(
        float(np.sum(w * b.residual**2)) for b, w in zip(blocks, weights, strict=True)
    )


def gauss_newton(
    linearise: Linearise,
    estimate: Estimate,
    chain: Chain,
    robust: Mapping[str, Robust],
    max_iterations: int = MAX_ITERATIONS,
) -> Solution:
    """Iterate until nothing moves; raises SolutionError naming the factor that does not settle."""
    blocks = linearise(estimate)
    for iteration in range(1, max_iterations + 1):
        weights = [weights_of(block, robust) for block in blocks]
        cost = cost_of(blocks, weights)
        weighted = [b.weighted(w) for b, w in zip(blocks, weights, strict=True)]
        bayes_net = eliminate(weighted, chain)
        nodes, segments = step(bayes_net, chain)
        trial, trial_blocks = _descend(linearise, estimate, nodes, segments, weights, cost)
        moved = np.abs(nodes[:, POSITION]).max(), np.abs(nodes[:, ROTATION]).max()
        if moved[0] < POSITION_M and moved[1] < ROTATION_RAD:
            return Solution(trial, blocks, weights, bayes_net, iteration, cost)
        estimate, blocks = trial, trial_blocks
    raise SolutionError(
        f"no convergence in {max_iterations} iterations ({moved[0]:.3g} m still moving): "
        + worst(blocks)
    )


def _descend(
    linearise: Linearise,
    estimate: Estimate,
    nodes: Array,
    segments: Array,
    weights: list[Array],
    cost: float,
) -> tuple[Estimate, list[Block]]:
    """Take the step, or a half, quarter ... of it while the cost would grow."""
    for halving in range(6):
        share = 0.5**halving
        trial = estimate.retract(share * nodes, share * segments)
        if finite(trial):
            blocks = linearise(trial)
            if cost_of(blocks, weights) <= cost * (1 + 1e-6) + 1e-3:
                return trial, blocks
    return trial, blocks


def worst(blocks: list[Block]) -> str:
    """The factor kind, row and time of the largest whitened residual, in words."""
    peak = max(blocks, key=lambda b: float(np.abs(b.residual).max(initial=0)))
    n, row = np.unravel_index(int(np.abs(peak.residual).argmax()), peak.residual.shape)
    return f"{peak.kind} ({peak.axes[row]}) disagrees most, at {peak.time[n]:.1f} s of the run"
