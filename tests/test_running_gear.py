"""How the running gear's readings become factors: their noise, their clock, their segment."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import VEHICLE, driven, saved

from factors import kinds
from factors.block import NODE_DIM, Block, Term
from factors.calibration import DELAY, LEVER, Component, Layout, walk
from factors.displacement import phase_prior
from factors.estimate import Estimate
from graphnav.batch.first_path import first_path
from graphnav.graph.assembly import stacked
from graphnav.graph.motion_noise import STAMP_S
from graphnav.graph.nodes import Nodes, place_nodes
from graphnav.graph.preparation import Prepared, prepare
from graphnav.graph.problem import build
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.recognition.timeline import Timeline

NONE = np.zeros(0)
NO_STANDSTILL = np.zeros((0, 2))


def prepared(table: pd.DataFrame, directory: Path, vehicle: str = VEHICLE) -> Prepared:
    path = saved(table, directory, vehicle)
    described = load_vehicle(None, path)
    return prepare(read_run(path, described), described, use_gnss=False, outages=())


def blocks_of(prep: Prepared, nodes: Nodes) -> dict[str, Block]:
    """All blocks of a run that is moving throughout, by kind, at dead reckoning."""
    at = first_path(prep, nodes).estimate
    whole = Timeline(nodes.time[:1], nodes.time[-1:], np.array(["moving"]), np.ones(1))
    return {b.kind: b for b in build(prep, nodes, whole, at, {}).linearise(at)}


def cruising() -> pd.DataFrame:
    """Straight on at 10 m/s."""
    table = driven(60.0)
    seen = table["odo_speed"].notna()
    table[["gyro_x", "gyro_y", "gyro_z"]] = 0.0
    table[["accel_x", "accel_y"]] = 1e-6  # zero throughout is not recorded
    table["accel_z"] = 9.8
    table.loc[seen, "odo_speed"] = 10.0
    return table


def sigmas(prep: Prepared, kind: str, intervals: tuple[float, ...]) -> list[np.ndarray]:
    """Usual sigma by axis of a kind of block with nodes every so many s."""
    found = []
    for interval in intervals:
        nodes = place_nodes(prep.sensed.inc.edge, NONE, NONE, NO_STANDSTILL, interval)
        block = blocks_of(prep, nodes)[kind]
        assert block.sigma is not None
        found.append(np.median(block.sigma, axis=0))
    return found


def test_errors_of_a_displacement_grow_with_the_root_of_time(tmp_path: Path) -> None:
    """They are white: four intervals know as much as the one that spans them, but for the times at
    which the odometer was read.
    """
    late = np.array([0.0, STAMP_S * 10.0, 0.0])
    both = sigmas(prepared(cruising(), tmp_path), kinds.DISPLACEMENT, (1.0, 4.0))
    one, four = (np.sqrt(sigma**2 - late**2) for sigma in both)
    np.testing.assert_allclose(four / one, 2.0, rtol=0.05)


def test_a_count_read_late_is_off_by_the_way_of_that_time(tmp_path: Path) -> None:
    """Over a second or four: what the odometer's clock is off does not add up."""
    slow, fast = cruising(), cruising()
    fast["odo_speed"] *= 5.0
    intervals = (1.0, 4.0)
    at_10 = sigmas(prepared(slow, tmp_path), kinds.DISPLACEMENT, intervals)
    at_50 = sigmas(prepared(fast, tmp_path), kinds.DISPLACEMENT, intervals)
    for a, b in zip(at_10, at_50, strict=True):
        late = np.sqrt((b[1] ** 2 - a[1] ** 2) / (50.0**2 - 10.0**2))
        np.testing.assert_allclose(late, STAMP_S, rtol=0.05)


def test_errors_of_the_sides_grow_with_the_root_of_time(tmp_path: Path) -> None:
    table = cruising()
    table["gyro_z"] = 0.2
    table["odo_left"], table["odo_right"] = table["odo_speed"] - 0.3, table["odo_speed"] + 0.3
    robot = VEHICLE.replace("wheeled", "tracked")
    one, four = sigmas(prepared(table, tmp_path, robot), kinds.TRACK_WIDTH, (1.0, 4.0))
    np.testing.assert_allclose(four / one, 2.0, rtol=0.05)


def test_velocities_close_together_share_their_error(tmp_path: Path) -> None:
    """Four samples a second know as much as one; two seconds apart each stands alone."""
    table = cruising()
    table.loc[np.arange(len(table)) % 50 > 0, "odo_speed"] = np.nan  # 1 Hz: no displacements
    quarter, one, two = sigmas(prepared(table, tmp_path), kinds.VELOCITY, (0.25, 1.0, 2.0))
    np.testing.assert_allclose(quarter / one, 2.0, rtol=0.05)
    np.testing.assert_allclose(two / one, 1.0, rtol=0.05)


def test_a_velocity_is_read_at_the_rate_of_its_own_node(tmp_path: Path) -> None:
    """A bend that tightens: the mean of the interval before is half a second old."""
    table = cruising().drop(columns="odo_speed")
    table["gyro_z"] = 0.4 * np.sin(table["time"] - 0.01)  # the mean of the 20 ms before
    prep = prepared(table, tmp_path)
    nodes = place_nodes(prep.sensed.inc.edge, NONE, NONE, NO_STANDSTILL)
    block = blocks_of(prep, nodes)[kinds.VELOCITY]
    assert block.sigma is not None
    lever = prep.setup.layout.slices[LEVER]  # its derivative is the rate's cross product
    by_lever = block.terms[1].jacobian[:, 1, lever] * block.sigma[:, 1:2]
    then = 0.4 * np.sin(block.time + prep.sensed.run.clock_start)
    np.testing.assert_allclose(by_lever[:-1, 0], then[:-1], atol=1e-3)


def sparse(late: float, given: str) -> tuple[pd.DataFrame, str]:
    """An odometer of 1 Hz whose clock is ahead while the vehicle speeds up: it stamps with t + late
    what is at t.
    """
    table = cruising()
    table["accel_y"] = 0.5
    at = np.arange(len(table)) % 50 == 0
    table["odo_speed"] = np.where(at, 5.0 + 0.5 * (table["time"] - late), np.nan)
    return table, f"{VEHICLE}\n[odometer]\n{given}\n"


def sparse_velocities(late: float, given: str, where: Path) -> tuple[Prepared, Nodes, Block]:
    """Of a run with such an odometer."""
    table, vehicle = sparse(late, given)
    prep = prepared(table, where, vehicle)
    nodes = place_nodes(prep.sensed.inc.edge, NONE, NONE, NO_STANDSTILL)
    return prep, nodes, blocks_of(prep, nodes)[kinds.VELOCITY]


def test_a_sparse_odometer_is_read_at_the_nodes_own_time(tmp_path: Path) -> None:
    held = "time_offset_s = 0.4\ntime_offset_sd_s = 0.0"
    prep, nodes, block = sparse_velocities(0.4, held, tmp_path)
    assert block.sigma is not None
    at_nodes = first_path(prep, nodes).estimate
    v_y = np.einsum("nji,nj->ni", at_nodes.R_nb, at_nodes.v_n)[block.terms[0].index, 1]
    read = v_y - (block.residual * block.sigma)[:, 1]
    run_time = block.time + prep.sensed.run.clock_start
    inner = (block.sigma[:, 1] < 1.0) & (block.time < 55)
    np.testing.assert_allclose(read[inner], (5.0 + 0.5 * run_time)[inner], atol=0.02)


def test_the_delay_of_a_sparse_odometer_acts_on_its_speed(tmp_path: Path) -> None:
    """Read later by a delay that turns out larger: what the vehicle gains in that time."""
    prep, _, block = sparse_velocities(0.0, "time_offset_sd_s = 0.3", tmp_path)
    assert block.sigma is not None
    by_delay = block.terms[1].jacobian[:, 1, prep.setup.layout.column(DELAY)] * block.sigma[:, 1]
    inner = (block.sigma[:, 1] < 1.0) & (block.time > 1) & (block.time < 55)
    assert inner.sum() > 40
    np.testing.assert_allclose(by_delay[inner], -0.5, atol=1e-3)


def test_a_random_walk_grows_with_the_root_of_time() -> None:
    layout = Layout((Component("scale", np.ones(1), np.ones(1), 0.1),))
    value = np.array([[1.0], [1.2], [1.6]])
    (block,) = walk(layout, value, np.array([0.0, 1.0, 5.0]), ())
    np.testing.assert_allclose(block.residual[:, 0], [2.0, 2.0])  # 0.2 in 1 s, 0.4 in 4 s


def test_a_counters_phase_is_uniform_within_a_pulse() -> None:
    drawn = np.random.default_rng(0).uniform(-0.01, 0.01, 20000)
    none = np.zeros((len(drawn), 3))
    at = Estimate(np.zeros((len(drawn), 3, 3)), none, none, drawn, np.zeros((1, 1)))
    block = phase_prior(0.02, np.zeros(len(drawn)), at)
    assert block.residual.std() == pytest.approx(1.0, abs=0.01)


def block_on(node: tuple[int, ...], segment: int | None) -> Block:
    """One factor on some nodes and a calibration segment."""
    terms = [Term("x", np.array([k]), np.ones((1, 1, NODE_DIM))) for k in node]
    if segment is not None:
        terms.append(Term("c", np.array([segment]), np.ones((1, 1, 2))))
    return Block(kinds.VELOCITY, ("a",), np.zeros(1), np.ones((1, 1)), tuple(terms))


def test_a_row_stands_in_the_columns_of_its_own_variables() -> None:
    segment = np.array([0, 0, 1])
    rows = stacked([block_on((2, 3), 1)], segment, 2)
    assert rows.start.tolist() == [0, 0, 0, 1] and (rows.A == 1).all()
    at_end = stacked([block_on((2,), 0)], segment, 2)  # the interval that ends at node 2
    np.testing.assert_array_equal(np.flatnonzero(at_end.A[0] == 0), np.arange(NODE_DIM))
    for node, foreign in (((0, 2), None), ((2, 3), 0), ((2,), 1)):
        with pytest.raises(AssertionError, match=kinds.VELOCITY):
            stacked([block_on(node, foreign)], segment, 2)


def test_a_node_has_the_segment_of_the_interval_that_ends_there() -> None:
    nodes = Nodes(np.arange(4), np.arange(4.0), np.array([0, 0, 1]), np.array([1.0, 2.5]))
    assert nodes.at(np.arange(4)).segment.tolist() == [0, 0, 0, 1]
    assert nodes.intervals.segment.tolist() == [0, 0, 1]
    assert nodes.at(np.array([2])).time.tolist() == [2.0]
    assert nodes.intervals.time.tolist() == [1.0, 2.0, 3.0]
