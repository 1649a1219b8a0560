"""Episodes from weights: bridged, told once, small ones and starts left out."""

import numpy as np
import pytest

from graphnav.common.run import Array
from graphnav.result.events import Event, events

END = np.arange(1.0, 101.0)
DURATION = np.ones(100)
NO_STANDSTILL = np.zeros((0, 2))


def found(
    spans: list[tuple[int, int]], row: int, peak: float, standstills: Array = NO_STANDSTILL
) -> list[Event]:
    """Events of intervals [a, b) of one axis doubted, with `peak` m/s in their middle."""
    weight, slip = np.ones((100, 3)), np.zeros((100, 3))
    for a, b in spans:
        weight[a:b, row] = 0.0
        slip[(a + b) // 2, row] = peak
    return events(END, weight, slip, DURATION, standstills.ravel())


@pytest.mark.parametrize(
    ("row", "peak", "kind", "axis"),
    [
        (0, 2.0, "side_slip", "x"),
        (0, -2.0, "side_slip", "x"),
        (1, 2.0, "wheel_spin", "y"),
        (1, -2.0, "wheel_lock", "y"),
        (2, -1.0, "hop", "z"),
    ],
)
def test_axis_and_sign_name_the_kind(row: int, peak: float, kind: str, axis: str) -> None:
    assert found([(40, 45)], row, peak) == [Event(40.0, 45.0, kind, axis, peak)]


def test_short_pauses_are_bridged_long_ones_not() -> None:
    assert [(e.start, e.end) for e in found([(10, 12), (14, 16)], 0, 1.0)] == [(10, 16)]
    assert [(e.start, e.end) for e in found([(10, 12), (15, 16)], 0, 1.0)] == [(10, 12), (15, 16)]


def test_what_moves_nobody_is_no_episode() -> None:
    assert not found([(10, 15)], 0, 0.2)


def test_clean_data_have_no_episodes() -> None:
    assert not found([], 0, 0.0)


def test_odometer_may_stutter_when_starting_and_stopping() -> None:
    standstills = np.array([[20.0, 30.0]])
    assert not found([(19, 20)], 1, 1.0, standstills)
    assert not found([(30, 31)], 1, 1.0, standstills)
    assert found([(19, 20)], 0, 1.0, standstills)  # sideways it may not
    assert found([(50, 51)], 1, 1.0, standstills)


def test_axes_are_told_in_order_of_time() -> None:
    weight, slip = np.ones((100, 3)), np.zeros((100, 3))
    for row, start in ((0, 60), (2, 20)):
        weight[start : start + 3, row] = 0
        slip[start : start + 3, row] = 1.0
    found = events(END, weight, slip, DURATION, NO_STANDSTILL.ravel())
    assert [e.kind for e in found] == ["hop", "side_slip"]
