"""One round's factor graph: nodes, sums and the functions that linearise every kind of factor."""

from dataclasses import dataclass, replace

import numpy as np

from factors import kinds
from factors.block import Block, Index
from factors.calibration import ANTENNA, LEVER, MOUNTING, SCALE, Layout, walk
from factors.calibration import prior as calibration_prior
from factors.estimate import Estimate
from factors.heading import Bearing, heading
from factors.inertial import EarthField, inertial
from factors.initial_state import initial_state
from factors.preintegration import Preintegrated, interval_of_increment, preintegrate
from factors.standstill import StandstillNoise, standstill
from graphnav.common.earth import Origin
from graphnav.graph.common_error import common_layout
from graphnav.graph.elimination import EliminationOrder
from graphnav.graph.inertial_noise import density, inertial_noise
from graphnav.graph.motion import motion_factors
from graphnav.graph.nodes import Nodes, nearest_node
from graphnav.graph.noise import Parts, Scales, States
from graphnav.graph.preparation import Prepared
from graphnav.graph.round import Factor, Round
from graphnav.graph.satellite_fixes import satellite_fixes
from graphnav.graph.unfelt import unfelt_factors
from graphnav.inertial import heading_sources
from graphnav.inertial.alignment import LOOSE_HEADING
from graphnav.inertial.carried_standstill import HORIZONTAL, VERTICAL
from graphnav.inertial.standstill_evidence import Mask
from graphnav.recognition.timeline import Timeline

STANDSTILL_VELOCITY, STANDSTILL_POSITION = 2e-3, 1e-3  # m/s, m
STANDSTILL_ROTATION = 1e-9  # rad, at least
FREE = 1e9  # times as unsure: nothing is said
HEADING_REACH_S = 0.3  # a heading further from every node is left out
HEADING_SD = np.deg2rad(1.0)
STATED = (ANTENNA, LEVER, MOUNTING)  # by the user; what fixes contradict is let go


@dataclass(frozen=True)
class Problem:
    """A graph ready for the solver, and what later stages need of it."""

    factors: tuple[Factor, ...]
    order: EliminationOrder
    nodes: Nodes
    pre: Preintegrated
    at_standstill: Index  # intervals at standstill
    state: States  # (N - 1,) motion state of each interval
    noise: dict[str, Parts]  # by factor kind, what the errors of its rows are sums of

    def linearise(self, estimate: Estimate) -> list[Block]:
        """Every block at an estimate."""
        return [block for factor in self.factors for block in factor(estimate)]


def build(
    prep: Prepared, nodes: Nodes, timeline: Timeline, at: Estimate, scales: Scales
) -> Problem:
    """Integrate with the sensors' errors and the delay of `at` and assemble all factors."""
    seg, setup = nodes.segment, prep.setup
    owner = interval_of_increment(nodes.edge)
    count = np.bincount(owner, minlength=len(seg))
    detected = prep.sensed.standstill
    at_standstill = np.flatnonzero(
        np.bincount(owner, detected.at_standstill, len(seg)) / count > 0.999
    )
    carried = np.stack([np.bincount(owner, on, len(seg)) > 0 for on in detected.carried.T], -1)
    imu = inertial_noise(prep.sensed, nodes.edge, at_standstill, setup.noise, scales)
    errors = setup.layout.imu_errors_of(at.calibration)[seg]
    pre = preintegrate(prep.sensed.inc, nodes.edge, errors, density(imu))
    state = timeline.state_at(0.5 * (nodes.time[1:] + nodes.time[:-1]))
    factors = [
        _start(prep, nodes),
        _calibration(prep, common_layout(setup.layout, scales), nodes),
        inertial_factor(setup.alignment.origin, setup.layout, nodes, pre),
        _standstill(prep, nodes, at_standstill, carried[at_standstill]),
    ]
    round_ = Round(prep, nodes, pre, state, at, scales)
    # what is carried says nothing with its wheels
    moving = np.setdiff1d(np.flatnonzero(~carried.any(1)), at_standstill)
    motion, noise = motion_factors(round_, moving)
    factors.extend(motion)
    factors.extend(unfelt_factors(round_, at_standstill, np.asarray(carried.any(1))))
    noise[kinds.INERTIAL] = imu
    if prep.sensed.gnss is not None:
        unmoved = at_standstill[~carried[at_standstill].any(1)]
        fixes, noise[kinds.GNSS] = satellite_fixes(round_, unmoved)
        factors.append(fixes)
    if prep.sensed.run.heading is not None:
        factors.append(_heading(prep, nodes))
    order = EliminationOrder(len(nodes.time), len(nodes.segment_time), setup.layout.dim, seg)
    return Problem(tuple(factors), order, nodes, pre, at_standstill, state, noise)


def _start(prep: Prepared, nodes: Nodes) -> Factor:
    """What is known of the first node; a stated heading as a factor that may be doubted."""
    known, t = prep.setup.alignment.start, float(nodes.time[0])
    spec, layout = prep.setup.vehicle.start, prep.setup.layout
    if prep.setup.alignment.source != heading_sources.STATED or spec.heading_deg is None:
        return lambda x: [initial_state(known, t, x)]
    sd = known.sd.copy()
    sd[2] = LOOSE_HEADING
    known = replace(known, sd=sd)
    stated, sigma = np.deg2rad([[spec.heading_deg], [spec.heading_sd_deg]])
    mount_b = prep.setup.vehicle.odometer.mount_b
    roll = float(mount_b[1]) if spec.heading_of == "vehicle" else None
    bearing = Bearing(stated, sigma, roll, kinds.START_HEADING)
    scope = nodes.at(np.zeros(1, np.int64), nodes.time[:1])
    return lambda x: [initial_state(known, t, x), heading(bearing, layout, scope, x)]


def _calibration(prep: Prepared, layout: Layout, nodes: Nodes) -> Factor:
    """Where nothing fixes the path, a lever arm let go would bend the path to the noise instead."""
    time = nodes.segment_time
    let_go = STATED if prep.sensed.gnss is not None else ()
    return lambda x: [
        *calibration_prior(layout, x.calibration, let_go),
        *(walk(layout, x.calibration, time, (SCALE,)) if len(time) > 1 else []),
    ]


def inertial_factor(origin: Origin, layout: Layout, nodes: Nodes, pre: Preintegrated) -> Factor:
    """Inertial motion over every interval."""
    scope = nodes.intervals

    def factor(x: Estimate) -> list[Block]:
        g = origin.gravity(0.5 * (x.p_n[:-1] + x.p_n[1:]))
        field = EarthField(origin.Omega_n, g, origin.gravity_gradient)
        return [inertial(pre, field, layout, scope, x)]

    return factor


def _standstill(prep: Prepared, nodes: Nodes, at_standstill: Index, carried: Mask) -> Factor:
    """At standstill; along what is `carried` (n, 2), horizontal or vertical, nothing is held."""
    rotation = np.sqrt(2) * prep.sensed.rocking + STANDSTILL_ROTATION
    free = np.where(carried[:, [HORIZONTAL, HORIZONTAL, VERTICAL]], FREE, 1.0)
    noise = StandstillNoise(rotation, STANDSTILL_VELOCITY * free, STANDSTILL_POSITION * free)
    scope = nodes.intervals.of(at_standstill)
    return lambda x: [standstill(noise, scope, x)] if len(at_standstill) else []


def _heading(prep: Prepared, nodes: Nodes) -> Factor:
    sensed = prep.sensed.run.heading
    assert sensed is not None
    node, dt = nearest_node(nodes, sensed.time)
    pick = np.flatnonzero(np.abs(dt) < HEADING_REACH_S)
    vehicle, layout = prep.setup.vehicle, prep.setup.layout
    roll = float(vehicle.odometer.mount_b[1]) if vehicle.heading.heading_of == "vehicle" else None
    bearing = Bearing(sensed.heading[pick], np.full(len(pick), HEADING_SD), roll)
    scope = nodes.at(node[pick], sensed.time[pick])
    return lambda x: [heading(bearing, layout, scope, x)]
