"""Where nodes stand: always at events, near fixes, once a second, few at rest."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from graphnav.common.run import Array
from graphnav.graph.nodes import CLOSEST_S, nearest_node, place_nodes

EDGES = np.arange(2001) * 0.05  # 100 s at 20 Hz
NONE = np.zeros(0)
NO_RESTS = np.zeros((0, 2))
times = st.lists(st.floats(0, 100), max_size=20).map(np.array)


def spans(a: float, b: float) -> Array:
    """One rest."""
    return np.array([[a, b]])


def test_once_a_second() -> None:
    nodes = place_nodes(EDGES, NONE, NONE, NO_RESTS)
    np.testing.assert_allclose(nodes.time, np.arange(101), atol=1e-9)


@given(times, times)
def test_nodes_grow_and_span_the_run(events: Array, fixes: Array) -> None:
    nodes = place_nodes(EDGES, events, fixes, NO_RESTS)
    assert (np.diff(nodes.edge) > 0).all()
    assert nodes.edge[0] == 0
    assert nodes.edge[-1] == len(EDGES) - 1
    np.testing.assert_array_equal(nodes.time, EDGES[nodes.edge])
    assert np.diff(nodes.time).max() <= 1 + 2 * CLOSEST_S


@given(times)
def test_every_event_has_its_node(events: Array) -> None:
    nodes = place_nodes(EDGES, events, NONE, NO_RESTS)
    for event in events:
        assert np.abs(nodes.time - event).min() <= 0.025 + 1e-9


@given(times)
def test_every_fix_has_a_node_near(fixes: Array) -> None:
    nodes = place_nodes(EDGES, NONE, fixes, NO_RESTS)
    _, late = nearest_node(nodes, fixes)
    assert (np.abs(late) <= CLOSEST_S + 0.025 + 1e-9).all()


@given(times, times)
def test_only_events_stand_close_together(events: Array, fixes: Array) -> None:
    nodes = place_nodes(EDGES, events, fixes, NO_RESTS)
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
    nodes = place_nodes(EDGES, events, NONE, NO_RESTS)
    assert len(nodes.segment) == len(nodes.time) - 1
    assert nodes.segment[0] == 0
    assert set(np.diff(nodes.segment)) <= {0, 1}
    assert nodes.segment[-1] == len(nodes.segment_time) - 1 == 9
    assert (np.diff(nodes.segment_time) > 0).all()


@given(times)
def test_nearest_node_is_the_nearest(when: Array) -> None:
    nodes = place_nodes(EDGES, NONE, NONE, NO_RESTS)
    index, late = nearest_node(nodes, when)
    for t, i, dt in zip(when, index, late, strict=True):
        assert abs(dt) <= np.abs(nodes.time - t).min() + 1e-12
        assert nodes.time[i] + dt == np.float64(t) or abs(nodes.time[i] + dt - t) < 1e-12
