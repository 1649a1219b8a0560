"""GTSAM's iSAM2 as an incremental linear engine: our linearisation, its Bayes tree, QR.

iSAM2 sees plain error-state vectors whose zero, the *base*, never moves, and one linear factor an
interval on `x_i, x_{i+1}, c_k`: re-linearising an interval is one exchange. Its own relinearisation
is off, so nothing is called back into Python (design facts 1, 2, 3 and 6).

An update of iSAM2 costs a little more with every variable it holds (0.1 ms per thousand), so the
tree holds the newest nodes only; those before are eliminated into a prior on the oldest it holds,
which is exact, the system being linear. Their factors are kept to solve for everything.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from scipy.linalg.lapack import dtrtri

from factors.block import NODE_DIM
from graphnav.common.run import Array

WILDFIRE = 1e-3  # change of an error state that is still passed on to older ones
MOST = 500  # nodes the tree grows by before its older ones are eliminated


class Tree:
    """iSAM2 over error states; remembers every factor and each interval's slot."""

    def __init__(self, unit_c: Array) -> None:
        """`unit_c` (dim,) the unit of each calibration error inside the tree."""
        self._unit = unit_c
        self._x, self._c = gtsam.symbol("x", 0), gtsam.symbol("c", 0)
        self._factors: list[gtsam.JacobianFactor] = []  # by interval
        self._segment: list[int] = []  # of each interval
        self._ties: list[list[gtsam.JacobianFactor]] = []  # what brings in each segment
        self._first = 0  # oldest node in the tree
        self._prior: list[gtsam.GaussianFactor] = []  # on it and on its segment
        self._tree = _empty()
        self._slot: dict[int, int] = {}  # of each interval's factor

    def keys(self, first: int, segment: list[int]) -> tuple[list[int], list[int]]:
        """Of the nodes of some intervals from node `first` on, and of the segment of each."""
        x = self._x + first
        return list(range(x, x + len(segment) + 1)), [self._c + k for k in segment]

    def extend(
        self, factor: gtsam.JacobianFactor, segment: int, tie: list[gtsam.JacobianFactor], keep: int
    ) -> None:
        """One more node with the factor that leads to it; `tie` brings in a new `segment`.

        `keep` how many of the newest nodes the tree must hold.
        """
        interval = len(self._factors)
        self._factors.append(factor)
        self._segment.append(segment)
        x = [self._x, self._x + 1] if interval == 0 else [self._x + interval + 1]
        if tie:
            self._ties.append(tie)
        slots = self._update([*tie, factor], x, [self._c + segment] if tie else [], [])
        self._slot[interval] = slots[-1]
        if interval - self._first > keep + MOST:
            self._shed(self._first, interval + 1 - keep)

    def exchange(self, first: int, factors: Sequence[gtsam.JacobianFactor], keep: int) -> None:
        """Put freshly linearised factors in the place of intervals `first`, `first + 1` ..."""
        intervals = range(first, first + len(factors))
        self._factors[first : intervals.stop] = factors
        if first < self._first:
            self._prior = []
            self._shed(0, max(len(self._factors) - keep, 0))
        else:
            old = [self._slot[k] for k in intervals]
            self._slot.update(zip(intervals, self._update(factors, [], [], old), strict=True))

    def _shed(self, first: int, oldest: int) -> None:
        """A new tree from node `oldest` on; its prior is what the intervals since `first` say."""
        if oldest > 0:
            segment = self._segment[oldest - 1]
            order = self._order(first, oldest)
            graph = self._graph(first, oldest)
            _, left = graph.eliminatePartialSequential(order, gtsam.EliminateQR)
            self._prior = [left.at(k) for k in range(left.size()) if left.at(k) is not None]
            begins, since = [segment], segment + 1
        else:
            begins, since = [], 0
        self._first, self._tree = oldest, _empty()
        intervals = range(oldest, len(self._factors))
        newer = range(since, len(self._ties))
        ties = [tie for k in newer for tie in self._ties[k]]
        x = [self._x + k for k in range(oldest, len(self._factors) + 1)]
        c = [self._c + k for k in (*begins, *newer)]
        slots = self._update([*self._prior, *ties, *self._factors[oldest:]], x, c, [])
        self._slot = dict(zip(intervals, slots[-len(intervals) :], strict=True))

    def _graph(self, first: int, end: int) -> gtsam.GaussianFactorGraph:
        """The linear system of intervals `first` to `end - 1` and of their segments."""
        graph = gtsam.GaussianFactorGraph()
        for factor in self._prior if first else []:
            graph.add(factor)
        before = self._segment[first - 1] + 1 if first else 0
        for tie in self._ties[before : self._segment[end - 1] + 1]:
            for factor in tie:
                graph.add(factor)
        for factor in self._factors[first:end]:
            graph.add(factor)
        return graph

    def _order(self, first: int, end: int) -> gtsam.Ordering:
        """Nodes `first` to `end - 1` in time order, each segment but the last after its nodes."""
        order = gtsam.Ordering()
        segment = self._segment[first - 1] if first else 0
        for k in range(first, end):
            for c in range(segment, self._segment[k]):
                order.push_back(self._c + c)
            segment = self._segment[k]
            order.push_back(self._x + k)
        return order

    def _update(
        self, factors: Sequence[gtsam.GaussianFactor], x: list[int], c: list[int], old: list[int]
    ) -> list[int]:
        values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
        for key in x:
            values.insert(key, np.zeros(NODE_DIM))
        for key in c:
            values.insert(key, np.zeros(len(self._unit)))
        for factor in factors:
            graph.add(gtsam.LinearContainerFactor(factor))
        return list(self._tree.update(graph, values, old).getNewFactorsIndices())

    def nodes(self, first: int, end: int) -> Array:
        """Error states of nodes `first` to `end - 1`, (n, 10), of those the tree holds."""
        keys = range(self._x + first, self._x + end)
        return np.array([self._tree.calculateEstimateVector(key) for key in keys])

    def segments(self, first: int, end: int) -> Array:
        """Error states of calibration segments, (n, dim), of those the tree holds."""
        keys = range(self._c + first, self._c + end)
        return np.array([self._tree.calculateEstimateVector(key) for key in keys]) * self._unit

    def everything(self) -> tuple[Array, Array]:
        """Error states of all nodes (N, 10) and segments (K, dim)."""
        end = len(self._factors)
        order = self._order(0, end)
        order.push_back(self._c + self._segment[-1])
        order.push_back(self._x + end)
        net = self._graph(0, end).eliminateSequential(order, gtsam.EliminateQR)
        flat = net.optimize().vector()  # in the order of the keys: 'c' before 'x'
        split = len(self._ties) * len(self._unit)
        return flat[split:].reshape(-1, NODE_DIM), flat[:split].reshape(
            len(self._ties), -1
        ) * self._unit

    def marginal(self, node: int) -> tuple[Array, Array]:
        """Error state of a node (10,) and its marginal covariance (10, 10).

        For the newest, at the root, nothing is asked of the rest of the tree.
        """
        # by QR: the default asks Cholesky, which navigation-grade weights break
        found = self._tree.marginalFactor(self._x + node, gtsam.EliminateQR)
        inverse = dtrtri(found.R())[0]
        return inverse @ found.d(), inverse @ inverse.T


def _empty() -> gtsam.ISAM2:
    params = gtsam.ISAM2Params()
    params.setFactorization("QR")
    params.enableRelinearization = False
    params.relinearizeSkip = 2**30
    params.setOptimizationParams(gtsam.ISAM2GaussNewtonParams(WILDFIRE))
    return gtsam.ISAM2(params)
