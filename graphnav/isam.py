"""GTSAM's iSAM2 as an incremental linear engine: our linearisation, its Bayes tree, QR.

All rows that act between nodes i and i + 1 (and at node i + 1) are one linear factor on
`x_i, x_{i+1}, c_k`, so an interval has one slot in the tree and re-linearising it is one exchange.
iSAM2 sees plain error-state vectors whose zero, the *base*, never moves; a factor linearised at
another point is told in the base's coordinates. Its own relinearisation is off: nothing is called
back into Python (design facts 1, 2, 3 and 6).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg.lapack import dtrtri

from factors import so3
from factors.block import NODE_DIM, ROTATION, Block, Index
from factors.weights import Robust
from graphnav.run import Array

WILDFIRE = 1e-3  # change of an error state that is still passed on to older ones


@dataclass(frozen=True)
class Rows:
    """Whitened rows `A_i dx_i + A_j dx_j + A_c dc = b` of W consecutive intervals."""

    A_i: Array  # (W, r, 10)
    A_j: Array  # (W, r, 10)
    A_c: Array  # (W, r, dim)
    b: Array  # (W, r)
    robust: tuple[tuple[slice, Robust], ...] = ()  # rows that may be down-weighted, and how

    def at(self, intervals: slice) -> "Rows":
        """Some of the intervals."""
        parts = (self.A_i, self.A_j, self.A_c, self.b)
        return Rows(*(x[intervals] for x in parts), robust=self.robust)

    def weighted(self, residual: Array) -> "Rows":
        """Robust rows scaled by the root of their weight at whitened residuals (W, r)."""
        root = np.ones_like(self.b)
        for on, robust in self.robust:
            root[:, on] = np.sqrt(robust.weight(residual[:, on]))
        A_i, A_j, A_c = (A * root[:, :, None] for A in (self.A_i, self.A_j, self.A_c))
        return Rows(A_i, A_j, A_c, self.b * root, self.robust)

    def predicted(self, x: Array, c: Array) -> Array:
        """Residuals of one interval (1, r) with node i at `x` (10,), calibration at `c` (dim,) and
        node j where the inertial rows, the first nine, put it.
        """
        r = self.A_i[0] @ x + self.A_c[0] @ c - self.b[0]
        ahead = np.linalg.solve(self.A_j[0, :9, :9], -r[:9])
        return np.asarray(r + self.A_j[0, :, :9] @ ahead)[None]

    def in_base(self, x: Array, c: Array) -> "Rows":
        """Told as error states about the base, linearised at `x` (W + 1, 10) and `c` (W, dim)."""
        Jr = so3.right_jacobian(x[:, ROTATION])
        A_i, A_j = self.A_i.copy(), self.A_j.copy()
        A_i[:, :, ROTATION] = A_i[:, :, ROTATION] @ Jr[:-1]
        A_j[:, :, ROTATION] = A_j[:, :, ROTATION] @ Jr[1:]
        b = self.b + so3.mv(A_i, x[:-1]) + so3.mv(A_j, x[1:]) + so3.mv(self.A_c, c)
        return Rows(A_i, A_j, self.A_c, b, self.robust)

    def factors(self, first: int, segment: Index, unit_c: Array) -> list[gtsam.JacobianFactor]:
        """One factor per interval; the first starts at node `first`, `segment` (W,).

        `unit_c` (dim,) what 1 is in the tree's calibration errors.
        """
        said = (self.A_i != 0).any(2) | (self.A_j != 0).any(2)
        node, unit = gtsam.symbol("x", first), gtsam.noiseModel.Unit.Create
        in_unit, out = self.A_c * unit_c, []
        for k, (keep, c) in enumerate(zip(said, segment, strict=True)):
            A_i, A_j, A_c, b = self.A_i[k][keep], self.A_j[k][keep], in_unit[k][keep], self.b[k][keep]
            key = gtsam.symbol("c", int(c))
            i = node + k
            out.append(gtsam.JacobianFactor(i, A_i, i + 1, A_j, key, A_c, b, unit(len(b))))
        return out


def stacked(
    blocks: Iterable[Block],
    intervals: int,
    dim: int,
    begins: bool,
    robust: Mapping[str, Robust],
) -> Rows:
    """Rows of all blocks over a window of nodes numbered from 0, gathered by interval.

    A row belongs to the interval that ends at its later node. Rows on node 0 alone belong to the
    interval before the window and are left out, or to the first when the run `begins` here; those
    on calibrations alone are left out. The inertial rows come first.
    """
    parts: list[tuple[Array, Array, Array, Array]] = []
    doubted, filled = [], 0
    for block in sorted(blocks, key=lambda b: b.kind != "inertial"):
        nodes = [term.index for term in block.terms if term.family == "x"]
        if not nodes or not len(block.time):
            continue
        owner = np.max(nodes, axis=0) - 1
        sets = _spread(block, owner, np.flatnonzero(owner >= 0), intervals, dim)
        if begins:
            sets += _spread(block, owner * 0, np.flatnonzero(owner < 0), intervals, dim)
        rows = len(sets) * block.residual.shape[1]
        if block.robust and block.kind in robust:
            doubted.append((slice(filled, filled + rows), robust[block.kind]))
        parts, filled = parts + sets, filled + rows
    join = [np.concatenate(column, axis=1) for column in zip(*parts, strict=True)]
    return Rows(*join, robust=tuple(doubted))


def _spread(
    block: Block, owner: Index, on: Index, intervals: int, dim: int
) -> list[tuple[Array, Array, Array, Array]]:
    """Some factors of a block at their intervals; several sets where an interval has several."""
    rows, out = block.residual.shape[1], []
    while len(on):
        took, first = np.unique(owner[on], return_index=True)
        now = on[first]
        A = [np.zeros((intervals, rows, d)) for d in (NODE_DIM, NODE_DIM, dim)]
        b = np.zeros((intervals, rows))
        b[took] = -block.residual[now]
        for term in block.terms:
            side = 2 if term.family == "c" else int(term.index[now[0]] - took[0])
            A[side][took] += term.jacobian[now]
        out.append((A[0], A[1], A[2], b))
        on = np.delete(on, first)
    return out


class Tree:
    """iSAM2 over error states; remembers each interval's slot."""

    def __init__(self, unit_c: Array) -> None:
        """`unit_c` (dim,) the unit of each calibration error inside the tree."""
        params = gtsam.ISAM2Params()
        params.setFactorization("QR")
        params.enableRelinearization = False
        params.relinearizeSkip = 2**30
        params.setOptimizationParams(gtsam.ISAM2GaussNewtonParams(WILDFIRE))
        self._tree = gtsam.ISAM2(params)
        self._unit = unit_c
        self._slot: dict[int, int] = {}  # of each interval's factor

    def extend(
        self,
        interval: int,
        factor: gtsam.JacobianFactor,
        segment: int,
        tie: Sequence[gtsam.JacobianFactor],
    ) -> None:
        """Node `interval + 1` with the factor that leads to it; `tie` brings in a new `segment`."""
        values = gtsam.Values()
        for node in ([0, 1] if interval == 0 else [interval + 1]):
            values.insert(gtsam.symbol("x", node), np.zeros(NODE_DIM))
        if tie:
            values.insert(gtsam.symbol("c", segment), np.zeros(len(self._unit)))
        self._slot[interval] = self._update([*tie, factor], values, [])[-1]

    def exchange(self, first: int, factors: Sequence[gtsam.JacobianFactor]) -> None:
        """Put freshly linearised factors in the place of intervals `first`, `first + 1` ..."""
        intervals = range(first, first + len(factors))
        old = [self._slot[k] for k in intervals]
        self._slot.update(zip(intervals, self._update(factors, gtsam.Values(), old), strict=True))

    def _update(
        self, factors: Sequence[gtsam.JacobianFactor], values: gtsam.Values, old: list[int]
    ) -> list[int]:
        graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            graph.add(gtsam.LinearContainerFactor(factor))
        return list(self._tree.update(graph, values, old).getNewFactorsIndices())

    def nodes(self, first: int, end: int) -> Array:
        """Error states of nodes `first` to `end - 1`, (n, 10)."""
        key = gtsam.symbol("x", 0)
        return np.array([self._tree.calculateEstimateVector(key + i) for i in range(first, end)])

    def segments(self, first: int, end: int) -> Array:
        """Error states of calibration segments, (n, dim)."""
        key = gtsam.symbol("c", 0)
        found = [self._tree.calculateEstimateVector(key + k) for k in range(first, end)]
        return np.array(found) * self._unit

    def everything(self) -> tuple[Array, Array]:
        """Error states of all nodes (N, 10) and segments (K, dim), solved to the end."""
        values = self._tree.calculateBestEstimate()
        extract = gtsam.utilities.extractVectors
        return np.asarray(extract(values, "x")), np.asarray(extract(values, "c")) * self._unit

    def newest(self, node: int) -> tuple[Array, Array]:
        """Error state of a node at the root (10,) and its marginal covariance (10, 10).

        Asks nothing of the rest of the tree, so its cost does not grow.
        """
        return self._marginal(gtsam.symbol("x", node))

    def newest_segment(self, segment: int) -> Array:
        """Error state of the calibration segment in force, (dim,)."""
        return self._marginal(gtsam.symbol("c", segment))[0] * self._unit

    def _marginal(self, key: int) -> tuple[Array, Array]:
        # by QR: the default asks Cholesky, which navigation-grade weights break
        found = self._tree.marginalFactor(key, gtsam.EliminateQR)
        inverse = dtrtri(found.R())[0]
        return inverse @ found.d(), inverse @ inverse.T
