"""Standstill as a stream judges it: by the batch's functions, with what is known by then.

An increment counts as still once it has been quiet for a second.
"""

from dataclasses import replace

import numpy as np

from factors.preintegration import Increments
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, Odometer
from graphnav.inertial.carried import WINDOW_S, travels
from graphnav.inertial.quietness import (
    REACH_S,
    SHORTEST_S,
    Mask,
    Quietness,
    quietness,
    runs,
    spans,
    within,
)
from graphnav.inertial.rest_rate import RestRate, rest_rate
from graphnav.inertial.standstill import (
    Standstill,
    Usual,
    braked,
    limits,
    may_stand,
    noise_of,
)
from graphnav.stream.carried import CausalCarried, Fixes
from graphnav.stream.inertial_intake import Inertial
from graphnav.stream.intake import LOOK_AHEAD_S, Distance, Sides
from graphnav.stream.reckoned_speed import ReckonedSpeed

FRAME = 20  # increments after which the usual quietness is measured anew
REMEMBERED = 1200  # increments of silence, and frames of rates, it is found from
CONTEXT = 4 * FRAME  # increments before those that are judged

UNKNOWN = RestRate(np.zeros(3), np.inf)


class Memory:
    """What quiet and moving increments have shown so far."""

    def __init__(self, bias_sd: float) -> None:
        self._bias_sd = bias_sd  # rad/s
        self._silent = GrowingArray(2)  # deviations of force and rate while the gear was silent
        self._quiet, self._moving = GrowingArray(3), GrowingArray(3)  # rates, one a frame
        self._width = 1  # increments in a window

    def add(self, q: Quietness, usual: Usual, heard: bool) -> None:
        """Another frame; `heard` whether there is an odometer by then."""
        self._width, quiet = q.width, usual.quiet(q)
        if heard:
            self._silent.append(np.column_stack([q.shake, q.turn])[q.silent])
        if quiet.all():
            self._quiet.push(q.rate.mean(0))
        elif not (q.silent if heard else quiet).any():
            self._moving.push(q.rate.mean(0))

    def usual(self, heard: bool) -> Usual:
        """What is usual at standstill."""
        deviation = self._silent.rows[-REMEMBERED:]
        if heard and not len(deviation):
            return Usual(np.inf, np.inf, UNKNOWN)
        shake, turn = limits(deviation, heard)
        if not len(self._quiet):
            return Usual(shake, turn, UNKNOWN)
        quiet = deviation[(deviation < (shake, turn)).all(1), 1] if heard else np.array([turn])
        rates = self._quiet.rows[-REMEMBERED:], self._moving.rows[-REMEMBERED:]
        found = rest_rate(*rates, noise_of(quiet, self._width), self._bias_sd)
        return Usual(shake, turn, found)


class CausalStandstill:
    """Which increments are at standstill."""

    def __init__(self, bias_sd: float) -> None:
        """`bias_sd` rad/s, one sigma of the gyro bias expected."""
        self.still, self.silent = GrowingArray(), GrowingArray()  # 0 or 1 by increment
        self.resting = GrowingArray()  # still on ground not known to move: where nodes are few
        self.reckoned = ReckonedSpeed()
        self._memory = Memory(bias_sd)
        self._usual, self._heard = Usual(np.inf, np.inf, UNKNOWN), False
        self._quiet_s = 0.0  # how long it has been quiet
        self._rest: float | None = None  # s, start of the quiet span that goes on
        self._stands = False  # whether it is a rest
        self._believed: Array | None = None  # start and end of the rest before, s
        self._revoked = list[tuple[float, float, float]]()  # known at, start, end of no rest, s
        self._carried = CausalCarried()

    def next_frame(self, ready: int) -> int:
        """End of the frame that goes on, `ready` at most."""
        done = len(self.still)
        return min(done - done % FRAME + FRAME, ready)

    def advance(
        self, inertial: Inertial, odometer: Distance, sides: Sides, fixes: Fixes, ready: int
    ) -> None:
        """Judge the increments up to `ready`, which must have their look-ahead."""
        done = len(self.still)
        if ready <= done:
            return
        before = max(done - CONTEXT, 0)
        inc = inertial.between(before, len(inertial))
        there = odometer.around(inc.edge[0], inc.edge[-1])
        q = quietness(inc, there, sides.around(inc.edge[0], inc.edge[-1]))
        since = np.inf if there is None else float(there.time[0])
        q = replace(q, silent=q.silent | (inc.edge[1:] < since - REACH_S))
        while done < ready:
            end = self.next_frame(ready)
            on = slice(done - before, end - before)
            if done % FRAME == 0:
                self._heard = since < inc.edge[on.start] + LOOK_AHEAD_S
                self._usual = self._memory.usual(self._heard)
            self._judge(inc, there, q.over(on), on)
            if end % FRAME == 0:
                self._look_back(inertial, q.over(slice(max(on.stop - FRAME, 0), on.stop)), fixes)
            done = end

    def _judge(self, inc: Increments, odometer: Odometer | None, q: Quietness, on: slice) -> None:
        """Some more increments, within a frame."""
        edge = inc.edge[on.start : on.stop + 1]
        lasting = self._lasting(self._usual.still(q), np.diff(edge))
        carried = self._carried.now
        self._carried.follow(q.silent, edge)
        still = np.zeros(len(lasting))
        for first, end, quiet in runs(lasting):
            if quiet and self._rest is None:
                self._rest = max(float(edge[first + 1]) - SHORTEST_S, float(inc.edge[0]))
                self._stands = self._may_stand(inc, odometer, float(edge[first + 1]))
            elif not quiet and self._rest is not None:
                if self._stands:
                    self._believed = np.array([self._rest, edge[first]])
                self._rest = None
            still[first:end] = quiet and self._stands
        if self._rest is not None and self._stands:
            self._carried.rest(self._rest, float(edge[-1]))
        self.still.append(still)
        self.silent.append(q.silent.astype(np.float64) if self._heard else still)
        self.resting.append(still * (not carried))

    def _lasting(self, quiet: Mask, dt: Array) -> Mask:
        """Quiet increments that end at least `SHORTEST_S` of quiet."""
        lasted = np.cumsum(dt)
        broken = np.maximum.accumulate(np.where(quiet, -self._quiet_s, lasted))
        lasted = np.where(quiet, lasted - broken, 0.0)
        self._quiet_s = float(lasted[-1])
        return np.asarray(lasted > SHORTEST_S - 1e-6)

    def _may_stand(self, inc: Increments, odometer: Odometer | None, until: float) -> bool:
        """Whether the quiet span that goes on may be a rest."""
        rest = np.array([self._rest, until])
        if self._heard and odometer is not None:
            return len(braked(rest[None], inc, odometer)) > 0
        return may_stand(rest, self._believed, *self.reckoned.speed)

    def _look_back(self, inertial: Inertial, q: Quietness, fixes: Fixes) -> None:
        """At the end of a frame: what contradicts the rest that goes on, and what is usual."""
        count = len(self.still)
        now = float(inertial.edge.rows[count])
        self._memory.add(q, self._usual, self._heard)
        if self._heard:
            self._carried.look(inertial, fixes, now)
            return
        self.reckoned.extend(inertial, count)
        if self._rest is None or not self._stands:
            return
        rest = np.array([self._rest, now])
        gnss = fixes(now - WINDOW_S, now)
        moves = gnss is not None and len(travels(gnss, self._rest, now)) > 0
        if moves or not may_stand(rest, self._believed, *self.reckoned.speed):
            self._revoked.append((now, self._rest, now))
            self._stands = False

    def spans(self, edge: Array, until: int) -> Array:
        """Rests among the first `until` increments, (K, 2) s."""
        return spans(self.resting.rows[:until] > 0, edge)

    def between(self, first: int, end: int, edge: Array, known: float) -> Standstill:
        """What was known at a time of increments `first` to `end - 1`, between `edge` s."""
        still = self.still.rows[first:end] > 0
        told = [(a, b) for when, a, b in self._revoked if when <= known + 1e-9]
        still &= ~within(edge, np.reshape(told, (-1, 2)))
        return Standstill(edge, still, self._carried.within(edge, known))
