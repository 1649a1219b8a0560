"""One round's factor graph: nodes, sums and the functions that linearise every kind of factor."""

from dataclasses import dataclass

import numpy as np

from factors.block import Block, Index
from factors.calibration import prior as calibration_prior
from factors.calibration import walk
from factors.heading import heading
from factors.inertial import Field, inertial
from factors.position import Fixes, position
from factors.preintegration import Preintegrated, interval_of_increment, preintegrate
from factors.standstill import StandstillNoise, standstill
from factors.start import start
from graphnav.graph.elimination import Chain
from graphnav.graph.estimate import Estimate
from graphnav.graph.motion import Factor, Scales, States, motion_factors
from graphnav.graph.nodes import Nodes, nearest_node
from graphnav.graph.preparation import Prepared
from graphnav.recognition.timeline import Timeline

STILL_VELOCITY, STILL_POSITION = 2e-3, 1e-3  # m/s, m
STILL_ROTATION = 1e-9  # rad, at least
FIX_REACH_S = 0.3  # a fix further from every node is left out
FIX_SD = 0.05  # m, no fix is believed further
HEADING_SD = np.deg2rad(1.0)


@dataclass(frozen=True)
class Problem:
    """A graph ready for the solver, and what later stages need of it."""

    factors: tuple[Factor, ...]
    chain: Chain
    nodes: Nodes
    pre: Preintegrated
    resting: Index  # intervals at standstill
    state: States  # (N - 1,) motion state of each interval
    groups: dict[str, States]  # by factor kind, the state each of its factors belongs to

    def linearise(self, estimate: Estimate) -> list[Block]:
        """Every block at an estimate."""
        return [block for factor in self.factors for block in factor(estimate)]


def build(
    prep: Prepared, nodes: Nodes, timeline: Timeline, at: Estimate, scales: Scales
) -> Problem:
    """Integrate with the biases and the delay of `at` and assemble all factors."""
    seg = nodes.segment
    pre = preintegrate(prep.sensed.inc, nodes.edge, at.calibration[seg, :6], prep.setup.noise)
    owner = interval_of_increment(nodes.edge)
    share = np.bincount(owner, prep.sensed.still, len(seg)) / np.bincount(owner, minlength=len(seg))
    resting = np.flatnonzero(share > 0.999)
    state = timeline.state_at(0.5 * (nodes.time[1:] + nodes.time[:-1]))
    factors = [
        _start(prep, nodes),
        _calibration(prep, nodes),
        _inertial(prep, nodes, pre),
        _standstill(prep, nodes, resting),
    ]
    moving = np.setdiff1d(np.arange(len(seg)), resting)
    motion, groups = motion_factors(prep, nodes, pre, state, moving, at, scales)
    factors.extend(motion)
    if prep.sensed.gnss is not None:
        fixes = _gnss(prep, nodes, scales)
        factors.append(fixes)
        groups["gnss"] = np.full(len(fixes(at)[0].time), "")
    if prep.sensed.run.heading is not None:
        factors.append(_heading(prep, nodes))
    chain = Chain(len(nodes.time), len(nodes.segment_time), prep.setup.layout.dim, seg)
    return Problem(tuple(factors), chain, nodes, pre, resting, state, groups)


def _start(prep: Prepared, nodes: Nodes) -> Factor:
    known, t = prep.setup.alignment.start, float(nodes.time[0])
    return lambda x: [start(known, x.R_nb[0], x.v_n[0], x.p_n[0], t)]


def _calibration(prep: Prepared, nodes: Nodes) -> Factor:
    layout, time = prep.setup.layout, nodes.segment_time
    return lambda x: [
        calibration_prior(layout, x.calibration),
        *(walk(layout, x.calibration, time, ("scale",)) if len(time) > 1 else []),
    ]


def _inertial(prep: Prepared, nodes: Nodes, pre: Preintegrated) -> Factor:
    origin, dim = prep.setup.alignment.origin, prep.setup.layout.dim

    def factor(x: Estimate) -> list[Block]:
        g = origin.gravity(0.5 * (x.p_n[:-1] + x.p_n[1:]))
        field = Field(origin.Omega_n, g, origin.gravity_gradient)
        bias = x.calibration[nodes.segment, :6]
        args = (pre, x.R_nb, x.v_n, x.p_n, bias, field, nodes.time, nodes.segment, dim)
        return [inertial(*args)]

    return factor


def _standstill(prep: Prepared, nodes: Nodes, resting: Index) -> Factor:
    rotation = np.sqrt(2) * prep.sensed.rocking + STILL_ROTATION
    noise = StandstillNoise(rotation, STILL_VELOCITY, STILL_POSITION)
    time = nodes.time[resting + 1]
    return lambda x: (
        [standstill(resting, x.R_nb, x.v_n, x.p_n, time, noise)] if len(resting) else []
    )


def _gnss(prep: Prepared, nodes: Nodes, scales: Scales) -> Factor:
    assert prep.sensed.gnss is not None
    node, dt = nearest_node(nodes, prep.sensed.gnss.time)
    # of several fixes near one node only the closest is used
    order = np.lexsort((np.abs(dt), node))
    pick = np.sort(order[np.unique(node[order], return_index=True)[1]])
    pick = pick[np.abs(dt[pick]) < FIX_REACH_S]
    factor_of = np.array([scales.get(f"gnss::{axis}", 1.0) for axis in ("east", "north", "up")])
    sigma = np.maximum(prep.sensed.gnss.sd_enu[pick], FIX_SD) * factor_of
    at = node[pick]
    segment = nodes.segment[np.maximum(at - 1, 0)]
    fixes = Fixes(
        prep.sensed.fixes_n[pick], sigma, dt[pick], at, segment, prep.sensed.gnss.time[pick]
    )
    antenna, offset = prep.setup.layout.column("antenna"), prep.setup.layout.column("gnss_offset")
    return lambda x: [position(fixes, antenna, offset, x.R_nb, x.v_n, x.p_n, x.calibration)]


def _heading(prep: Prepared, nodes: Nodes) -> Factor:
    sensed = prep.sensed.run.heading
    assert sensed is not None
    node, dt = nearest_node(nodes, sensed.time)
    pick = np.flatnonzero(np.abs(dt) < FIX_REACH_S)
    value, at, time = sensed.heading[pick], node[pick], sensed.time[pick]
    sigma = np.full(len(pick), HEADING_SD)
    return lambda x: [heading(value, sigma, at, x.R_nb, time)]
