"""Fixes as they are: late, at rest, between nodes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from factors import so3
from factors.calibration import Component, Layout
from factors.estimate import Estimate
from factors.position import Fixes, position
from factors.preintegration import Increments, InertialNoise, preintegrate
from graphnav.common.run import Run
from graphnav.graph.nodes import Nodes
from graphnav.graph.satellite_fixes import between, carry
from graphnav.inertial.fix_delay import found_delay
from graphnav.inertial.increments import increments
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate

SIZES = {"antenna": 3, "gnss_offset": 3, "gnss_delay": 1}
LAYOUT = Layout(tuple(Component(name, np.zeros(d), np.ones(d)) for name, d in SIZES.items()))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("f") / "run"
    simulate("wheeled", out, 31, duration=300, grade="tactical", gnss=True)
    path = out / "run.csv.gz"
    return read_run(path, load_vehicle(None, path))


@pytest.mark.parametrize("delay", [0.0, 0.1, -3.0, 5.0, 18.0])
def test_a_delay_is_found_before_the_solve(run: Run, delay: float) -> None:
    assert run.imu is not None and run.gnss is not None
    late = replace(run.gnss, time=run.gnss.time + delay)
    found = found_delay(increments(run.imu), run.odometer, late)
    # a small one is the graph's, as one more calibration
    assert found == pytest.approx(delay if abs(delay) > 0.3 else 0.0, abs=0.5)


def test_turns_alone_tell_a_long_delay(run: Run) -> None:
    assert run.imu is not None and run.gnss is not None
    late = replace(run.gnss, time=run.gnss.time + 18.0)
    assert found_delay(increments(run.imu), None, late) == pytest.approx(18.0, abs=1.0)


def test_a_long_rest_makes_no_delay(tmp_path: Path) -> None:
    """The odometer explains the fixes without a delay: turns alone, which fit 13 s by chance, are
    not asked, however long the vehicle stood."""
    out = tmp_path / "run"
    simulate("field-tracked", out, 48, duration=400, gnss=True)
    path = out / "run.csv.gz"
    run = read_run(path, load_vehicle(None, path))
    assert run.imu is not None and run.gnss is not None
    assert found_delay(increments(run.imu), run.odometer, run.gnss) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_fixes_are_carried_to_their_time(seed: int) -> None:
    """A body that swings and turns, sampled at 1 kHz; fixes late by 0.1 s, anywhere between nodes.

    What is left is the cubic of the numbers: a millimetre and less, where a second of straight
    flight from the nearest node would miss by 2 m.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0, 3.0005, 1e-3)
    phase, far = rng.uniform(0, 6, 3), rng.uniform(1, 3, 3)

    def place(time: np.ndarray) -> np.ndarray:
        return far * np.sin(1.5 * time[:, None] + phase) + time[:, None] * [5, 3, 0.1]

    spin = rng.normal(size=3)
    R = so3.exp(t[:, None] * spin)
    velocity_n = np.gradient(place(t), t, axis=0, edge_order=2)
    force = so3.mtv(R, np.gradient(velocity_n, t, axis=0, edge_order=2))
    force = 0.5 * (force[1:] + so3.mv(so3.exp(1e-3 * spin)[None], force[1:])) * 1e-3
    inc = Increments(t, np.tile(1e-3 * spin, (3000, 1)), force, 5e-4 * force, np.zeros(3000))
    edge = np.array([0, 1000, 2000, 3000])
    pre = preintegrate(inc, edge, np.zeros((3, 12)), InertialNoise(1e-5, 1e-3))
    true, lever, delay = np.array([0.2, 0.5, 1.37, 2.0, 2.93]), rng.normal(size=3), 0.1
    nodes = Nodes(edge, t[edge], np.zeros(3, np.int64), np.array([1.5]))
    on, scope_ = between(nodes, true)
    carried = carry(inc, pre, nodes, scope_)
    assert len(on) == 5
    fix = place(true) + so3.mv(so3.exp(true[:, None] * spin), lever)
    fixes = Fixes(fix, np.ones((5, 3)), carried, delay)
    c = np.zeros((1, LAYOUT.dim))
    c[0, LAYOUT.slices["antenna"]], c[0, LAYOUT.column("gnss_delay")] = lever, delay
    x = Estimate(R[edge], velocity_n[edge], place(t[edge]), np.zeros(4), c)
    assert np.abs(position(fixes, LAYOUT, scope_, x).residual).max() < 2e-3
    c[0, LAYOUT.column("gnss_delay")] += 1e-3  # a later stamp: the fix belongs further back
    slid = position(fixes, LAYOUT, scope_, x).residual * 1e3
    ahead = place(true + 1e-3) + so3.mv(so3.exp((true + 1e-3)[:, None] * spin), lever)
    np.testing.assert_allclose(slid, -1e3 * (ahead - fix), atol=0.05)
