"""Gauss-Newton over all factors, iteratively reweighted, with step halving."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from factors.block import Block
from factors.estimate import Estimate, finite
from factors.weights import Robust
from graphnav.common.errors import SolutionError
from graphnav.common.remark import Remark
from graphnav.common.run import Array
from graphnav.graph.contradiction import moment, worst
from graphnav.graph.elimination import (
    EliminationOrder,
    Undetermined,
    eliminate,
    linear_system,
    quickly,
    step,
)

Step = tuple[Array, Array]  # error states of nodes (N, 10) and calibration segments (K, dim)
Linearise = Callable[[Estimate], list[Block]]

ROUGH, FINE = 30.0, 1e-2  # squared length of the last step in standard deviations, all states
MAX_ITERATIONS, ROUGH_ITERATIONS = 40, 12
RESTLESS = 1.0  # sigma of the last step, all states together, within which what creeps is of use
# weights stay once a step was so short, at the latest from this iteration on: a redescending
# weight may creep for ever
HELD_BELOW, HELD_FROM = 1.0, 8


@dataclass(frozen=True)
class Solution:
    """Where the iteration ended, with the factors and the square-root system there."""

    estimate: Estimate
    blocks: list[Block]  # unweighted, at the estimate
    weights: list[Array]  # (n, r) of each block
    bayes_net: gtsam.GaussianBayesNet
    iterations: int
    cost: float  # 0.5 sum w r^2
    remarks: tuple[Remark, ...] = ()  # what keeps it from settling, where it does not


def weights_of(block: Block, robust: Mapping[str, Robust]) -> Array:
    """Weight of every row; 1 for factors that are not robust."""
    if not block.robust or block.kind not in robust:
        return np.ones_like(block.residual)
    return robust[block.kind].weight(block.standardised)


def cost_of(blocks: list[Block], weights: list[Array]) -> float:
    """Weighted cost `0.5 sum w r^2`."""
    return 0.5 * sum(float(np.sum(w * b.residual**2)) for b, w in zip(blocks, weights, strict=True))


def square_root(
    blocks: list[Block], order: EliminationOrder, robust: Mapping[str, Robust]
) -> gtsam.GaussianBayesNet:
    """The system of blocks weighted at their residuals, by QR."""
    weighted = [block.weighted(weights_of(block, robust)) for block in blocks]
    return eliminate(linear_system(weighted, order), order)


def gauss_newton(
    linearise: Linearise,
    estimate: Estimate,
    order: EliminationOrder,
    robust: Mapping[str, Robust],
    tolerance: float = FINE,
) -> Solution:
    """Iterate until the step is small against the standard deviations: `d^T H d < tolerance`.

    Raises SolutionError naming the sensor and the span that do not settle.
    """
    blocks = linearise(estimate)
    weights = [weights_of(block, robust) for block in blocks]
    held = False
    for iteration in range(1, MAX_ITERATIONS + 1):
        here = _Here(linearise, estimate, weights, cost_of(blocks, weights))
        weighted = [b.weighted(w) for b, w in zip(blocks, weights, strict=True)]
        graph = linear_system(weighted, order)
        # what a reader sees is solved by QR: the last steps of a fine solution
        quick = None if held and tolerance < ROUGH else _quick(here, graph, weighted, order)
        attempt = quick or _exact(here, graph, weighted, order)
        # an early round need not settle: the next one begins where it ends
        settled = attempt.length < tolerance and (held or tolerance >= ROUGH)
        if settled or (tolerance >= ROUGH and iteration == ROUGH_ITERATIONS):
            return Solution(*attempt.taken, weights, attempt.bayes_net, iteration, here.cost)
        estimate, blocks = attempt.taken
        held = held or attempt.length < HELD_BELOW or iteration >= HELD_FROM
        if not held:
            weights = [weights_of(block, robust) for block in blocks]
    moved, why = np.sqrt(attempt.length), worst(blocks, weights)
    if moved < RESTLESS:  # of all states together
        cost = cost_of(blocks, weights)
        remark = Remark(
            f"the solution does not settle to better than {moved:.2g} sigma: {why}", level=1
        )
        return Solution(
            estimate, blocks, weights, attempt.bayes_net, MAX_ITERATIONS, cost, (remark,)
        )
    raise SolutionError(
        f"no convergence in {MAX_ITERATIONS} iterations (last step {moved:.2g} sigma): {why}"
    )


@dataclass(frozen=True)
class _Here:
    """Where a step starts: the estimate, the weights held for the step and the cost."""

    linearise: Linearise
    estimate: Estimate
    weights: list[Array]
    cost: float

    def moved(self, delta: Step) -> tuple[Estimate, list[Block]] | None:
        """Estimate and blocks after a step; None when the cost grows."""
        trial = self.estimate.retract(*delta)
        if not finite(trial):
            return None
        blocks = self.linearise(trial)
        limit = self.cost * (1 + 1e-6) + 1e-3
        return (trial, blocks) if cost_of(blocks, self.weights) <= limit else None


@dataclass(frozen=True)
class _Attempt:
    """One step and where it leads."""

    length: float  # squared, in standard deviations: d^T H d
    taken: tuple[Estimate, list[Block]]
    bayes_net: gtsam.GaussianBayesNet


def _quick(
    here: _Here, graph: gtsam.GaussianFactorGraph, weighted: list[Block], order: EliminationOrder
) -> _Attempt | None:
    """The full step by Cholesky; None where it breaks down or the cost would grow."""
    bayes_net = quickly(graph, order)
    if bayes_net is None:
        return None
    try:
        delta = step(bayes_net, order)
    except Undetermined:
        return None
    taken = here.moved(delta)
    return _Attempt(_length(weighted, delta), taken, bayes_net) if taken else None


def _exact(
    here: _Here, graph: gtsam.GaussianFactorGraph, weighted: list[Block], order: EliminationOrder
) -> _Attempt:
    """The step by QR, or a half, quarter ... of it while the cost would grow."""
    bayes_net, delta = _solved(graph, weighted, order)
    length = _length(weighted, delta)
    for halving in range(6):
        part = (0.5**halving * delta[0], 0.5**halving * delta[1])
        taken = here.moved(part)
        if taken:
            return _Attempt(length, taken, bayes_net)
    trial = here.estimate.retract(*part)
    return _Attempt(length, (trial, here.linearise(trial)), bayes_net)


def _solved(
    graph: gtsam.GaussianFactorGraph, weighted: list[Block], order: EliminationOrder
) -> tuple[gtsam.GaussianBayesNet, Step]:
    """By QR, and the full step; SolutionError tells when what is not determined acts."""
    try:
        bayes_net = eliminate(graph, order)
        return bayes_net, step(bayes_net, order)
    except Undetermined as error:
        when = moment(weighted, error.family, error.index)
        where = "" if when is None else f" near {when:.1f} s of the run"
        raise SolutionError(
            f"the sensors leave the solution undetermined{where}: too few of them there, or their "
            "stated noise is far too large or too small; check the vehicle file, or cut the run"
        ) from None


def _length(weighted: list[Block], delta: Step) -> float:
    """Squared length of a step in standard deviations, `d^T H d`."""
    return sum(float(np.sum(block.change(*delta) ** 2)) for block in weighted)
