"""Recognise the motion states of a run: the most probable sequence, not a verdict per sample.

Kinematics on a uniform grid -> likelihood of each state at 5 Hz -> hidden Markov model with a
minimum dwell and the changes of state the levers of table 1 allow -> Timeline.
Source: A1-A16 (Wu & Yin 2019, table 1 and section 2).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from graphnav.common.errors import SolutionError
from graphnav.common.run import Array
from graphnav.recognition.corrections import Correction, VehicleParams, correction_table
from graphnav.recognition.state_likelihood import (
    CORRELATION,
    HALF_WINDOW,
    NO_EVIDENCE,
    Moments,
    StateModel,
    change_likelihood,
    increment_likelihood,
    state_models,
    step_likelihood,
)
from graphnav.recognition.timeline import Names, Timeline, timeline_from_states
from graphnav.recognition.viterbi import Chain, most_probable, posterior

STEP = 0.2  # s between the model's steps
DWELL = 1.6  # s a state lasts at least
CUT_REACH = 0.5  # s a cut may move, so that two never meet
SD_CENTRIPETAL = 0.4  # m/s^2 of a_c that is not v_y phi_dot: vibration, side slip
SPEED_WANDER = 0.1  # m/s^2 at which an error of the inertial speed changes
CREEP = 0.3  # m/s of the odometer; slower, its noise is not that of driving
SD_SPEED_LEAST = 0.05  # m/s; no inertial speed is believed further

MEAN_DURATION = {
    "stop": 60.0,
    "straight_high": 40.0,
    "straight_low": 20.0,
    "moving": 120.0,
}
MEAN_TURN = 8.0  # s
IMPLAUSIBLE, RARE = 1e-4, 0.03  # weight of a change against a usual one
# Lever positions of table 1 (high side, low side; 0 foremost, 1 gear I, 2 gear II): a usual change
# moves one lever, or both together; anything else takes two separate motions.
USUAL_CHANGES = {
    "stop": "straight_high straight_low turn_arc turn_pivot turn_separated turn_separated_low "
    "turn_pivot_low turn_large moving",
    "straight_high": "straight_low turn_arc turn_pivot turn_separated turn_large",
    "straight_low": "turn_arc turn_separated_low turn_pivot_low turn_large",
    "turn_large": "turn_arc turn_pivot turn_separated turn_separated_low turn_pivot_low",
}
RARE_CHANGES = {
    "turn_separated": "turn_arc turn_pivot",
    "turn_arc": "turn_pivot turn_separated_low",
    "turn_separated_low": "turn_pivot_low",
}


@dataclass(frozen=True)
class Kinematics:
    """Motion of the vehicle point on a uniform grid (10 Hz); all arrays (N,).

    `v_y`, `sd_v_y`: forward speed from the inertial solution and its standard deviation, inf or
    NaN where unknown. A `v_y` that is the odometer itself says nothing: give it an infinite sd.
    """

    time: Array  # s
    v_y: Array  # m/s (A2, A5)
    sd_v_y: Array  # m/s
    v_o: Array  # m/s, odometer in nominal metres; NaN where none
    yaw_rate: Array  # rad/s, up positive, Earth rate removed (A3)
    a_c: Array  # m/s^2, A4: right positive, so -v_y phi_dot: negative in a left turn; NaN unknown
    at_standstill: NDArray[np.bool_]  # from a zero-velocity detector; may be all False
    accel_y: Array | None = None  # m/s^2, forward, gravity compensated


def recognise(
    kinematics: Kinematics,
    vehicle: VehicleParams,
    table: Mapping[str, Correction] | None = None,
) -> Timeline:
    """Timeline of motion states from the first to the last time of the kinematics.

    `table`: rows with learnt ground in place of the paper's priors (later rounds). Probabilities
    are left at 1: `with_probabilities` finds them once the timeline stands.
    Raises SolutionError when there are too few samples or their grid is not uniform.
    """
    chain, time, names = model_of(kinematics, vehicle, table)
    timeline = timeline_from_states(time, names[most_probable(chain)])
    timeline = timeline.covering(float(kinematics.time[0]), float(kinematics.time[-1]))
    return cut_at_half_turn(timeline, kinematics)


def with_probabilities(
    timeline: Timeline,
    kinematics: Kinematics,
    vehicle: VehicleParams,
    table: Mapping[str, Correction] | None = None,
) -> Timeline:
    """The timeline with each segment's state probability given all kinematics, averaged over it."""
    chain, time, names = model_of(kinematics, vehicle, table)
    probability = posterior(chain)
    segment = timeline.segment_at(time)
    column = np.array([int(np.flatnonzero(names == s)[0]) for s in timeline.state])
    decided = probability[np.arange(len(time)), column[segment]]
    count = np.bincount(segment, minlength=len(timeline))
    total = np.bincount(segment, decided, minlength=len(timeline))
    return replace(timeline, probability=np.where(count > 0, total / np.maximum(count, 1), 1.0))


def model_of(
    kinematics: Kinematics, vehicle: VehicleParams, table: Mapping[str, Correction] | None
) -> tuple[Chain, Array, Names]:
    """The hidden Markov model of a run, the times of its steps and the names of its states."""
    rows = dict(correction_table(vehicle) if table is None else table)
    models = state_models(vehicle, rows)
    time, moments = _moments(kinematics)
    names = np.array([model.correction.state for model in models])
    return _chain(moments, models, vehicle.track_gauge), time, names


def cut_at_half_turn(timeline: Timeline, kinematics: Kinematics) -> Timeline:
    """Move the cuts between turning and not to where the yaw rate is half that of the turn.

    There what a factor gets wrong in the ramp before and after the cut is equal and opposite.
    """
    if len(timeline) < 2:
        return timeline
    time, turning = kinematics.time, np.abs(kinematics.yaw_rate)
    segment = timeline.segment_at(time)
    steady = np.array([np.median(turning[segment == i]) for i in range(len(timeline))])
    turns = np.char.startswith(timeline.state, "turn")
    one_side = turns[1:] != turns[:-1]
    half = 0.5 * np.where(turns[1:], steady[1:], steady[:-1])
    reach = round(CUT_REACH / float(np.mean(np.diff(time))))
    near = np.searchsorted(time, timeline.boundaries)[:, None] + np.arange(-reach, reach + 1)
    near = np.clip(near, 1, len(time) - 2)
    rows = np.arange(len(near))
    best = near[rows, np.abs(turning[near] - half[:, None]).argmin(axis=1)]
    cuts = np.where(one_side, time[best], timeline.boundaries)
    return replace(
        timeline, start=np.r_[timeline.start[0], cuts], end=np.r_[cuts, timeline.end[-1]]
    )


def _moments(kinematics: Kinematics) -> tuple[Array, Moments]:
    """Smooth the kinematics over 0.3 s and take every STEP; forward made positive."""
    dt = _grid(kinematics.time)
    every = max(1, round(STEP / dt))
    taken = np.arange(every // 2, len(kinematics.time), every)

    def averaged(values: Array, seconds: float = 0.3) -> Array:
        return _averaged(values, max(1, round(seconds / dt)))

    v_o, yaw = averaged(kinematics.v_o), averaged(kinematics.yaw_rate)
    way = np.where(np.nan_to_num(v_o) < 0, -1.0, 1.0)  # reverse is driven like forward
    v_o, turning = np.abs(v_o), np.abs(yaw)
    speed, sd, correlation = _inertial_speed(kinematics, yaw, averaged)
    reach = round(HALF_WINDOW / dt)
    back = np.maximum(taken - reach, 0)
    ahead = np.minimum(taken + reach, len(v_o) - 1)
    velocity = np.full(len(v_o), np.nan)
    if kinematics.accel_y is not None:
        steps = 0.5 * dt * (kinematics.accel_y[1:] + kinematics.accel_y[:-1])
        velocity = averaged(np.r_[0.0, np.cumsum(steps)])
    return kinematics.time[taken], Moments(
        step=every * dt,
        speed=(speed * way)[taken],
        sd_speed=sd[taken],
        correlation=correlation[taken],
        odometer=v_o[taken],
        yaw_rate=turning[taken],
        turned=np.abs(averaged(kinematics.yaw_rate, 1.0))[taken],
        at_standstill=kinematics.at_standstill[taken],
        odometer_before=v_o[back],
        odometer_after=v_o[ahead],
        yaw_rate_before=turning[back],
        yaw_rate_after=turning[ahead],
        gained=(velocity[ahead] - velocity[back]) * way[taken],
        sd_change=_relative_noise(v_o, way * np.gradient(velocity), reach) * v_o[taken],
    )


def _grid(time: Array) -> float:
    """Step of a uniform grid, s. Raises SolutionError where it is none."""
    gaps = np.diff(time)
    if len(gaps) < 20 or np.ptp(gaps) > 0.1 * gaps.mean():
        raise SolutionError("motion states: need at least 2 s of kinematics on a uniform grid")
    return float(gaps.mean())


def _averaged(values: Array, size: int) -> Array:
    """Means of `size` samples about each that is a number, of those that are."""
    valid = np.isfinite(values)
    share = uniform_filter1d(valid.astype(np.float64), size, mode="nearest")
    total = uniform_filter1d(np.where(valid, values, 0.0), size, mode="nearest")
    return np.where(valid, total / np.where(valid, share, 1.0), np.nan)


def _relative_noise(v_o: Array, gaining: Array, reach: int) -> float:
    """Noise of the odometer's change over a window, as a share of its speed: by how much two
    changes that follow each other differ when the accelerometer's share is taken off. What pulses,
    stamps and slip make of a speed grows with it. `gaining`: m/s a step, NaN where unknown.
    """
    windows = [slice(None, -4 * reach), slice(2 * reach, -2 * reach), slice(4 * reach, None)]
    before, now, after = (v_o[window] for window in windows)
    gained = np.cumsum(np.nan_to_num(gaining))
    bend = after - 2 * now + before
    bend -= gained[windows[2]] - 2 * gained[windows[1]] + gained[windows[0]]
    seen = np.isfinite(bend) & (now > CREEP)
    share = np.abs(bend[seen]) / now[seen]
    return 1.4826 * float(np.median(share)) / np.sqrt(3.0) if len(share) else 0.0


def _inertial_speed(
    kinematics: Kinematics, yaw_rate: Array, smooth: Callable[..., Array]
) -> tuple[Array, Array, Array]:
    """Speed from `v_y` (A2) and in turns from `-a_c / phi_dot` (A4), its sd, m/s; how long, s, its
    error persists: an inertial error of 1 m/s needs 10 s to wander by itself.
    """
    sd = np.maximum(kinematics.sd_v_y, SD_SPEED_LEAST)
    known = np.isfinite(sd) & np.isfinite(kinematics.v_y)
    weight = np.where(known, sd, NO_EVIDENCE) ** -2.0
    a_c = smooth(kinematics.a_c, 0.6)
    push = np.where(np.isfinite(a_c), yaw_rate, 0.0) / SD_CENTRIPETAL**2
    total = weight + push * yaw_rate
    speed = (weight * np.where(known, kinematics.v_y, 0.0) - push * np.nan_to_num(a_c)) / total
    persistence = np.where(known, weight / total * sd / SPEED_WANDER, 0.0)
    return speed, total**-0.5, CORRELATION + persistence


def _chain(moments: Moments, models: tuple[StateModel, ...], gauge: float) -> Chain:
    """The hidden Markov model of these moments."""
    names = [model.correction.state for model in models]
    leave = np.array([moments.step / MEAN_DURATION.get(name, MEAN_TURN) for name in names])
    weight = np.full((len(names), len(names)), IMPLAUSIBLE)
    for changes, value in ((RARE_CHANGES, RARE), (USUAL_CHANGES, 1.0)):
        for one, others in changes.items():
            for other in others.split():
                if one in names and other in names:
                    i, j = names.index(one), names.index(other)
                    weight[i, j] = weight[j, i] = value
    np.fill_diagonal(weight, 0.0)
    weight *= (leave / weight.sum(axis=1))[:, None]
    with np.errstate(divide="ignore"):
        change = np.log(weight)
    increments = increment_likelihood(moments, models, gauge)
    return Chain(
        likelihood=step_likelihood(moments, models, increments, gauge),
        change=change + change_likelihood(moments, models, increments, gauge),
        stay=np.log1p(-leave),
        initial=np.full(len(names), -np.log(len(names))),
        dwell=max(1, round(DWELL / moments.step)),
    )
