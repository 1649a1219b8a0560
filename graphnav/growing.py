"""A graph that grows node by node: each new interval enters iSAM2 linearised by the batch's own
factors; every few seconds the recent intervals are linearised anew with the new ones, all of them
each time the run has doubled.

So the total work is linear in the run's length, and what the batch re-estimates by iterating
(linearisation points, biases inside the preintegration, robust weights) settles within seconds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from factors import so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Block, Index
from factors.calibration import prior as calibration_prior
from factors.calibration import walk
from factors.inertial import predict
from factors.preintegration import Preintegrated
from graphnav.aiding import Aid, joined
from graphnav.assembly import Rows, stacked
from graphnav.earth import Origin
from graphnav.estimate import Estimate
from graphnav.intake import Distance, Inertial
from graphnav.isam import Tree
from graphnav.nodes import SEGMENT_S, Nodes, room_of
from graphnav.preparation import Prepared
from graphnav.problem import Problem, build
from graphnav.run import Array
from graphnav.smoother import FIRST
from graphnav.tape import Tape
from graphnav.timeline import Timeline

BACK_S = 20.0  # s of the newest nodes that are linearised anew
GROWTH, FIRST_GROWTH = 2.0, 60  # of the run's length between relinearisations of all; nodes
KEPT_S = 30.0  # s of nodes that stay in the tree, at least: BACK_S and more
UNIT = 10.0  # prior sigmas: iSAM2 then passes on changes of a hundredth of a sigma


@dataclass(frozen=True)
class Window:
    """The newest nodes as they are known now: what is linearised anew with the next ones."""

    first: int  # oldest node of them
    estimate: Estimate  # of nodes `first` to the newest and of the segments in force
    x: Array  # (W + 1, 10) their error states from the base
    c: Array  # (K, dim)


class Growing:
    """Nodes 0 to `last`, their intervals and the iSAM2 tree that holds them."""

    def __init__(
        self,
        prep: Prepared,
        inertial: Inertial,
        odometer: Distance | None,
        still: Tape,
        lag: float | None,
        every_s: float,
    ) -> None:
        """`prep` carries alignment, noise and layout; its sensors are those of each interval.

        `still` 0 or 1 by increment. With `lag` s nothing older is ever linearised again. The
        newest are every `every_s`.
        """
        self.prep, self._inertial, self._odometer = prep, inertial, odometer
        self._still, self._lag = still, lag
        self.every = max(1, round(every_s / prep.interval))  # nodes
        self._kept = round((KEPT_S + (lag or 0.0)) / room_of(prep.interval))
        self.edge, self.time = Tape(), Tape()
        self._R, self._v, self._p, self._phase = Tape(3, 3), Tape(3), Tape(3), Tape()
        self._node_tapes = (self._R, self._v, self._p, self._phase)
        self._c, self.segment_time, self.segment = Tape(prep.layout.dim), Tape(), Tape()
        self.states: list[str] = []  # of each interval
        self._aids: list[Aid] = []  # of each node
        self._swept = FIRST_GROWTH  # nodes when all were last relinearised
        self._unit = UNIT * prep.layout.prior_sd
        self._tree = Tree(self._unit)
        # error state and covariance of the newest node
        self._tip = (np.zeros(NODE_DIM), np.zeros((NODE_DIM, NODE_DIM)))
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
        return self.problem(0, self.last, at)

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

    def sensed(self, first: int, last: int) -> tuple[Prepared, Nodes]:
        """What the sensors said between two nodes."""
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
        return prep, nodes

    def problem(self, first: int, last: int, at: Estimate) -> Problem:
        """The batch's factors between two nodes, increments integrated with the biases of `at`."""
        prep, nodes = self.sensed(first, last)
        t, names = nodes.time, np.array(self.states[first:last])
        return build(prep, nodes, Timeline(t[:-1], t[1:], names, np.ones(len(names))), at, {})

    def window(self) -> Window:
        """The newest node alone, or those of the last seconds when a sweep is due."""
        n = self.last
        if n == 0 or n % self.every:
            seg = self._segments(n, n)
            x = self._tip[0][None]
            c = self._tree.segments(seg.start, seg.stop) if n else self._c.rows * 0.0
            return Window(n, self.base(n, n).retract(x, c), x, c)
        return self._since(int(np.searchsorted(self.time.rows, self.time.rows[-1] - BACK_S)))

    def _since(self, first: int) -> Window:
        """The nodes from `first` on, as far as the lag goes back."""
        if self._lag is not None:
            oldest = float(self.time.rows[-1]) - self._lag
            first = max(first, int(np.searchsorted(self.time.rows, oldest)))
        x, c = self._tree.everything() if first == 0 else self._error(first, self.last)
        return Window(first, self.base(first, self.last).retract(x, c), x, c)

    def grow(
        self, edges: Sequence[int], state: str, aids: Sequence[Aid], window: Window
    ) -> Iterator[int]:
        """Nodes at `edges`, predicted by the IMU and tied to the nodes before by every factor.

        They are linearised together, the window's along with them, and enter iSAM2 one by one:
        yields each when it has.
        """
        n, first, known = self.last, window.first, window.estimate
        before = int(self.segment.rows[-1]) if n else 0
        ties = []
        for edge, aid in zip(edges, aids, strict=True):
            ties.append(self._next_segment(known.calibration[-1:]))
            self.segment.push(len(self._c) - 1)
            self.states.append(state)
            self._place(edge, aid)
        problem = self.problem(first, self.last, self._ahead(known, n, None))
        estimate = self._ahead(known, n, problem.pre)
        rows = self._rows(problem.linearise(estimate), first)
        if first < n:
            self._exchange(window, rows.between(0, n - first))
        segment: Index = self.segment.rows[n:].astype(np.int64)
        x = np.concatenate([window.x[-1:], np.zeros((len(edges), NODE_DIM))])
        c = np.where((segment == before)[:, None], window.c[-1:], 0.0)
        rows = rows.between(n - first, self.last - first).in_base(x, c).in_unit(self._unit)
        c /= self._unit
        for k, (tie, seg) in enumerate(zip(ties, segment.tolist(), strict=True)):
            row = rows.between(k, k + 1)
            row = row.weighted(row.predicted(self._tip[0], c[k]))
            (factor,) = row.factors(*self._tree.keys(n + k, [seg]))
            self._tree.extend(factor, seg, tie, self._kept)
            self._tip = self._tree.marginal(n + k + 1)
            yield n + k + 1
        if self._lag is None and self.last >= GROWTH * self._swept:
            self.relinearise()
            self._swept = self.last

    def _ahead(self, known: Estimate, n: int, pre: Preintegrated | None) -> Estimate:
        """The estimate of the nodes up to `n` carried on by the IMU to the new ones, whose base it
        becomes. Without `pre` they are where node `n` is.
        """
        count = self.last - n
        origin = self.prep.alignment.origin
        R, v, p = known.R_nb[-1], known.v_n[-1], known.p_n[-1]
        g = origin.gravity(p)
        path = []
        for k in range(count):
            if pre is not None:
                R, v, p = predict(pre, len(pre.T) - count + k, R, v, p, g, origin.Omega_n)
            path.append((R, v, p))
        R_nb, v_n, p_n = (np.array(x) for x in zip(*path, strict=True))
        for tape, x in zip((self._R, self._v, self._p), (R_nb, v_n, p_n), strict=True):
            tape.rows[n + 1 :] = x
        more = len(self._c) - int(self.segment.rows[n - 1] if n else 0) - 1
        return Estimate(
            np.concatenate([known.R_nb, R_nb]),
            np.concatenate([known.v_n, v_n]),
            np.concatenate([known.p_n, p_n]),
            np.concatenate([known.phase, np.zeros(count)]),
            np.concatenate([known.calibration, np.repeat(known.calibration[-1:], more, 0)]),
        )

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

    def _rows(self, blocks: list[Block], first: int) -> Rows:
        dim = self.prep.layout.dim
        return stacked(blocks, self.last - first, dim, FIRST, begins=first == 0)

    def relinearise(self) -> None:
        """Linearise every interval again at the present estimate, as far as the lag goes back."""
        window = self._since(0)
        if window.first < self.last:
            problem = self.problem(window.first, self.last, window.estimate)
            rows = self._rows(problem.linearise(window.estimate), window.first)
            self._exchange(window, rows)

    def _exchange(self, window: Window, rows: Rows) -> None:
        """Put a window's rows, linearised and weighed at its estimate, in the place of the old."""
        first = window.first
        segment: Index = self.segment.rows[first : first + len(window.x) - 1].astype(np.int64)
        rows = rows.weighted(-rows.b).in_base(window.x, window.c[segment - segment[0]])
        keys = self._tree.keys(first, segment.tolist())
        factors = list(rows.in_unit(self._unit).factors(*keys))
        self._tree.exchange(first, factors, self._kept)
        self._tip = self._tree.marginal(first + len(segment))
