"""Where the vehicle stands: a hypothesis that running gear, IMU and fixes may contradict.

A silent odometer (both sides, where there are two) and a quiet IMU name the candidates. What turns
at another rate than the gyros show at rest is a turn on the spot; what slows otherwise than the
odometer is a locked wheel. A vehicle that stands may be carried: see `carried`. Batch and stream
judge with the same functions, the stream with what it knows by then.
"""

from dataclasses import dataclass, replace

import numpy as np

from factors.preintegration import Increments
from graphnav.common.run import Array, Gnss, Odometer, Run
from graphnav.inertial.carried import carried_in, moved_along, moving_rests
from graphnav.inertial.odometry import speed_at
from graphnav.inertial.quietness import (
    REACH_S,
    SHORTEST_S,
    Mask,
    Quietness,
    long_enough,
    quietness,
    spans,
    within,
)
from graphnav.inertial.rest_rate import RestRate, rest_rate

BEGINS_S = 0.7  # of the run's start: a rest that begins later is no standing start
SPEED_SLACK, SPEED_DRIFT = 0.3, 0.01  # m/s and m/s^2, of a speed reckoned from the IMU alone
MOST_SLACK = 1.5  # m/s; a speed known worse than this tells no stop from a crawl
BRAKING_S, BRAKING_SLACK = 2.0, 2.5  # s before a rest, m/s of braking the IMU may miss there
# without an odometer the IMU alone must be this still: m/s^2 and rad/s, standard deviations
QUIET_FORCE, QUIET_RATE = 0.06, 0.004
MOST_FORCE, MOST_RATE = 3.0, 0.2  # the same with an odometer: what shakes more does not stand
USUAL_FACTOR, LEAST_FORCE, LEAST_RATE = 4.0, 1e-3, 1e-6  # of the usual deviation; m/s^2, rad/s


@dataclass(frozen=True)
class Standstill:
    """Where the vehicle stands on its wheels, and where it is carried as it stands."""

    edge: Array  # (M + 1,) s, of the increments
    still: Mask  # (M,) stands, carried or not
    carried: Mask  # (M, 2) the ground moves, horizontally or vertically; its wheels say nothing

    @property
    def rests(self) -> Array:
        """Spans at rest on ground that does not move, (K, 2) s."""
        return spans(self.still & ~self.carried.any(1), self.edge)

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
        """Times at which standing, or being carried, begins or ends, s."""
        state = np.column_stack([self.still, self.carried])
        return np.asarray(self.edge[1:-1][(state[1:] != state[:-1]).any(1)])


@dataclass(frozen=True)
class Usual:
    """What is usual at standstill: the most deviation of force and rate, and the rate itself."""

    shake: float  # m/s^2
    turn: float  # rad/s
    rest: RestRate | None  # None: nothing yet, or nothing that is no turn

    def quiet(self, q: Quietness) -> Mask:
        """Whether each increment is as quiet as a standstill, turning or not, (M,)."""
        return np.asarray(q.silent & (q.shake < self.shake) & (q.turn < self.turn))

    def still(self, q: Quietness) -> Mask:
        """Whether the vehicle may stand during each increment, (M,)."""
        if self.rest is None:
            return np.zeros(len(q.silent), bool)
        away = np.linalg.norm(q.rate - self.rest.rate, axis=1)
        return np.asarray(self.quiet(q) & (away < self.rest.tolerance))


def limits(deviation: Array, heard: bool) -> tuple[float, float]:
    """Most deviation of force [m/s^2] and rate [rad/s] at rest, from those (n, 2) while the
    running gear was silent; where none is `heard`, the IMU alone must be still.
    """
    if not heard:
        return QUIET_FORCE, QUIET_RATE
    if not len(deviation):
        return 0.0, 0.0
    shake, turn = USUAL_FACTOR * np.median(deviation, axis=0) + (LEAST_FORCE, LEAST_RATE)
    return min(float(shake), MOST_FORCE), min(float(turn), MOST_RATE)


def noise_of(turn: Array, width: int) -> float:
    """One sigma of a window's mean rate [rad/s] from the deviations (n,) inside windows."""
    return float(np.median(turn)) / np.sqrt(width) if len(turn) else 0.0


def standstill(inc: Increments, run: Run, gnss: Gnss | None, bias_sd: float) -> Standstill:
    """Where the vehicle of a run stands, and where it is carried.

    The quietness usual among the candidates decides, so that an odometer that reads zero while the
    vehicle creeps is overruled by the IMU. `gnss` the fixes in use, `bias_sd` rad/s, one sigma of
    the gyro bias expected.
    """
    odometer = run.odometer
    q = quietness(inc, odometer, run.sides)
    if odometer is not None:
        q = replace(q, silent=q.silent | before_the_odometer(inc, odometer, q))
    still = usual_of(q, odometer is not None, bias_sd).still(q)
    rests = spans(long_enough(still, inc.edge), inc.edge)
    if odometer is None:
        kept = within(inc.edge, rests)
        if gnss is not None:
            kept &= ~carried_in(inc.edge, moved_along(rests, gnss)).any(1)
        return Standstill(inc.edge, kept, np.zeros((len(still), 2), bool))
    rests = braked(rests, inc, odometer)
    silences = spans(long_enough(q.silent, inc.edge), inc.edge)
    carried = carried_in(inc.edge, moving_rests(inc, rests, silences))
    if gnss is not None:
        carried |= carried_in(inc.edge, moved_along(silences, gnss))
    return Standstill(inc.edge, within(inc.edge, rests), carried)


def usual_of(q: Quietness, heard: bool, bias_sd: float) -> Usual:
    """What is usual at standstill over a run; `heard` whether it has an odometer."""
    shake, turn = limits(np.column_stack([q.shake, q.turn])[q.silent], heard)
    usual = Usual(shake, turn, None)
    quiet = usual.quiet(q)
    noise = noise_of(q.turn[quiet], q.width)
    moving = q.rate[~q.silent if heard else ~quiet]
    found = rest_rate(q.rate[quiet][:: q.width], moving[:: q.width], noise, bias_sd)
    return Usual(shake, turn, found)


def before_the_odometer(inc: Increments, odometer: Odometer, q: Quietness) -> Mask:
    """A quiet beginning of the run, over before the odometer is heard: a standing start."""
    early = inc.edge[1:] < odometer.time[0] - REACH_S
    quiet = early & (q.shake < QUIET_FORCE) & (q.turn < QUIET_RATE)
    begun = np.logical_and.accumulate(quiet)
    return np.asarray(begun & (begun.sum() * np.diff(inc.edge).mean() > SHORTEST_S))


def believable(rests: Array, time: Array, speed: Array) -> Array:
    """The rests (K, 2) s at which a reckoned speed (n,) m/s at `time` may have been zero."""
    kept: list[Array] = []
    for rest in rests:
        if may_stand(rest, kept[-1] if kept else None, time, speed):
            kept.append(rest)
    return np.array(kept).reshape(-1, 2)


def may_stand(rest: Array, last: Array | None, time: Array, speed: Array) -> bool:
    """Whether a vehicle without an odometer may rest from `rest[0]` to `rest[1]` s.

    A smooth ride at constant speed is as quiet as a stop. The first rest, when the run begins with
    it, is believed; each later one only while the speed reckoned since the `last` believed rest is
    small against its own drift. A stop missed costs little, a false one ruins all.
    """
    if last is None:
        return bool(rest[0] - time[0] < BEGINS_S)
    gained = np.interp(rest, time, speed) - np.interp(last[1], time, speed)
    slack = SPEED_SLACK + SPEED_DRIFT * float(rest[0] - last[1])
    return bool(slack < MOST_SLACK and np.abs(gained).max() < slack)


def braked(rests: Array, inc: Increments, odometer: Odometer) -> Array:
    """The rests (K, 2) s before which the IMU slows as the odometer does: a locked wheel is none.

    Gravity along the vehicle is taken from the rest itself.
    """
    kept = []
    forward = np.concatenate([[0.0], np.cumsum(inc.velocity[:, 1])])
    for start, end in rests:
        before = max(start - BRAKING_S, inc.edge[0])
        v_before, v_start, v_end = np.interp([before, start, end], inc.edge, forward)
        gravity = (v_end - v_start) / (end - start)
        slowed = v_start - v_before - gravity * (start - before)
        if abs(slowed + float(speed_at(odometer, np.array(before)))) < BRAKING_SLACK:
            kept.append((start, end))
    return np.array(kept).reshape(-1, 2)


def rocking(inc: Increments, rests: Array, gyro: float) -> Array:
    """One sigma of the body's angle about its mean while it stands, by axis, (3,) rad.

    The gyro's angle with its trend taken off: an idling engine shakes, wind and people rock. What
    the gyro's own random walk (`gyro` rad/sqrt(s)) leaves of that, T/15 of its square, is not the
    vehicle's. The median over the rests.
    """
    found = []
    inc_dt = float(np.diff(inc.edge).mean())
    for start, end in rests:
        on = (inc.edge[:-1] >= start) & (inc.edge[1:] <= end)
        angle = np.cumsum(inc.rotation[on][: round(60 / inc_dt)], 0)
        if len(angle) > 10:
            t = np.linspace(-1, 1, len(angle))
            angle = angle - angle.mean(0)
            trend = t[:, None] * (t @ angle) / (t @ t)
            own = gyro**2 * inc_dt * len(angle) / 15
            found.append(np.sqrt(np.maximum((angle - trend).var(0) - own, 0.1 * own)))
    return np.median(found, 0) if found else np.zeros(3)
