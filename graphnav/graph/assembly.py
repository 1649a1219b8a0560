"""Blocks gathered by interval: one dense linear factor each, so that GTSAM is called once a second.

Every vehicle factor touches at most two neighbouring nodes and one calibration vector. All rows of
one interval therefore fit one `[A_i A_j A_c | b]`, filled by numpy for the whole run at once.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors import kinds, so3
from factors.block import NODE_DIM, ROTATION, Array, Block, Index
from factors.weights import Robust

NODE_I, NODE_J = slice(0, NODE_DIM), slice(NODE_DIM, 2 * NODE_DIM)
CALIBRATION = slice(2 * NODE_DIM, None)
INERTIAL = 9  # rows of the inertial factor, an interval's first


@dataclass(frozen=True)
class IntervalRows:
    """Whitened rows `A_i dx_i + A_j dx_j + A_c dc = b` of W consecutive intervals, one after the
    other; those of the inertial factor first in each.
    """

    A: Array  # (R, 10 + 10 + dim)
    b: Array  # (R,)
    start: Index  # (W + 1,) first row of each interval
    doubt: NDArray[np.int8]  # (R,) which of `robust` weighs a row, 0 for none
    inflation: Array  # (R,) sigma over the errors' spread, which is what weights see
    robust: tuple[Robust, ...] = ()  # number 1, 2 ...

    @property
    def interval(self) -> Index:
        """Of each row, (R,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def between(self, first: int, end: int) -> "IntervalRows":
        """Those of intervals `first` to `end - 1`."""
        on = slice(int(self.start[first]), int(self.start[end]))
        start = self.start[first : end + 1] - self.start[first]
        return replace(
            self, A=self.A[on], b=self.b[on], start=start, doubt=self.doubt[on],
            inflation=self.inflation[on],
        )  # fmt: skip

    def weighted(self, residual: Array) -> "IntervalRows":
        """Robust rows scaled by the root of their weight at whitened residuals (R,)."""
        root = np.ones_like(self.b)
        for k, robust in enumerate(self.robust, start=1):
            on = self.doubt == k
            root[on] = np.sqrt(robust.weight(residual[on] * self.inflation[on]))
        return replace(self, A=self.A * root[:, None], b=self.b * root)

    def surprise(self, x: Array, P: Array, c: Array) -> Array:
        """Residuals (R,) of a single interval over the sigma expected of them, with node i at `x`
        (10,) of covariance `P`, calibration at `c` (dim,) and node j where the inertial rows put
        it.
        """
        r = self.A[:, NODE_I] @ x + self.A[:, CALIBRATION] @ c - self.b
        by_noise = np.linalg.solve(
            self.A[:INERTIAL, NODE_DIM : NODE_DIM + INERTIAL].T,
            self.A[:, NODE_DIM : NODE_DIM + INERTIAL].T,
        ).T  # of every row per unit of the inertial rows
        by_x = self.A[:, NODE_I] - by_noise @ self.A[:INERTIAL, NODE_I]
        variance = (
            1 + np.einsum("ri,ij,rj->r", by_x, P, by_x) + np.einsum("ri,ri->r", by_noise, by_noise)
        )
        return np.asarray((r - by_noise @ r[:INERTIAL]) / np.sqrt(variance))

    def in_base(self, x: Array, c: Array) -> "IntervalRows":
        """Told as error states about the base, linearised at `x` (W + 1, 10) and `c` (W, dim)."""
        A, i = self.A.copy(), self.interval
        Jr = so3.right_jacobian(x[:, ROTATION])
        for node, at in ((NODE_I, i), (NODE_J, i + 1)):
            on = slice(node.start, node.start + ROTATION.stop)
            A[:, on] = np.einsum("rk,rkl->rl", A[:, on], Jr[at])
        there = np.concatenate([x[i], x[i + 1], c[i]], axis=1)
        return replace(self, A=A, b=self.b + np.einsum("rk,rk->r", A, there))

    def in_unit(self, unit_c: Array) -> "IntervalRows":
        """Calibration errors told in units (dim,)."""
        A = self.A.copy()
        A[:, CALIBRATION] *= unit_c
        return replace(self, A=A)

    def factors(self, x: Sequence[int], c: Sequence[int]) -> Iterator[gtsam.JacobianFactor]:
        """One factor per interval; keys of nodes (W + 1) and, of each interval, of the calibration
        in force (W).
        """
        first, second, third = self.A[:, NODE_I], self.A[:, NODE_J], self.A[:, CALIBRATION]
        bounds = self.start.tolist()
        for k, (lo, hi) in enumerate(pairwise(bounds)):
            parts = x[k], first[lo:hi], x[k + 1], second[lo:hi], c[k], third[lo:hi]
            yield gtsam.JacobianFactor(*parts, self.b[lo:hi], _unit(hi - lo))


def stacked(
    blocks: Sequence[Block],
    segment: Index,
    dim: int,
    robust: Mapping[str, Robust] | None = None,
    begins: bool = True,
) -> IntervalRows:
    """Rows of all blocks over nodes numbered from 0, with the calibration segment of each interval
    (W,); `dim` is the calibration vector's length.

    A row belongs to the interval that ends at its later node. Rows on node 0 alone belong to the
    first when the run `begins` here, else to the interval before and are left out; those on
    calibrations alone are left out. Kinds in `robust` keep their weight open.
    """
    on_nodes = [b for b in blocks if len(b.time) and b.terms[0].family == "x"]
    on_nodes.sort(key=lambda b: b.kind != kinds.INERTIAL)
    picks = [_owner(block, begins) for block in on_nodes]
    intervals = len(segment)
    count = np.zeros(intervals, np.int64)
    for block, (_, owner) in zip(on_nodes, picks, strict=True):
        count += np.bincount(owner, minlength=intervals) * block.residual.shape[1]
    start = np.concatenate([[0], np.cumsum(count)])
    A, b = np.zeros((start[-1], 2 * NODE_DIM + dim)), np.empty(start[-1])
    doubt, inflation = np.zeros(start[-1], np.int8), np.ones(start[-1])
    doubted: list[Robust] = []
    used = start[:-1].copy()
    for block, (on, owner) in zip(on_nodes, picks, strict=True):
        size = block.residual.shape[1]
        # several factors of one kind may share an interval: they queue up
        turn = np.arange(len(owner)) - np.searchsorted(owner, owner)
        row = (used[owner] + turn * size)[:, None] + np.arange(size)
        used += np.bincount(owner, minlength=intervals) * size
        b[row] = -block.residual[on]
        if block.robust and robust and block.kind in robust:
            doubted.append(robust[block.kind])
            doubt[row] = len(doubted)
        if block.inflation is not None:
            inflation[row] = block.inflation[on]
        _place(A, row, block, on, owner, segment)
    return IntervalRows(A, b, start, doubt, inflation, tuple(doubted))


def _place(
    A: Array, row: Index, block: Block, on: slice | Index, owner: Index, segment: Index
) -> None:
    """Write the Jacobians of factors `on` of a block into their rows (m, r) of `A`; `owner` (m,),
    the intervals they stand in, `segment` (W,) as in `stacked`.
    """
    for term in block.terms:
        if term.family == "c":
            assert np.array_equal(term.index[on], segment[owner]), (
                f"{block.kind}: a calibration segment that is not in force in its interval"
            )
            A[row, CALIBRATION] = term.jacobian[on]
        else:
            which = term.index[on] - owner
            assert np.isin(which, (0, 1)).all(), f"{block.kind}: nodes that are not neighbours"
            column = which * NODE_DIM
            A[row[:, :, None], column[:, None, None] + np.arange(NODE_DIM)] = term.jacobian[on]


@cache
def _unit(rows: int) -> gtsam.noiseModel.Unit:
    return gtsam.noiseModel.Unit.Create(rows)


def _owner(block: Block, begins: bool) -> tuple[slice | Index, Index]:
    """Which factors of a block are taken and the interval of each, in order."""
    owner = np.max([t.index for t in block.terms if t.family == "x"], axis=0) - 1
    if begins:
        return slice(None), np.maximum(owner, 0)
    on = np.flatnonzero(owner >= 0)
    return on, owner[on]
