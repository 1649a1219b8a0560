"""How the running gear's readings become factors: their noise, their clock, their segment."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import VEHICLE, driven, saved

from factors import kinds
from factors.block import NODE_DIM, Block, Term
from factors.calibration import Component, Layout, walk
from factors.displacement import phase_prior
from factors.estimate import Estimate
from graphnav.batch.first_path import first_path
from graphnav.graph.assembly import stacked
from graphnav.graph.nodes import Nodes, place_nodes
from graphnav.graph.preparation import Prepared, prepare
from graphnav.graph.problem import build
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.recognition.timeline import Timeline

NONE = np.zeros(0)
NO_RESTS = np.zeros((0, 2))


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
    table[["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y"]] = 0.0
    table["accel_z"] = 9.8
    table.loc[seen, "odo_speed"] = 10.0
    return table


def test_errors_of_a_displacement_grow_with_the_root_of_time(tmp_path: Path) -> None:
    """They are white: four intervals know as much as the one that spans them."""
    prep = prepared(cruising(), tmp_path)
    sigma = {}
    for interval in (1.0, 4.0):
        nodes = place_nodes(prep.sensed.inc.edge, NONE, NONE, NO_RESTS, interval)
        block = blocks_of(prep, nodes)[kinds.DISPLACEMENT]
        assert block.sigma is not None
        sigma[interval] = np.median(block.sigma, axis=0)
    np.testing.assert_allclose(sigma[4.0] / sigma[1.0], 2.0, rtol=0.05)


def test_a_sparse_odometer_is_read_at_the_nodes_own_time(tmp_path: Path) -> None:
    """Its clock is 0.4 s ahead while the vehicle speeds up: it stamps with t + 0.4 what is at t."""
    table, late = cruising(), 0.4
    table["accel_y"] = 0.5
    at = np.arange(len(table)) % 50 == 0
    true = 5.0 + 0.5 * (table["time"] - late)
    table["odo_speed"] = np.where(at, true, np.nan)
    clock = f"{VEHICLE}\n[odometer]\ntime_offset_s = {late}\ntime_offset_sd_s = 0.0\n"
    prep = prepared(table, tmp_path, clock)
    nodes = place_nodes(prep.sensed.inc.edge, NONE, NONE, NO_RESTS)
    blocks = blocks_of(prep, nodes)
    block = blocks[kinds.VELOCITY]
    assert block.sigma is not None
    at_nodes = first_path(prep, nodes).estimate
    v_y = np.einsum("nji,nj->ni", at_nodes.R_nb, at_nodes.v_n)[block.terms[0].index, 1]
    read = v_y - (block.residual * block.sigma)[:, 1]
    run_time = block.time + prep.sensed.run.clock_start
    inner = (block.sigma[:, 1] < 1.0) & (block.time < 55)
    np.testing.assert_allclose(read[inner], (5.0 + 0.5 * run_time)[inner], atol=0.02)


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
