"""The dense path hits the nodes exactly and is smooth between them."""

import numpy as np
import pytest

from factors import so3
from factors.estimate import Estimate
from factors.preintegration import Increments, InertialNoise, Preintegrated, preintegrate
from graphnav.common.earth import Origin
from graphnav.graph.densify import Path, densify
from graphnav.graph.nodes import Nodes, place_nodes
from graphnav.inertial.reckoning import inertial_path

ORIGIN = Origin(0.7, 2.0, 60.0)
NONE = np.zeros(0)


def drive() -> tuple[Increments, Nodes, Preintegrated, Estimate]:
    """20 s of a bend, with the states an inertial navigation gives at the nodes."""
    count = 400
    edge = np.arange(count + 1) * 0.05
    t = edge[:-1]
    rotation = 0.05 * np.stack([0.02 * np.sin(t), 0.02 * np.cos(t), 0.3 + 0 * t], -1)
    velocity = 0.05 * np.stack([-2 + 0 * t, np.sin(t / 3), 9.8 + 0 * t], -1)
    inc = Increments(edge, rotation, velocity, velocity * 0.025, np.zeros(count))
    nodes = place_nodes(edge, np.array([3.3, 7.75]), NONE, np.zeros((0, 2)))
    n = len(nodes.time)
    pre = preintegrate(inc, nodes.edge, np.zeros((n - 1, 12)), InertialNoise(1e-5, 1e-4))
    start = so3.exp(np.array([0.05, -0.03, 0.4])), np.array([1.0, 8.0, 0.2])
    R, v, p = inertial_path(pre, *start, ORIGIN, np.eye(3), held=False)
    return inc, nodes, pre, Estimate(R, v, p, np.zeros(n), np.zeros((1, 12)))


def moved(estimate: Estimate, size: float) -> Estimate:
    """Nodes corrected by some smoother."""
    change = size * np.random.default_rng(2).normal(size=(len(estimate.v_n), 10))
    return estimate.retract(change, np.zeros((1, 12)))


@pytest.mark.parametrize("size", [0.0, 0.01, 0.3])
def test_path_hits_every_node(size: float) -> None:
    inc, nodes, pre, estimate = drive()
    estimate = moved(estimate, size)
    path = densify(inc, pre, nodes, estimate, ORIGIN)
    np.testing.assert_allclose(path.p_n[nodes.edge], estimate.p_n, atol=1e-9)
    np.testing.assert_allclose(path.v_n[nodes.edge], estimate.v_n, atol=1e-9)
    np.testing.assert_allclose(path.R_nb[nodes.edge], estimate.R_nb, atol=1e-9)


def test_nodes_of_an_inertial_navigation_leave_nothing_to_spread() -> None:
    """Dense nodes and sparse ones then lie on one path."""
    inc, nodes, pre, estimate = drive()
    path = densify(inc, pre, nodes, estimate, ORIGIN)
    every = np.arange(len(inc.edge))
    fine = preintegrate(inc, every, np.zeros((len(every) - 1, 12)), InertialNoise(1e-5, 1e-4))
    start = estimate.R_nb[0], estimate.v_n[0]
    R, v, p = inertial_path(fine, *start, ORIGIN, np.eye(3), held=False)
    np.testing.assert_allclose(path.p_n, p, atol=1e-4)
    np.testing.assert_allclose(path.v_n, v, atol=1e-5)
    np.testing.assert_allclose(path.R_nb, R, atol=1e-9)


def test_velocity_is_the_derivative_of_position_across_nodes() -> None:
    inc, nodes, pre, estimate = drive()
    path = densify(inc, pre, nodes, moved(estimate, 0.02), ORIGIN)
    stepped = np.diff(path.p_n, axis=0) / 0.05
    np.testing.assert_allclose(stepped, (path.v_n[1:] + path.v_n[:-1]) / 2, atol=0.02)


def test_path_at_its_own_times_is_itself_and_hermite_between() -> None:
    t = np.linspace(0, 2, 21)
    p_n = np.stack([t**3, t**2, t], -1)  # a cubic is its own Hermite interpolation
    v_n = np.stack([3 * t**2, 2 * t, 1 + 0 * t], -1)
    R = so3.exp(np.stack([0 * t, 0 * t, 0.5 * t], -1))
    path = Path(t, R, v_n, p_n)
    for found, own in zip(path.at(t), (R, v_n, p_n), strict=True):
        np.testing.assert_allclose(found, own, atol=1e-12)
    when = np.array([0.03, 0.77, 1.99])
    R_w, _, p_w = path.at(when)
    np.testing.assert_allclose(p_w, np.stack([when**3, when**2, when], -1), atol=1e-12)
    np.testing.assert_allclose(so3.log(R_w)[:, 2], 0.5 * when, atol=1e-12)
