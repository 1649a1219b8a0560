"""Where nodes stand: always at events, near fixes, once a second, few at rest."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graphnav.common.run import Array
from graphnav.graph.nodes import (
    CLOSEST_S,
    Schedule,
    first_in_slot,
    near_fixes,
    nearest_node,
    next_node,
    place_nodes,
    segment_middle,
)

EDGES = np.arange(2001) * 0.05  # 100 s at 20 Hz
NONE = np.zeros(0)
NO_STANDSTILL = np.zeros((0, 2))
times = st.lists(st.floats(0, 100), max_size=20).map(np.array)


def spans(a: float, b: float) -> Array:
    """One rest."""
    return np.array([[a, b]])


def walked(by: Schedule) -> list[int]:
    """Edges of the nodes from the first on, until one is open."""
    found = [0]
    while found[-1] < len(by.edge) - 1 and (node := next_node(found[-1], by)) is not None:
        found.append(node)
    return found


def as_heard(edge: Array, span: tuple[float, float], fixes: Array, judged: int) -> Schedule:
    """What a stream knows of one rest when so many increments are judged."""
    at_standstill = ((edge[:-1] > span[0]) & (edge[:-1] < span[1]))[:judged].astype(float)
    events = (np.flatnonzero(np.diff(at_standstill)) + 1).tolist()
    return Schedule(edge, judged, events, fixes, at_standstill, 0.0, 1.0)


def test_a_stream_places_nodes_at_rests_fixes_and_seconds() -> None:
    edge, fixes = np.arange(0, 40, 0.05), np.array([2.4, 3.3, 15.0])
    nodes = walked(as_heard(edge, (10.3, 25.7), fixes, len(edge) - 1))
    near = [0, 1, 2, 2.4, 3, 3.3, 4, 5, 6, 7, 8, 9, 10, 10.35, 20.35, 25.7, 26]
    np.testing.assert_allclose(edge[nodes[: len(near)]], near, atol=0.051)
    assert np.diff(edge[nodes]).max() < 10.06


@given(st.integers(100, 798), times)
def test_with_less_heard_the_same_nodes_as_far_as_they_are_known(judged: int, at: Array) -> None:
    edge, fixes = np.arange(0, 40, 0.05), np.sort(at)
    whole = walked(as_heard(edge, (10.3, 25.7), fixes, len(edge) - 1))
    part = walked(as_heard(edge, (10.3, 25.7), fixes, judged))
    assert part == whole[: len(part)]
    assert part[-1] >= judged - 10.05 / 0.05


def test_a_stream_places_nodes_as_close_as_told() -> None:
    edge = np.arange(0, 20, 0.05)
    by = replace(as_heard(edge, (30, 30), np.array([3.33]), len(edge) - 1), interval=0.1)
    step = np.diff(edge[walked(by)])
    assert len(step) > 190 and step.max() < 0.151 and step.min() > 0.049


@given(times, times)
def test_batch_and_stream_differ_only_where_a_node_gives_way(events: Array, fixes: Array) -> None:
    aids = near_fixes(np.sort(fixes))
    at = np.unique([*np.rint(events / 0.05).astype(int), 2000])
    nodes = place_nodes(EDGES, EDGES[at], aids, NO_STANDSTILL)
    by = Schedule(EDGES, 2001, at.tolist(), aids, np.zeros(2000), 0.0, 1.0)
    assert walked(replace(by, ahead=CLOSEST_S)) == nodes.edge.tolist()
    for edge in np.setdiff1d(walked(by), nodes.edge):
        late = (EDGES[at[at > edge]] - EDGES[edge]).min()
        assert 0 < late < 2 * CLOSEST_S


def test_fixes_in_pieces_ask_for_the_same_nodes() -> None:
    time = np.sort(np.random.default_rng(3).uniform(0, 30, 200))
    asked = np.zeros(0)
    for part in np.array_split(time, [1, 2, 90, 91]):
        asked = np.append(asked, part[first_in_slot(part, asked[-1:])])
    np.testing.assert_array_equal(asked, near_fixes(time))


def test_once_a_second() -> None:
    nodes = place_nodes(EDGES, NONE, NONE, NO_STANDSTILL)
    np.testing.assert_allclose(nodes.time, np.arange(101), atol=1e-9)


@given(times, times)
def test_nodes_grow_and_span_the_run(events: Array, fixes: Array) -> None:
    nodes = place_nodes(EDGES, events, fixes, NO_STANDSTILL)
    assert (np.diff(nodes.edge) > 0).all()
    assert nodes.edge[0] == 0
    assert nodes.edge[-1] == len(EDGES) - 1
    np.testing.assert_array_equal(nodes.time, EDGES[nodes.edge])
    assert np.diff(nodes.time).max() <= 1 + 2 * CLOSEST_S


@given(times)
def test_every_event_has_its_node(events: Array) -> None:
    nodes = place_nodes(EDGES, events, NONE, NO_STANDSTILL)
    for event in events:
        assert np.abs(nodes.time - event).min() <= 0.025 + 1e-9


@given(times)
def test_every_fix_has_a_node_near(fixes: Array) -> None:
    nodes = place_nodes(EDGES, NONE, fixes, NO_STANDSTILL)
    _, late = nearest_node(nodes, fixes)
    assert (np.abs(late) <= CLOSEST_S + 0.025 + 1e-9).all()


@given(times, times)
def test_only_events_stand_close_together(events: Array, fixes: Array) -> None:
    nodes = place_nodes(EDGES, events, fixes, NO_STANDSTILL)
    at_event = np.isin(nodes.edge, place_nodes(EDGES, events, NONE, spans(0, 100)).edge)
    close = np.diff(nodes.time) < CLOSEST_S / 2
    assert (at_event[:-1] | at_event[1:])[close].all()


def test_a_rest_has_few_nodes() -> None:
    nodes = place_nodes(EDGES, np.array([20.0, 70.0]), NONE, spans(20, 70))
    inside = (nodes.time > 20) & (nodes.time < 70)
    assert inside.sum() == 4
    assert {20.0, 70.0} <= set(np.round(nodes.time, 6))


@given(times)
def test_calibration_segments_follow_one_another(events: Array) -> None:
    nodes = place_nodes(EDGES, events, NONE, NO_STANDSTILL)
    assert len(nodes.segment) == len(nodes.time) - 1
    assert nodes.segment[0] == 0
    assert set(np.diff(nodes.segment)) <= {0, 1}
    assert nodes.segment[-1] == len(nodes.segment_time) - 1 == 9
    assert (np.diff(nodes.segment_time) > 0).all()


@given(times)
def test_nearest_node_is_the_nearest(when: Array) -> None:
    nodes = place_nodes(EDGES, NONE, NONE, NO_STANDSTILL)
    index, late = nearest_node(nodes, when)
    for t, i, dt in zip(when, index, late, strict=True):
        assert abs(dt) <= np.abs(nodes.time - t).min() + 1e-12
        assert nodes.time[i] + dt == np.float64(t) or abs(nodes.time[i] + dt - t) < 1e-12


@pytest.mark.parametrize(("ahead", "node"), [(0.0, 20), (0.25, 23)])
def test_a_grid_node_gives_way_to_an_event_known_ahead(ahead: float, node: int) -> None:
    """The grid asks for 1.0 s, an event stands at 1.15 s."""
    edge = 0.05 * np.arange(60)
    by = Schedule(edge, 50, [23], NONE, np.zeros(59), 0.0, 1.0, ahead)
    assert next_node(0, by) == node


def test_a_segment_in_force_is_the_one_whose_middle_is_nearest() -> None:
    begun = np.array([100.0, 109.9, 110.0, 125.0])
    np.testing.assert_allclose(segment_middle(begun, 100.0), [105.0, 105.0, 115.0, 125.0])
