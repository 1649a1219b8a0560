"""Standstill as a stream judges it: by the batch's functions, with what is known by then.

An increment counts as standstill once it has been steady for a second.
"""

from dataclasses import replace

import numpy as np

from factors.preintegration import Increments
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, Odometer
from graphnav.inertial.carried_standstill import WINDOW_S, travels
from graphnav.inertial.standstill import (
    Standstill,
    StandstillLimits,
    braked,
    deviation_limits,
    may_be_standstill,
    noise_of,
)
from graphnav.inertial.standstill_evidence import (
    REACH_S,
    SHORTEST_S,
    Mask,
    StandstillEvidence,
    runs,
    spans,
    standstill_evidence,
    within,
)
from graphnav.inertial.standstill_rate import StandstillRate, standstill_rate
from graphnav.stream.causal_carried_standstill import CausalCarried, Fixes
from graphnav.stream.inertial_intake import InertialIntake
from graphnav.stream.intake import LOOK_AHEAD_S, Distance, Sides
from graphnav.stream.reckoned_speed import ReckonedSpeed

FRAME = 20  # increments after which the usual steadiness is measured anew
REMEMBERED = 1200  # increments of stopped gear, and frames of rates, it is found from
CONTEXT = 4 * FRAME  # increments before those that are judged

UNKNOWN = StandstillRate(np.zeros(3), np.inf)


class Memory:
    """What steady and moving increments have shown so far."""

    def __init__(self, bias_sd: float) -> None:
        self._bias_sd = bias_sd  # rad/s
        self._gear_stopped = GrowingArray(2)  # deviations of force and rate then
        self._steady, self._moving = GrowingArray(3), GrowingArray(3)  # rates, one a frame
        self._width = 1  # increments in a window

    def add(self, q: StandstillEvidence, limits: StandstillLimits, heard: bool) -> None:
        """Another frame; `heard` whether there is an odometer by then."""
        self._width, steady = q.width, limits.steady(q)
        if heard:
            self._gear_stopped.append(np.column_stack([q.force_sd, q.rate_sd])[q.gear_stopped])
        if steady.all():
            self._steady.push(q.rate.mean(0))
        elif not (q.gear_stopped if heard else steady).any():
            self._moving.push(q.rate.mean(0))

    def limits(self, heard: bool) -> StandstillLimits:
        """What is usual at standstill."""
        deviation = self._gear_stopped.rows[-REMEMBERED:]
        if heard and not len(deviation):
            return StandstillLimits(np.inf, np.inf, UNKNOWN)
        force_sd, rate_sd = deviation_limits(deviation, heard)
        if not len(self._steady):
            return StandstillLimits(force_sd, rate_sd, UNKNOWN)
        steady = (
            deviation[(deviation < (force_sd, rate_sd)).all(1), 1] if heard else np.array([rate_sd])
        )
        rates = self._steady.rows[-REMEMBERED:], self._moving.rows[-REMEMBERED:]
        found = standstill_rate(*rates, noise_of(steady, self._width), self._bias_sd)
        return StandstillLimits(force_sd, rate_sd, found)


class CausalStandstill:
    """Which increments are at standstill."""

    def __init__(self, bias_sd: float) -> None:
        """`bias_sd` rad/s, one sigma of the gyro bias expected."""
        self.at_standstill = GrowingArray()  # 0 or 1 by increment
        self.gear_stopped = GrowingArray()  # the same
        self.held = GrowingArray()  # at standstill on ground not known to move: where nodes are few
        self.reckoned = ReckonedSpeed()
        self._memory = Memory(bias_sd)
        self._limits, self._heard = StandstillLimits(np.inf, np.inf, UNKNOWN), False
        self._steady_s = 0.0  # how long it has been steady
        self._began: float | None = None  # s, start of the steady span that goes on
        self._is_standstill = False  # whether it is a standstill
        self._believed: Array | None = None  # start and end of the standstill before, s
        self._revoked = list[tuple[float, float, float]]()  # known at, start, end of none, s
        self._carried = CausalCarried()

    def next_frame(self, ready: int) -> int:
        """End of the frame that goes on, `ready` at most."""
        done = len(self.at_standstill)
        return min(done - done % FRAME + FRAME, ready)

    def advance(
        self, inertial: InertialIntake, odometer: Distance, sides: Sides, fixes: Fixes, ready: int
    ) -> None:
        """Judge the increments up to `ready`, which must have their look-ahead."""
        done = len(self.at_standstill)
        if ready <= done:
            return
        before = max(done - CONTEXT, 0)
        inc = inertial.between(before, len(inertial))
        there = odometer.around(inc.edge[0], inc.edge[-1])
        q = standstill_evidence(inc, there, sides.around(inc.edge[0], inc.edge[-1]))
        since = np.inf if there is None else float(there.time[0])
        q = replace(q, gear_stopped=q.gear_stopped | (inc.edge[1:] < since - REACH_S))
        while done < ready:
            end = self.next_frame(ready)
            on = slice(done - before, end - before)
            if done % FRAME == 0:
                self._heard = since < inc.edge[on.start] + LOOK_AHEAD_S
                self._limits = self._memory.limits(self._heard)
            self._judge(inc, there, q.over(on), on)
            if end % FRAME == 0:
                self._look_back(inertial, q.over(slice(max(on.stop - FRAME, 0), on.stop)), fixes)
            done = end

    def _judge(
        self, inc: Increments, odometer: Odometer | None, q: StandstillEvidence, on: slice
    ) -> None:
        """Some more increments, within a frame."""
        edge = inc.edge[on.start : on.stop + 1]
        lasting = self._lasting(self._limits.allow(q), np.diff(edge))
        carried = self._carried.now
        self._carried.follow(q.gear_stopped, edge)
        at_standstill = np.zeros(len(lasting))
        for first, end, steady in runs(lasting):
            if steady and self._began is None:
                self._began = max(float(edge[first + 1]) - SHORTEST_S, float(inc.edge[0]))
                self._is_standstill = self._may_be_standstill(inc, odometer, float(edge[first + 1]))
            elif not steady and self._began is not None:
                if self._is_standstill:
                    self._believed = np.array([self._began, edge[first]])
                self._began = None
            at_standstill[first:end] = steady and self._is_standstill
        if self._began is not None and self._is_standstill:
            self._carried.standstill(self._began, float(edge[-1]))
        self.at_standstill.append(at_standstill)
        self.gear_stopped.append(
            q.gear_stopped.astype(np.float64) if self._heard else at_standstill
        )
        self.held.append(at_standstill * (not carried))

    def _lasting(self, steady: Mask, dt: Array) -> Mask:
        """Steady increments that end at least `SHORTEST_S` of them."""
        lasted = np.cumsum(dt)
        broken = np.maximum.accumulate(np.where(steady, -self._steady_s, lasted))
        lasted = np.where(steady, lasted - broken, 0.0)
        self._steady_s = float(lasted[-1])
        return np.asarray(lasted > SHORTEST_S - 1e-6)

    def _may_be_standstill(self, inc: Increments, odometer: Odometer | None, until: float) -> bool:
        """Whether the steady span that goes on may be a standstill."""
        span = np.array([self._began, until])
        if self._heard and odometer is not None:
            return len(braked(span[None], inc, odometer)) > 0
        return may_be_standstill(span, self._believed, *self.reckoned.speed)

    def _look_back(self, inertial: InertialIntake, q: StandstillEvidence, fixes: Fixes) -> None:
        """At the end of a frame: what contradicts the present standstill, and what is usual."""
        count = len(self.at_standstill)
        now = float(inertial.edge.rows[count])
        self._memory.add(q, self._limits, self._heard)
        if self._heard:
            self._carried.look(inertial, fixes, now)
            return
        self.reckoned.extend(inertial, count)
        if self._began is None or not self._is_standstill:
            return
        span = np.array([self._began, now])
        gnss = fixes(now - WINDOW_S, now)
        moves = gnss is not None and len(travels(gnss, self._began, now)) > 0
        if moves or not may_be_standstill(span, self._believed, *self.reckoned.speed):
            self._revoked.append((now, self._began, now))
            self._is_standstill = False

    def spans(self, edge: Array, until: int) -> Array:
        """Standstills among the first `until` increments, (K, 2) s."""
        return spans(self.held.rows[:until] > 0, edge)

    def between(self, first: int, end: int, edge: Array, known: float) -> Standstill:
        """What was known at a time of increments `first` to `end - 1`, between `edge` s."""
        at_standstill = self.at_standstill.rows[first:end] > 0
        revoked = [(a, b) for when, a, b in self._revoked if when <= known + 1e-9]
        at_standstill &= ~within(edge, np.reshape(revoked, (-1, 2)))
        return Standstill(edge, at_standstill, self._carried.within(edge, known))
