"""A graph that grows node by node: each new interval enters iSAM2 linearised by the batch's own
factors, recent intervals are linearised anew every few seconds, all of them each time the run has
doubled.

So the total work is linear in the run's length, and what the batch re-estimates by iterating
(linearisation points, biases inside the preintegration, robust weights) settles within seconds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import gtsam
import numpy as np

from factors import so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Block, Index
from factors.calibration import prior as calibration_prior
from factors.calibration import walk
from factors.inertial import predict
from factors.preintegration import Preintegrated
from graphnav.aiding import Aid, joined
from graphnav.earth import Origin
from graphnav.estimate import Estimate
from graphnav.intake import Distance, Inertial
from graphnav.interval_rows import Rows, stacked
from graphnav.isam import Tree
from graphnav.nodes import CLOSEST_S, SEGMENT_S, Nodes
from graphnav.preparation import Prepared
from graphnav.problem import Problem, build
from graphnav.run import Array
from graphnav.smoother import FIRST
from graphnav.tape import Tape
from graphnav.timeline import Timeline

SWEEP_EVERY, SWEEP_BACK = 10, 20  # nodes: how often, and how many of the newest, are relinearised
GROWTH = 2.0  # of the run's length between relinearisations of all of it
KEPT = 6 * SWEEP_BACK  # nodes that stay in the tree, at least
UNIT = 10.0  # prior sigmas: iSAM2 then passes on changes of a hundredth of a sigma


class Growing:
    """Nodes 0 to `last`, their intervals and the iSAM2 tree that holds them."""

    def __init__(
        self,
        prep: Prepared,
        inertial: Inertial,
        odometer: Distance | None,
        still: Tape,
        lag: float | None,
    ) -> None:
        """`prep` carries alignment, noise and layout; its sensors are those of each interval.

        `still` 0 or 1 by increment. With `lag` s nothing older is ever linearised again.
        """
        self.prep, self._inertial, self._odometer = prep, inertial, odometer
        self._still, self._lag = still, lag
        self._kept = KEPT + round((lag or 0.0) / CLOSEST_S)
        self.edge, self.time = Tape(), Tape()
        self._R, self._v, self._p, self._phase = Tape(3, 3), Tape(3), Tape(3), Tape()
        self._node_tapes = (self._R, self._v, self._p, self._phase)
        self._c, self.segment_time, self.segment = Tape(prep.layout.dim), Tape(), Tape()
        self.states: list[str] = []  # of each interval
        self._aids: list[Aid] = []  # of each node
        self._swept = 3 * SWEEP_BACK  # nodes when all were last relinearised
        self._unit = UNIT * prep.layout.prior_sd
        self._tree = Tree(self._unit)
        dim = prep.layout.dim
        # error state and covariance of the newest node, error state of its segment
        self._tip = (np.zeros(NODE_DIM), np.zeros((NODE_DIM, NODE_DIM)), np.zeros(dim))
        self._begin()

    @property
    def last(self) -> int:
        """Number of the newest node."""
        return len(self.time) - 1

    def _begin(self) -> None:
        """Node 0 as aligned."""
        known = self.prep.alignment.start
        c = self.prep.layout.prior.copy()
        c[:3] = self.prep.alignment.gyro_bias
        self._place(0, Aid())
        self._R.rows[0], self._v.rows[0], self._p.rows[0] = known.R_nb, known.v_n, known.p_n
        self._c.push(c)
        self.segment_time.push(float(self.time.rows[0]) + 0.5 * SEGMENT_S)

    def _place(self, edge: int, aid: Aid) -> None:
        """A node at an edge; its state is filled in later."""
        self.edge.push(edge)
        self.time.push(self._inertial.edge.rows[edge])
        for tape in self._node_tapes:
            tape.push(0.0)
        self._aids.append(aid)

    def base(self, first: int, last: int) -> Estimate:
        """Where the error states of nodes `first` to `last` are zero."""
        on, seg = slice(first, last + 1), self._segments(first, last)
        R, v, p, phase = (x.rows[on] for x in self._node_tapes)
        return Estimate(R, v, p, phase, self._c.rows[seg])

    def _segments(self, first: int, last: int) -> slice:
        """Segments in force from node `first` to node `last`, or before a single node."""
        if not len(self.segment):
            return slice(0, 1)
        s = self.segment.rows
        start = first if first < last else max(first - 1, 0)
        return slice(int(s[start]), int(s[max(last - 1, 0)]) + 1)

    def at(self, first: int, last: int) -> Estimate:
        """The estimate of nodes `first` to `last` and of the segments between them."""
        return self.base(first, last).retract(*self._error(first, last))

    def _error(self, first: int, last: int) -> tuple[Array, Array]:
        seg = self._segments(first, last)
        if not len(self.segment):
            return np.zeros((1, NODE_DIM)), np.zeros((1, self.prep.layout.dim))
        return self._tree.nodes(first, last + 1), self._tree.segments(seg.start, seg.stop)

    def everything(self) -> Estimate:
        """The estimate of all nodes and segments."""
        return self.base(0, self.last).retract(*self._tree.everything())

    def whole(self, at: Estimate) -> Problem:
        """The batch's problem over all nodes."""
        return self.problem(0, self.last, at)[0]

    @property
    def origin(self) -> Origin:
        """The frame n."""
        return self.prep.alignment.origin

    def newest(self, i: int) -> tuple[Array, Array, Array, Array]:
        """Attitude, velocity, position and covariance (9, 9) of the node that entered last."""
        return self._told(i, self._tip[0], self._tip[1])

    def past(self, i: int) -> tuple[Array, Array, Array, Array]:
        """The same of an older node, as it is known now."""
        return self._told(i, *self._tree.marginal(i))

    def _told(self, i: int, x: Array, P: Array) -> tuple[Array, Array, Array, Array]:
        R = self._R.rows[i] @ so3.exp(x[ROTATION])
        return R, self._v.rows[i] + x[VELOCITY], self._p.rows[i] + x[POSITION], P[:9, :9]

    def nodes(self, first: int, last: int) -> Nodes:
        """Nodes `first` to `last`, segments numbered from the first of them."""
        edge = self.edge.rows[first : last + 1].astype(np.int64)
        segment = self.segment.rows[first:last].astype(np.int64)
        seg = slice(int(segment[0]), int(segment[-1]) + 1)
        own = segment - segment[0]
        return Nodes(
            edge - edge[0], self.time.rows[first : last + 1], own, self.segment_time.rows[seg]
        )

    def problem(self, first: int, last: int, at: Estimate) -> tuple[Problem, Prepared]:
        """The batch's factors between two nodes, increments integrated with the biases of `at`."""
        nodes = self.nodes(first, last)
        a, b = int(self.edge.rows[first]), int(self.edge.rows[last])
        t = nodes.time
        near = self._odometer and self._odometer.around(float(t[0]), float(t[-1]))
        gnss, fixes_n, heading = joined(self._aids[first + 1 if first else 0 : last + 1])
        prep = replace(
            self.prep,
            run=replace(self.prep.run, odometer=near or None, gnss=gnss, heading=heading),
            inc=self._inertial.between(a, b),
            still=self._still.rows[a:b] > 0,
            gnss=gnss,
            fixes_n=fixes_n,
        )
        names = np.array(self.states[first:last])
        line = Timeline(t[:-1], t[1:], names, np.ones(len(names)))
        return build(prep, nodes, line, at, {}), prep

    def grow(self, edges: Sequence[int], state: str, aids: Sequence[Aid]) -> Iterator[int]:
        """Nodes at `edges`, predicted by the IMU and tied to the nodes before by every factor.

        They are linearised together and enter iSAM2 one by one: yields each when it has.
        """
        first, count = self.last, len(edges)
        x_now, c_now = self._tip[0][None], self._tip[2][None]
        now = self.base(first, first).retract(x_now, c_now)
        before = int(self.segment.rows[-1]) if first else -1
        ties = []
        for edge, aid in zip(edges, aids, strict=True):
            ties.append(self._next_segment(now.calibration))
            self.segment.push(len(self._c) - 1)
            self.states.append(state)
            self._place(edge, aid)
        problem, _ = self.problem(first, self.last, self._predicted(first, now, None))
        estimate = self._predicted(first, now, problem.pre)
        segment = self.segment.rows[first:].astype(np.int64)
        x = np.concatenate([x_now, np.zeros((count, NODE_DIM))])
        c = np.where((segment == before)[:, None], c_now, 0.0)
        rows = self._rows(problem.linearise(estimate), first, count).in_base(x, c)
        for k, tie in enumerate(ties):
            i, seg = first + k, int(segment[k])
            row = rows.at(slice(k, k + 1))
            if i:
                x[k], c_i = self._tip[0], self._tip[2]
                c[k] = c_i + self._c.rows[seg - bool(tie)] - self._c.rows[seg]
            row = row.weighted(row.predicted(x[k], c[k]))
            factor = row.factors(i, segment[k : k + 1], self._unit)[0]
            self._tree.extend(factor, seg, tie, self._kept)
            self._tip = (*self._tree.marginal(i + 1), self._tree.segment(seg))
            yield i + 1
        self._sweep()

    def _predicted(self, first: int, now: Estimate, pre: Preintegrated | None = None) -> Estimate:
        """The estimate of node `first` carried on by the IMU, which becomes the new nodes' base."""
        seg = self._segments(first, self.last)
        origin = self.prep.alignment.origin
        R, v, p = now.R_nb[0], now.v_n[0], now.p_n[0]
        g = origin.gravity(p)
        path = [(R, v, p)]
        for k in range(self.last - first):
            if pre is not None:
                R, v, p = predict(pre, k, R, v, p, g, origin.Omega_n)
            path.append((R, v, p))
        R_nb, v_n, p_n = (np.array(x) for x in zip(*path, strict=True))
        for tape, x in zip((self._R, self._v, self._p), (R_nb, v_n, p_n), strict=True):
            tape.rows[first + 1 :] = x[1:]
        calibration = np.repeat(now.calibration, seg.stop - seg.start, 0)
        phase = np.append(now.phase, np.zeros(len(path) - 1))
        return Estimate(R_nb, v_n, p_n, phase, calibration)

    def _next_segment(self, c: Array) -> list[gtsam.JacobianFactor]:
        """When node `last` is past the end of its segment: a new one and what ties it."""
        if not len(self.segment):
            return self._tied(calibration_prior(self.prep.layout, c), 0)
        k, start = len(self._c), float(self.time.rows[0])
        number = (float(self.time.rows[-1]) - start + 1e-6) // SEGMENT_S
        middle = start + (number + 0.5) * SEGMENT_S
        if middle < self.segment_time.rows[-1] + 1e-6:
            return []
        self._c.append(c)
        self.segment_time.push(middle)
        (step,) = walk(self.prep.layout, self._c.rows[-2:], self.segment_time.rows[-2:], ())
        return self._tied(step, k - 1)

    def _tied(self, block: Block, first: int) -> list[gtsam.JacobianFactor]:
        """A block on calibrations, its segments numbered from `first`, in the tree's unit."""
        terms = [
            replace(t, index=t.index + first, jacobian=t.jacobian * self._unit) for t in block.terms
        ]
        return list(replace(block, terms=tuple(terms)).jacobian_factors())

    def _rows(self, blocks: list[Block], first: int, intervals: int) -> Rows:
        return stacked(blocks, intervals, self.prep.layout.dim, first == 0, FIRST)

    def _sweep(self) -> None:
        """Linearise again what the newest data have moved."""
        n = self.last
        if self._lag is None and n >= GROWTH * self._swept:
            self.relinearise(0)
            self._swept = n
        elif n % SWEEP_EVERY == 0:
            self.relinearise(max(0, n - SWEEP_BACK))

    def relinearise(self, first: int) -> None:
        """Linearise every interval from node `first` on at the present estimate."""
        last = self.last
        if self._lag is not None:
            oldest = float(self.time.rows[-1]) - self._lag
            first = max(first, int(np.searchsorted(self.time.rows, oldest)))
        if first >= last:
            return
        seg = self._segments(first, last)
        x, c = self._tree.everything() if first == 0 else self._error(first, last)
        estimate = self.base(first, last).retract(x, c)
        problem, _ = self.problem(first, last, estimate)
        rows = self._rows(problem.linearise(estimate), first, last - first)
        rows = rows.weighted(-rows.b)
        segment: Index = self.segment.rows[first:last].astype(np.int64)
        own = c[segment - seg.start]
        factors = rows.in_base(x, own).factors(first, segment, self._unit)
        self._tree.exchange(first, factors, self._kept)
        self._tip = (*self._tree.marginal(last), self._tree.segment(int(segment[-1])))
