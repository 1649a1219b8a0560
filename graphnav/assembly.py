"""Blocks stacked by interval: one dense factor each, so that GTSAM is called once a second.

Every vehicle factor touches at most two neighbouring nodes and one calibration vector. All rows of
one interval therefore fit one `[A_i A_j A_c | b]`, filled by numpy for the whole run at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from factors.block import NODE_DIM, Array, Block, Index


@dataclass(frozen=True)
class Keys:
    """GTSAM keys of nodes and calibration segments, and the segment of each interval."""

    x: list[int]
    c: list[int]
    segment: Index  # (N - 1,)


def gaussian_graph(blocks: Sequence[Block], keys: Keys, dim: int) -> gtsam.GaussianFactorGraph:
    """The linear system of all blocks; `dim` is the calibration vector's length."""
    graph = gtsam.GaussianFactorGraph()
    on_nodes = [b for b in blocks if len(b.time) and b.terms[0].family == "x"]
    for block in blocks:
        if len(block.time) and block.terms[0].family == "c":
            for factor in block.jacobian_factors():
                graph.add(factor)
    if on_nodes:
        _add_intervals(graph, on_nodes, keys, dim)
    return graph


def _add_intervals(
    graph: gtsam.GaussianFactorGraph, blocks: Sequence[Block], keys: Keys, dim: int
) -> None:
    """One factor an interval; a factor on the last node alone joins the last interval."""
    A, b, start = _stacked(blocks, len(keys.x) - 1, dim)
    rows = np.unique(np.diff(start))
    models = {int(r): gtsam.noiseModel.Unit.Create(int(r)) for r in rows}
    first, second, third = A[:, :NODE_DIM], A[:, NODE_DIM : 2 * NODE_DIM], A[:, 2 * NODE_DIM :]
    bounds = start.tolist()
    for i, c in enumerate(keys.segment.tolist()):
        lo, hi = bounds[i], bounds[i + 1]
        if hi > lo:
            x_i, x_j, model = keys.x[i], keys.x[i + 1], models[hi - lo]
            parts = x_i, first[lo:hi], x_j, second[lo:hi], keys.c[c], third[lo:hi]
            graph.add(gtsam.JacobianFactor(*parts, b[lo:hi], model))


def _stacked(blocks: Sequence[Block], intervals: int, dim: int) -> tuple[Array, Array, Index]:
    """Rows of all blocks in order of interval: `[A_i A_j A_c]`, b, and where each one begins."""
    home = [np.minimum(_first_node(b), intervals - 1) for b in blocks]
    rows = [b.residual.shape[1] for b in blocks]
    count = np.zeros(intervals, np.int64)
    for at, r in zip(home, rows, strict=True):
        np.add.at(count, at, r)
    start = np.concatenate([[0], np.cumsum(count)])
    A = np.zeros((start[-1], 2 * NODE_DIM + dim))
    b = np.empty(start[-1])
    used = start[:-1].copy()
    for block, at, r in zip(blocks, home, rows, strict=True):
        n = len(at)
        # several factors of one kind may share an interval (the last one): they queue up
        order = (
            np.arange(n) - np.searchsorted(at, at)
            if np.any(np.diff(at) == 0)
            else np.zeros(n, np.int64)
        )
        row = used[at][:, None] + order[:, None] * r + np.arange(r)
        np.add.at(used, at, r)
        b[row] = -block.residual
        for term in block.terms:
            if term.family == "c":
                A[row, 2 * NODE_DIM :] = term.jacobian
            else:
                column = (term.index - at) * NODE_DIM
                A[row[:, :, None], column[:, None, None] + np.arange(NODE_DIM)] = term.jacobian
    return A, b, start


def _first_node(block: Block) -> Index:
    return np.asarray(np.min([t.index for t in block.terms if t.family == "x"], axis=0))
