"""Timelines that tell of another gear: what else may have been driven.

A straight in high gear and one in low gear look alike but for what the accelerometers made of the
speed when it began; turns and pivots follow the straights they lie between.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array
from graphnav.recognition.corrections import VehicleParams
from graphnav.recognition.motion_states import Kinematics, cut_at_half_turn, model_of
from graphnav.recognition.timeline import Names, Timeline, timeline_from_states
from graphnav.recognition.viterbi import most_probable

STRAIGHTS = ("straight_high", "straight_low")
LEAST_S = 3.0  # a shorter straight hardly moves the path
LONG_S = 40.0
REACH_S = 20.0  # by which the gear changes at the ends of a straight may be misplaced
EDGE = 0.4  # of a straight, at either end, that need not change with it
EXCLUDED = -1e3  # log likelihood


def straights(timeline: Timeline) -> list[int]:
    """Segments whose gear may be doubted."""
    doubted = np.isin(timeline.state, STRAIGHTS) & (timeline.duration > LEAST_S)
    return [int(k) for k in np.flatnonzero(doubted)]


def apart(timeline: Timeline, segments: Sequence[int], least: float) -> list[list[int]]:
    """The segments in groups whose members lie more than `least` s apart; long ones alone: by their
    weight they would teach the ground to fit them.
    """
    groups: list[list[int]] = []
    for k in segments:
        for group in groups:
            long = max(timeline.duration[[k, group[-1]]]) > LONG_S
            if not long and timeline.start[k] - timeline.end[group[-1]] > least:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def other_gear(
    timeline: Timeline, kinematics: Kinematics, vehicle: VehicleParams, doubted: Sequence[int]
) -> Timeline:
    """The most probable timeline in which segments `doubted` are driven in the other gear.

    Further than `REACH_S` from them, and while the vehicle stands, all stays as it is. Give
    kinematics whose speed is not known: a smoothed speed has followed the gear that is doubted.
    """
    chain, time, names = model_of(kinematics, vehicle, None)
    now = timeline.state_at(time)
    free = np.zeros(len(time), bool)
    likelihood = chain.likelihood.copy()
    for k in doubted:
        start, end = timeline.start[k], timeline.end[k]
        free |= (time > start - REACH_S) & (time < end + REACH_S)
        edge = EDGE * (end - start)
        core = (time > start + edge) & (time < end - edge)
        likelihood[np.ix_(core, _geared(names, str(timeline.state[k])))] += EXCLUDED
    stands = (now == "stop")[:, None] != (names == "stop")
    kept = np.where(free[:, None], stands, now[:, None] != names)
    likelihood[kept] += 2 * EXCLUDED
    path = names[most_probable(replace(chain, likelihood=likelihood))]
    found = timeline_from_states(time, path)
    found = found.covering(float(timeline.start[0]), float(timeline.end[-1]))
    return cut_at_half_turn(found, kinematics)


def spliced(now: Timeline, other: Timeline, spans: Array) -> Timeline:
    """The timeline `now` with that of `other` inside `spans` (K, 2) s."""
    ends = np.unique(np.concatenate([now.start, now.end, other.boundaries, spans.ravel()]))
    ends = ends[(ends >= now.start[0]) & (ends <= now.end[-1])]
    middle = 0.5 * (ends[1:] + ends[:-1])
    inside = ((middle[:, None] > spans[:, 0]) & (middle[:, None] < spans[:, 1])).any(axis=1)
    state = np.where(inside, other.state_at(middle), now.state_at(middle))
    first = np.flatnonzero(np.r_[True, state[1:] != state[:-1]])
    cuts = ends[first[1:]]
    start, end = np.r_[now.start[0], cuts], np.r_[cuts, now.end[-1]]
    return Timeline(start, end, state[first], np.ones(len(first)))


def _geared(names: Names, state: str) -> NDArray[np.bool_]:
    """Which of the states (S,) share the gear of one."""
    low = np.char.endswith(names, "_low")
    return np.asarray(low == state.endswith("_low"))
