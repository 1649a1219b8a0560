"""Gears doubted: other timelines, what the factors make of them, what is left open."""

from dataclasses import replace

import numpy as np
import pytest

from factors import kinds
from factors.block import Block
from factors.estimate import Estimate
from graphnav.batch.gears import Unclear, contested, remarks, widened
from graphnav.common.run import Array
from graphnav.graph.elimination import Covariances
from graphnav.graph.noise import Scales
from graphnav.graph.robust_schedule import FINAL
from graphnav.graph.solve import Solution
from graphnav.recognition.corrections import VehicleParams
from graphnav.recognition.gears import apart, other_gear, spliced, straights
from graphnav.recognition.motion_states import Kinematics
from graphnav.recognition.timeline import Timeline

TRACKED = VehicleParams("tracked")
CUTS = np.array([0.0, 40.0, 70.0, 100.0, 200.0, 240.0])
STATES = np.array(["stop", "straight_high", "stop", "straight_high", "stop"])
DRIVEN = Timeline(CUTS[:-1], CUTS[1:], STATES, np.ones(5))


def driving() -> Kinematics:
    """Two straights between stops, of which nothing tells the gear."""
    time = np.arange(0.0, 240.0, 0.1)
    moving = DRIVEN.state_at(time) != "stop"
    v_o, none = np.where(moving, 3.0, 0.0), np.zeros(len(time))
    return Kinematics(time, v_o, none + np.inf, v_o, none, none * np.nan, ~moving, none * np.nan)


def test_the_other_gear_is_taken_where_it_is_doubted_and_nowhere_else() -> None:
    found = other_gear(DRIVEN, driving(), TRACKED, [1])
    assert found.state.tolist() == ["stop", "straight_low", "stop", "straight_high", "stop"]
    np.testing.assert_allclose(found.boundaries, DRIVEN.boundaries, atol=1.0)


def test_long_straights_are_tried_alone() -> None:
    assert straights(DRIVEN) == [1, 3]
    assert apart(DRIVEN, [1, 3], 20.0) == [[1], [3]]
    short = replace(DRIVEN, start=CUTS[:-1] - [0, 0, 0, 0, 80], end=CUTS[1:] - [0, 0, 0, 80, 80])
    assert apart(short, [1, 3], 20.0) == [[1, 3]]
    assert apart(short, [1, 3], 40.0) == [[1], [3]]


def test_a_splice_takes_the_other_timeline_inside_its_span() -> None:
    low = replace(DRIVEN, state=np.char.replace(DRIVEN.state, "high", "low"))
    found = spliced(DRIVEN, low, np.array([[60.0, 150.0]]))
    states = found.state_at(np.array([50.0, 65.0, 85.0, 149.0, 151.0, 220.0]))
    gear = ["high", "low", "", "low", "high", ""]
    assert [str(state).partition("_")[2] for state in states] == gear


def at(shift: float) -> Estimate:
    """Three nodes moved north."""
    p_n = np.array([[0.0, 0.0, 0.0], [0.0, shift, 0.0], [0.0, 2 * shift, 0.0]])
    return Estimate(
        np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)), p_n, np.zeros(3), np.zeros((1, 1))
    )


@pytest.mark.parametrize(("residual", "changed", "unclear"), [(5.0, True, 0), (0.0, False, 2)])
def test_the_gear_that_costs_less_is_taken(residual: float, changed: bool, unclear: int) -> None:
    """The accelerometers know the first straight for a low one by `residual`, or know nothing."""

    def attempt(timeline: Timeline, scales: Scales) -> tuple[Solution, Estimate]:
        high = timeline.state_at(np.array([55.0]))[0] == "straight_high"
        off = np.array([[residual if high else 0.0]])
        block = Block(kinds.INERTIAL, ("v_y",), np.array([55.0]), off, ())
        return Solution(at(0), [block], [], None, 1, 0.0), at(0.0 if high else 5.0)

    found = contested(DRIVEN, driving(), TRACKED, {}, attempt, FINAL)
    assert found.changed is changed and len(found.unclear) == unclear
    first = "straight_low" if changed else "straight_high"
    assert found.timeline.state_at(np.array([55.0, 150.0])).tolist() == [first, "straight_high"]


def test_what_is_not_certain_widens_the_deviations_as_far_as_it_moves_the_path() -> None:
    moved = np.zeros((3, 9))
    moved[:, 7] = [0.0, 5.0, 10.0]
    one = Unclear(10.0, 20.0, 0.25, moved)
    found = widened(Covariances(np.zeros((3, 10, 10)), np.zeros((1, 1, 1)), {}), (one,))
    north: Array = found.nodes[:, 7, 7]
    np.testing.assert_allclose(np.sqrt(north), [0.0, 2.5, 5.0])  # p d^2
    said = remarks((one, replace(one, probability=0.01)), 100.0)
    assert len(said) == 1 and "from 110 to 120 s is not certain" in said[0].why
