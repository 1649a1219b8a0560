"""A graph that grows node by node: each new interval enters iSAM2 linearised by the batch's own
factors; every few seconds the recent intervals are linearised anew with the new ones, all of them
each time the run has doubled.

So the total work is linear in the run's length, and what the batch re-estimates by iterating
(linearisation points, biases inside the preintegration, robust weights) settles within seconds; the
noise, which the batch finds in the residuals of each round, is found at each doubling.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from factors import kinds, so3
from factors.block import MOTION, NODE_DIM, POSITION, ROTATION, VELOCITY, Block
from factors.calibration import GYRO_BIAS, walk
from factors.calibration import prior as calibration_prior
from factors.estimate import Estimate
from factors.inertial import predict
from factors.preintegration import Preintegrated
from graphnav.common.earth import Origin
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array
from graphnav.graph.assembly import IntervalRows, stacked
from graphnav.graph.common_error import ASSUMED
from graphnav.graph.elimination import covariances
from graphnav.graph.nodes import room_of
from graphnav.graph.noise import rescaled
from graphnav.graph.problem import Problem
from graphnav.graph.robust_schedule import FIRST
from graphnav.graph.satellite_fixes import NODE_SLACK_S
from graphnav.graph.solve import square_root
from graphnav.stream.isam import Tree
from graphnav.stream.node_log import NodeLog

BACK_S = 20.0  # s of the newest nodes that are linearised anew
LAST_SWEEPS = 3  # linearisations of the whole run at its end
GROWTH, FIRST_GROWTH = 2.0, 60  # of the run's length between relinearisations of all; nodes
LONGEST_BACK_S = 28.0  # where fixes come late
LATE_EVERY_S = 3.0  # between looks back then
KEPT_S = 30.0  # s of nodes that stay in the tree, at least: BACK_S and more
# of the assumed noise, at least: a quiet beginning must not talk the fixes away later; and what
# a receiver says of its fixes is kept
BOLDEST = 0.3
UNIT = 10.0  # prior sigmas: iSAM2 then passes on changes of a hundredth of a sigma


@dataclass(frozen=True)
class Window:
    """The newest nodes as they are known now: what is linearised anew with the next ones."""

    first: int  # oldest node of them
    estimate: Estimate  # of nodes `first` to the newest and of the segments in force
    x: Array  # (W + 1, 10) their error states from the base
    c: Array  # (K, dim)


class IncrementalGraph:
    """Nodes 0 to `last`, their intervals and the iSAM2 tree that holds them."""

    def __init__(self, log: NodeLog, lag: float | None, every_s: float) -> None:
        """`log` with node 0 alone, as aligned. With `lag` s nothing older is ever linearised
        again; the newest are every `every_s`.
        """
        self.log, self._lag = log, lag
        setup = log.setup
        self._every = max(1, round(every_s / setup.interval))  # nodes
        self._kept = round((KEPT_S + (lag or 0.0)) / room_of(setup.interval))
        self._R, self._v, self._p, self._phase = (
            GrowingArray(3, 3),
            GrowingArray(3),
            GrowingArray(3),
            GrowingArray(),
        )
        self._c = GrowingArray(setup.layout.dim)
        self._swept = FIRST_GROWTH  # nodes when all were last relinearised
        self._unit = UNIT * setup.layout.prior_sd
        self._tree = Tree(self._unit)
        # error state and covariance of the newest node
        self._tip = (np.zeros(NODE_DIM), np.zeros((NODE_DIM, NODE_DIM)))
        start, c = setup.alignment.start, setup.layout.prior.copy()
        c[setup.layout.slices[GYRO_BIAS]] = setup.alignment.gyro_bias
        aligned = (start.R_nb, start.v_n, start.p_n, np.zeros(()), c)
        for base, x in zip(self._bases, aligned, strict=True):
            base.push(x)

    @property
    def _bases(self) -> tuple[GrowingArray, ...]:
        return self._R, self._v, self._p, self._phase, self._c

    @property
    def every(self) -> int:
        """Nodes between looks back at the newest; fixes that come late wait for one."""
        late = self.log.setup.fix_delay > NODE_SLACK_S
        soon = max(1, round(LATE_EVERY_S / self.log.setup.interval))
        return min(self._every, soon) if late else self._every

    @property
    def last(self) -> int:
        """Number of the newest node."""
        return self.log.last

    def base(self, first: int, last: int) -> Estimate:
        """Where the error states of nodes `first` to `last` are zero."""
        on = slice(first, last + 1)
        R, v, p, phase = (x.rows[on] for x in self._bases[:4])
        return Estimate(R, v, p, phase, self._c.rows[self.log.segments(first, last)])

    def _error(self, first: int, last: int) -> tuple[Array, Array]:
        seg = self.log.segments(first, last)
        return self._tree.nodes(first, last + 1), self._tree.segments(seg.start, seg.stop)

    def everything(self) -> Estimate:
        """The estimate of all nodes and segments."""
        return self.base(0, self.last).retract(*self._tree.everything())

    def whole(self, at: Estimate) -> Problem:
        """The batch's problem over all nodes."""
        return self.log.problem(0, self.last, at)

    @property
    def origin(self) -> Origin:
        """The frame n."""
        return self.log.setup.alignment.origin

    def newest(self, i: int) -> tuple[Array, Array, Array, Array]:
        """Attitude, velocity, position and covariance (9, 9) of the node that entered last."""
        return self._state_of(i, self._tip[0], self._tip[1])

    def past(self, i: int) -> tuple[Array, Array, Array, Array]:
        """The same of an older node, as it is known now."""
        return self._state_of(i, *self._tree.marginal(i))

    def _state_of(self, i: int, x: Array, P: Array) -> tuple[Array, Array, Array, Array]:
        R = self._R.rows[i] @ so3.exp(x[ROTATION])
        return R, self._v.rows[i] + x[VELOCITY], self._p.rows[i] + x[POSITION], P[MOTION, MOTION]

    def window(self) -> Window:
        """The newest node alone, or those of the last seconds when a sweep is due."""
        n = self.last
        if n == 0 or n % self.every:
            seg = self.log.segments(n, n)
            x = self._tip[0][None]
            c = self._tree.segments(seg.start, seg.stop) if n else self._c.rows * 0.0
            return Window(n, self.base(n, n).retract(x, c), x, c)
        time = self.log.time.rows
        back = min(BACK_S + self.log.setup.fix_delay, LONGEST_BACK_S)
        return self._since(int(np.searchsorted(time, time[-1] - back)))

    def _since(self, first: int) -> Window:
        """The nodes from `first` on, as far as the lag goes back."""
        if self._lag is not None:
            oldest = float(self.log.time.rows[-1]) - self._lag
            first = max(first, int(np.searchsorted(self.log.time.rows, oldest)))
        x, c = self._tree.everything() if first == 0 else self._error(first, self.last)
        return Window(first, self.base(first, self.last).retract(x, c), x, c)

    def grow(self, edges: Sequence[int], state: str, window: Window) -> Iterator[int]:
        """Nodes at `edges`, predicted by the IMU and tied to the nodes before by every factor.

        They are linearised together, the window's along with them, and enter iSAM2 one by one:
        yields each when it has.
        """
        n, first, known = self.last, window.first, window.estimate
        before = len(self._c) - 1
        ties = []
        for edge in edges:
            new = self.log.extend(edge, state)
            ties.append(self._tie(known.calibration[-1:], new))
        problem = self.log.problem(first, self.last, self._ahead(known, n, None))
        estimate = self._ahead(known, n, problem.pre)
        rows = self._rows(problem, estimate, first)
        if first < n:
            self._exchange(window, rows.between(0, n - first))
        segment = self.log.segment_of(n, self.last)
        x = np.concatenate([window.x[-1:], np.zeros((len(edges), NODE_DIM))])
        c = np.where((segment == before)[:, None], window.c[-1:], 0.0)
        rows = rows.between(n - first, self.last - first).in_base(x, c).in_unit(self._unit)
        c /= self._unit
        for k, (tie, seg) in enumerate(zip(ties, segment.tolist(), strict=True)):
            row = rows.between(k, k + 1)
            row = row.weighted(row.surprise(*self._tip, c[k]))
            (factor,) = row.factors(*self._tree.keys(n + k, [seg]))
            self._tree.extend(factor, seg, tie, self._kept)
            self._tip = self._tree.marginal(n + k + 1)
            yield n + k + 1
        if self._lag is None and self.last >= GROWTH * self._swept:
            self.relinearise(learning=True)
            self._swept = self.last

    def _ahead(self, known: Estimate, n: int, pre: Preintegrated | None) -> Estimate:
        """The estimate of the nodes up to `n` carried on by the IMU to the new ones, whose base it
        becomes. Without `pre` they are where node `n` is.
        """
        count = self.last - n
        origin = self.origin
        R, v, p = known.R_nb[-1], known.v_n[-1], known.p_n[-1]
        g = origin.gravity(p)
        path = []
        for k in range(count):
            if pre is not None:
                R, v, p = predict(pre, len(pre.T) - count + k, R, v, p, g, origin.Omega_n)
            path.append((R, v, p))
        R_nb, v_n, p_n = (np.array(x) for x in zip(*path, strict=True))
        for base, rows in zip(self._bases[:4], (R_nb, v_n, p_n, np.zeros(count)), strict=True):
            base.cut(n + 1)
            base.append(rows)
        more = len(self._c) - self.log.segments(n, n).stop
        return Estimate(
            np.concatenate([known.R_nb, R_nb]),
            np.concatenate([known.v_n, v_n]),
            np.concatenate([known.p_n, p_n]),
            np.concatenate([known.phase, np.zeros(count)]),
            np.concatenate([known.calibration, np.repeat(known.calibration[-1:], more, 0)]),
        )

    def _tie(self, c: Array, new: bool) -> list[gtsam.JacobianFactor]:
        """What ties the segment of the newest interval, if it is `new` or the first: one at `c`."""
        k, layout = len(self._c), self.log.setup.layout
        if self.last == 1:
            (known,) = calibration_prior(layout, c)
            return self._tied(known, 0)
        if not new:
            return []
        self._c.append(c)
        (step,) = walk(layout, self._c.rows[-2:], self.log.segment_time.rows[k - 1 : k + 1], ())
        return self._tied(step, k - 1)

    def _tied(self, block: Block, first: int) -> list[gtsam.JacobianFactor]:
        """A block on calibrations, its segments numbered from `first`, in the tree's unit."""
        terms = [
            replace(t, index=t.index + first, jacobian=t.jacobian * self._unit) for t in block.terms
        ]
        return list(replace(block, terms=tuple(terms)).jacobian_factors())

    def _rows(self, problem: Problem, at: Estimate, first: int) -> IntervalRows:
        segment, dim = problem.nodes.segment, self.log.setup.layout.dim
        return stacked(problem.linearise(at), segment, dim, FIRST, begins=first == 0)

    def relinearise(self, learning: bool = False) -> None:
        """Linearise every interval again at the present estimate, as far as the lag goes back;
        `learning` with the noise their residuals show.
        """
        window = self._since(0)
        if learning:
            self._learn(window.estimate)
        if window.first < self.last:
            problem = self.log.problem(window.first, self.last, window.estimate)
            rows = self._rows(problem, window.estimate, window.first)
            self._exchange(window, rows)

    def settle(self) -> None:
        """No more will come: all of it linearised until that changes little."""
        for _ in range(LAST_SWEEPS):
            self.relinearise()

    def _learn(self, estimate: Estimate) -> None:
        """Find the noise in the residuals of the whole run so far, as the batch's rounds do."""
        problem = self.whole(estimate)
        blocks = problem.linearise(estimate)
        net = square_root(blocks, problem.order, FIRST)
        joints = covariances(net, problem.order).joints
        found = rescaled(self.log.scales, blocks, problem.noise, joints)
        gear = {key: scale for key, scale in found.items() if not key.startswith(kinds.GNSS)}
        self.log.scales = ASSUMED | {key: max(scale, BOLDEST) for key, scale in gear.items()}

    def _exchange(self, window: Window, rows: IntervalRows) -> None:
        """Put a window's rows, linearised and weighed at its estimate, in the place of the old."""
        first = window.first
        segment = self.log.segment_of(first, first + len(window.x) - 1)
        rows = rows.weighted(-rows.b).in_base(window.x, window.c[segment - segment[0]])
        keys = self._tree.keys(first, segment.tolist())
        factors = list(rows.in_unit(self._unit).factors(*keys))
        self._tree.exchange(first, factors, self._kept)
        self._tip = self._tree.marginal(first + len(segment))
