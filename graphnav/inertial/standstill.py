"""Where the vehicle stands: a hypothesis that running gear, IMU and fixes may contradict.

Running gear that stopped (both sides, where there are two) and a steady IMU name the candidates.
What turns at another rate than the gyros show at standstill is a turn on the spot; what slows
otherwise than the odometer is a locked wheel. A vehicle that stands may be carried: see
`carried_standstill`. Batch and stream judge with the same functions, the stream with what it knows
by then.
"""

from dataclasses import dataclass, replace

import numpy as np

from factors.preintegration import Increments
from graphnav.common.run import Array, Gnss, Odometer, Run
from graphnav.inertial.carried_standstill import carried_in, moved_along, moving_standstills
from graphnav.inertial.odometer_steps import speed_at
from graphnav.inertial.standstill_evidence import (
    REACH_S,
    SHORTEST_S,
    Mask,
    StandstillEvidence,
    long_enough,
    spans,
    standstill_evidence,
    within,
)
from graphnav.inertial.standstill_rate import StandstillRate, standstill_rate

BEGINS_S = 0.7  # of the run's start: a standstill that begins later is no initial standstill
SPEED_SLACK, SPEED_DRIFT = 0.3, 0.01  # m/s and m/s^2, of a speed reckoned from the IMU alone
MOST_SLACK = 1.5  # m/s; a speed known worse than this tells no stop from a crawl
BRAKING_S, BRAKING_SLACK = 2.0, 2.5  # s before a standstill, m/s of braking the IMU may miss there
# without an odometer the IMU alone must be this steady: m/s^2 and rad/s, standard deviations
LONE_IMU_FORCE, LONE_IMU_RATE = 0.06, 0.004
MOST_FORCE, MOST_RATE = 3.0, 0.2  # the same with an odometer: what shakes more does not stand
USUAL_FACTOR, LEAST_FORCE, LEAST_RATE = 4.0, 1e-3, 1e-6  # of the usual deviation; m/s^2, rad/s


@dataclass(frozen=True)
class Standstill:
    """Where the vehicle stands on its wheels, and where it is carried as it stands."""

    edge: Array  # (M + 1,) s, of the increments
    at_standstill: Mask  # (M,) stands, carried or not
    carried: Mask  # (M, 2) the ground moves, horizontally or vertically; its wheels say nothing

    @property
    def standstills(self) -> Array:
        """Spans at standstill on ground that does not move, (K, 2) s."""
        return spans(self.at_standstill & ~self.carried.any(1), self.edge)

    @property
    def moved(self) -> Array:
        """Spans carried: start, end [s] and whether horizontally and vertically, (C, 4)."""
        along = [np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])]
        each = [spans(on, self.edge) for on in self.carried.T]
        return np.concatenate(
            [np.hstack([s, np.repeat(a, len(s), 0)]) for s, a in zip(each, along, strict=True)]
        )

    @property
    def changes(self) -> Array:
        """Times at which standstill, or being carried, begins or ends, s."""
        state = np.column_stack([self.at_standstill, self.carried])
        return np.asarray(self.edge[1:-1][(state[1:] != state[:-1]).any(1)])


@dataclass(frozen=True)
class StandstillLimits:
    """What is usual at standstill: the most deviation of force and rate, and the rate itself."""

    force_sd: float  # m/s^2
    rate_sd: float  # rad/s
    gyro: StandstillRate | None  # None: nothing yet, or nothing that is no turn

    def steady(self, q: StandstillEvidence) -> Mask:
        """Whether each increment is as quiet as a standstill, turning or not, (M,)."""
        return np.asarray(
            q.gear_stopped & (q.force_sd < self.force_sd) & (q.rate_sd < self.rate_sd)
        )

    def allow(self, q: StandstillEvidence) -> Mask:
        """Whether the vehicle may stand during each increment, (M,)."""
        if self.gyro is None:
            return np.zeros(len(q.gear_stopped), bool)
        away = np.linalg.norm(q.rate - self.gyro.rate, axis=1)
        return np.asarray(self.steady(q) & (away < self.gyro.tolerance))


def deviation_limits(deviation: Array, heard: bool) -> tuple[float, float]:
    """Most deviation of force [m/s^2] and rate [rad/s] at standstill, from those (n, 2) while the
    running gear was stopped; where none is `heard`, the IMU alone must be steady.
    """
    if not heard:
        return LONE_IMU_FORCE, LONE_IMU_RATE
    if not len(deviation):
        return 0.0, 0.0
    force_sd, rate_sd = USUAL_FACTOR * np.median(deviation, axis=0) + (LEAST_FORCE, LEAST_RATE)
    return min(float(force_sd), MOST_FORCE), min(float(rate_sd), MOST_RATE)


def noise_of(rate_sd: Array, width: int) -> float:
    """One sigma of a window's mean rate [rad/s] from the deviations (n,) inside windows."""
    return float(np.median(rate_sd)) / np.sqrt(width) if len(rate_sd) else 0.0


def find_standstill(inc: Increments, run: Run, gnss: Gnss | None, bias_sd: float) -> Standstill:
    """Where the vehicle of a run stands, and where it is carried.

    The quietness usual among the candidates decides, so that an odometer that reads zero while the
    vehicle creeps is overruled by the IMU. `gnss` the fixes in use, `bias_sd` rad/s, one sigma of
    the gyro bias expected.
    """
    odometer = run.odometer
    q = standstill_evidence(inc, odometer, run.sides)
    if odometer is not None:
        q = replace(q, gear_stopped=q.gear_stopped | before_the_odometer(inc, odometer, q))
    at_standstill = standstill_limits(q, odometer is not None, bias_sd).allow(q)
    standstills = spans(long_enough(at_standstill, inc.edge), inc.edge)
    if odometer is None:
        kept = within(inc.edge, standstills)
        if gnss is not None:
            kept &= ~carried_in(inc.edge, moved_along(standstills, gnss)).any(1)
        return Standstill(inc.edge, kept, np.zeros((len(at_standstill), 2), bool))
    standstills = braked(standstills, inc, odometer)
    gear_stops = spans(long_enough(q.gear_stopped, inc.edge), inc.edge)
    carried = carried_in(inc.edge, moving_standstills(inc, standstills, gear_stops))
    if gnss is not None:
        carried |= carried_in(inc.edge, moved_along(gear_stops, gnss))
    return Standstill(inc.edge, within(inc.edge, standstills), carried)


def standstill_limits(q: StandstillEvidence, heard: bool, bias_sd: float) -> StandstillLimits:
    """What is usual at standstill over a run; `heard` whether it has an odometer."""
    force_sd, rate_sd = deviation_limits(
        np.column_stack([q.force_sd, q.rate_sd])[q.gear_stopped], heard
    )
    usual = StandstillLimits(force_sd, rate_sd, None)
    steady = usual.steady(q)
    noise = noise_of(q.rate_sd[steady], q.width)
    moving = q.rate[~q.gear_stopped if heard else ~steady]
    found = standstill_rate(q.rate[steady][:: q.width], moving[:: q.width], noise, bias_sd)
    return StandstillLimits(force_sd, rate_sd, found)


def before_the_odometer(inc: Increments, odometer: Odometer, q: StandstillEvidence) -> Mask:
    """A quiet beginning of the run, over before the odometer is heard: an initial standstill."""
    early = inc.edge[1:] < odometer.time[0] - REACH_S
    steady = early & (q.force_sd < LONE_IMU_FORCE) & (q.rate_sd < LONE_IMU_RATE)
    begun = np.logical_and.accumulate(steady)
    return np.asarray(begun & (begun.sum() * np.diff(inc.edge).mean() > SHORTEST_S))


def believable(standstills: Array, time: Array, speed: Array) -> Array:
    """The standstills (K, 2) s at which a reckoned speed (n,) m/s at `time` may have been zero."""
    kept: list[Array] = []
    for span in standstills:
        if may_be_standstill(span, kept[-1] if kept else None, time, speed):
            kept.append(span)
    return np.array(kept).reshape(-1, 2)


def may_be_standstill(span: Array, last: Array | None, time: Array, speed: Array) -> bool:
    """Whether a vehicle without an odometer may stand from `span[0]` to `span[1]` s.

    A smooth ride at constant speed is as quiet as a stop. The first standstill, when the run begins
    with it, is believed; each later one only while the speed reckoned since the `last` believed one
    is small against its own drift. A stop missed costs little, a false one ruins all.
    """
    if last is None:
        return bool(span[0] - time[0] < BEGINS_S)
    gained = np.interp(span, time, speed) - np.interp(last[1], time, speed)
    slack = SPEED_SLACK + SPEED_DRIFT * float(span[0] - last[1])
    return bool(slack < MOST_SLACK and np.abs(gained).max() < slack)


def braked(standstills: Array, inc: Increments, odometer: Odometer) -> Array:
    """The standstills (K, 2) s before which the IMU slows as the odometer does: no locked wheel.

    Gravity along the vehicle is taken from the standstill itself.
    """
    kept = []
    forward = np.concatenate([[0.0], np.cumsum(inc.velocity[:, 1])])
    for start, end in standstills:
        before = max(start - BRAKING_S, inc.edge[0])
        v_before, v_start, v_end = np.interp([before, start, end], inc.edge, forward)
        gravity = (v_end - v_start) / (end - start)
        slowed = v_start - v_before - gravity * (start - before)
        if abs(slowed + float(speed_at(odometer, np.array(before)))) < BRAKING_SLACK:
            kept.append((start, end))
    return np.array(kept).reshape(-1, 2)


def rocking(inc: Increments, standstills: Array, gyro: float) -> Array:
    """One sigma of the body's angle about its mean while it stands, by axis, (3,) rad.

    The gyro's angle with its trend taken off: an idling engine shakes, wind and people rock. What
    the gyro's own random walk (`gyro` rad/sqrt(s)) leaves of that, T/15 of its square, is not the
    vehicle's. The median over the standstills.
    """
    found = []
    inc_dt = float(np.diff(inc.edge).mean())
    for start, end in standstills:
        on = (inc.edge[:-1] >= start) & (inc.edge[1:] <= end)
        angle = np.cumsum(inc.rotation[on][: round(60 / inc_dt)], 0)
        if len(angle) > 10:
            t = np.linspace(-1, 1, len(angle))
            angle = angle - angle.mean(0)
            trend = t[:, None] * (t @ angle) / (t @ t)
            own = gyro**2 * inc_dt * len(angle) / 15
            found.append(np.sqrt(np.maximum((angle - trend).var(0) - own, 0.1 * own)))
    return np.median(found, 0) if found else np.zeros(3)
