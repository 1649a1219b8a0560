"""What the running gear says between and at nodes: odometer and non-holonomic constraint."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from factors import so3
from factors.block import Block, Index
from factors.displacement import Correction as Reading
from factors.displacement import OdometerSums, displacement, phase_prior
from factors.preintegration import Preintegrated, doubt_of, interval_of_increment
from factors.track_width import track_width
from factors.velocity import velocity
from graphnav.common.run import Array, Odometer
from graphnav.graph import calibrations
from graphnav.graph.estimate import Estimate
from graphnav.graph.nodes import Nodes
from graphnav.graph.preparation import Prepared
from graphnav.inertial.odometry import odometer_steps, odometer_sums, speed_at

Factor = Callable[[Estimate], list[Block]]
Scales = Mapping[str, float]  # noise found in the data over noise assumed, by "kind:state:axis"
States = NDArray[np.str_]

SPARSE_S = 0.6  # an odometer slower than this gives velocities, not displacements
BOUNDARY_S = 0.3  # by which a change of state is misplaced, gears and ramps included
REACH_S = 0.1  # beyond its samples an odometer says nothing
DROPPED = 1e6  # sigma of a row that says nothing
VERTICAL = 0.05  # m/s, suspension and bumps
YAW_FLOOR, YAW_SHARE = 0.02, 0.1  # m; of the sides' difference that a skidding turn may be off
AXES = ("lateral", "forward", "vertical")


def motion_factors(
    prep: Prepared,
    nodes: Nodes,
    pre: Preintegrated,
    state: States,
    moving: Index,
    at: Estimate,
    scales: Scales,
) -> tuple[list[Factor], dict[str, States]]:
    """Displacements over the moving intervals; velocities where the odometer is sparse or absent.

    With them, by kind, the motion state each factor belongs to.
    """
    odometer = prep.sensed.run.odometer
    if odometer is None or float(np.median(np.diff(odometer.time))) > SPARSE_S:
        velocities = _velocities(prep, nodes, pre, state, moving, odometer, at, scales)
        return [velocities, _phase(nodes, 0.0)], {"velocity": driven(prep, state[moving])}
    sums = sums_of(prep, nodes, pre, at)
    on = _inside(moving, nodes, odometer.time)
    factors = [_displacements(prep, nodes, sums, state, on, scales), _phase(nodes, odometer.pulse)]
    groups = {"displacement": driven(prep, state[on])}
    sides = prep.sensed.run.sides
    if "track_width" in prep.setup.layout.slices and sides is not None:
        on = _inside(moving, nodes, sides.time)
        factors.append(_track_width(prep, nodes, on, at, scales))
        groups["track_width"] = np.full(len(on), "")
    return factors, groups


def _inside(moving: Index, nodes: Nodes, time: Array) -> Index:
    """The intervals a sensor's samples (n,) s cover."""
    begin, end = nodes.time[moving], nodes.time[moving + 1]
    covered = (begin >= time[0] - REACH_S) & (end <= time[-1] + REACH_S)
    return np.asarray(moving[covered])


def sums_of(prep: Prepared, nodes: Nodes, pre: Preintegrated, at: Estimate) -> OdometerSums:
    """Odometer sums with the delay and the gyro bias of an estimate."""
    assert prep.sensed.run.odometer is not None
    delay = delay_of(prep, at)
    owner = interval_of_increment(nodes.edge)
    earth = at.R_nb[:-1].transpose(0, 2, 1) @ prep.setup.alignment.origin.Omega_n
    bias = at.calibration[nodes.segment, 2]
    steps = odometer_steps(
        prep.sensed.inc, prep.sensed.run.odometer, delay, bias[owner], earth[owner, 2]
    )
    return odometer_sums(prep.sensed.inc, pre, nodes.edge, steps, earth)


def delay_of(prep: Prepared, at: Estimate) -> float:
    """Odometer clock minus IMU clock of an estimate, s; what the vehicle file states if held."""
    column = prep.setup.layout.column("delay")
    stated = prep.setup.vehicle.odometer.time_offset_s
    return float(np.median(at.calibration[:, column])) if column >= 0 else stated


def _phase(nodes: Nodes, pulse: float) -> Factor:
    return lambda x: [phase_prior(x.phase, nodes.time, pulse)]


def _displacements(
    prep: Prepared, nodes: Nodes, sums: OdometerSums, state: States, on: Index, scales: Scales
) -> Factor:
    assert prep.sensed.run.odometer is not None
    columns, layout = calibrations.columns(prep.setup.layout), prep.setup.layout
    roll = float(prep.setup.vehicle.odometer.mount_b[1])
    names = driven(prep, state[on])
    T = np.diff(nodes.time)[on]
    sigma = _sigma(prep, names, scales, "displacement") * np.sqrt(T)[:, None]
    # pulses come late by up to one: while the vehicle turns that is a step aside
    turn = np.linalg.norm(so3.log(sums.R_mid[on]), axis=1) * 2
    sigma[:, 0] = np.hypot(sigma[:, 0], prep.sensed.run.odometer.pulse / np.sqrt(12) * turn)
    factor = _column(prep, names, "factor")
    speed = np.linalg.norm(sums.distance[on, :, 1], axis=1) / T
    # across a gap of the IMU nobody knows where the odometer's way led
    astray = speed * T * np.minimum(doubt_of(prep.sensed.inc, nodes.edge)[on, 0], 1.0)
    sigma = np.hypot(sigma, astray[:, None])
    sigma[:, 1] = np.hypot(sigma[:, 1], BOUNDARY_S * speed * _change(factor))
    reading = Reading(
        forward=factor,
        gauge=_column(prep, names, "half_gauge"),
        lateral=_column(prep, names, "kappa") * prep.setup.vehicle.body.contact_length,
        forward_column=np.array([layout.column(f"forward:{s}") for s in names], np.int64),
        lateral_column=np.array([layout.column(f"lateral:{s}") for s in names], np.int64),
        sigma=sigma,
    )
    picked = sums.of(on)
    seg, time = nodes.segment[on], nodes.time[on + 1]
    return lambda x: [
        displacement(
            picked,
            reading,
            columns,
            roll,
            on,
            x.R_nb,
            x.p_n,
            x.phase,
            x.calibration[seg],
            seg,
            time,
        )
    ]


def _change(factor: Array) -> Array:
    """How much the odometer's meaning changes at either end of each interval, (n,)."""
    step = np.abs(np.diff(factor, prepend=factor[:1], append=factor[-1:]))
    return np.maximum(step[1:], step[:-1])


def _track_width(prep: Prepared, nodes: Nodes, on: Index, at: Estimate, scales: Scales) -> Factor:
    """Yaw from the two sides of a skid-steered vehicle."""
    sides, layout = prep.sensed.run.sides, prep.setup.layout
    assert sides is not None
    column, late = layout.column("track_width"), delay_of(prep, at)
    rate = sides.right - sides.left
    swept = np.concatenate([[0.0], np.cumsum(np.diff(sides.time) * (rate[1:] + rate[:-1]) / 2)])
    difference = np.diff(np.interp(nodes.time + late, sides.time, swept))[on]
    found = scales.get("track_width::yaw", 1.0)
    sigma = found * (YAW_FLOOR + YAW_SHARE * np.abs(difference))
    seg, time = nodes.segment[on], nodes.time[on + 1]
    return lambda x: [
        track_width(difference, sigma, column, on, x.R_nb, x.calibration[seg], seg, time)
    ]


def _velocities(
    prep: Prepared,
    nodes: Nodes,
    pre: Preintegrated,
    state: States,
    moving: Index,
    odometer: Odometer | None,
    at: Estimate,
    scales: Scales,
) -> Factor:
    """Velocity at the end of each moving interval; the forward row only with an odometer."""
    columns = calibrations.columns(prep.setup.layout)
    roll = float(prep.setup.vehicle.odometer.mount_b[1])
    names, node = driven(prep, state[moving]), moving + 1
    seg, time = nodes.segment[moving], nodes.time[node]
    rate = so3.log(pre.dR)[moving] / pre.T[moving, None]
    sigma = _sigma(prep, names, scales, "velocity")
    if odometer is None:
        speed = np.zeros(len(node))
        sigma[:, 1] = DROPPED
    else:
        stamp = time + delay_of(prep, at)
        # a counter has no speed of its own: differenced over 0.2 s
        if odometer.pulse > 0:
            speed = speed_at(odometer, stamp)
        else:
            speed = np.interp(stamp, odometer.time, odometer.speed)
        speed *= _column(prep, names, "factor")
        heard = (stamp >= odometer.time[0] - REACH_S) & (stamp <= odometer.time[-1] + REACH_S)
        sigma[~heard, 1] = DROPPED
    lateral = -_column(prep, names, "kappa") * prep.setup.vehicle.body.contact_length * rate[:, 2]
    return lambda x: [
        velocity(
            speed,
            lateral,
            sigma,
            rate,
            columns,
            roll,
            node,
            x.R_nb,
            x.v_n,
            x.calibration[seg],
            seg,
            time,
        )
    ]


def driven(prep: Prepared, state: States) -> States:
    """States of intervals that are not wholly at rest: the edges of a stop are driven straight."""
    usual = "straight_high" if prep.setup.vehicle.kind == "tracked" else "moving"
    return np.where(np.isin(state, ("stop", "moving")), usual, state)


def _column(prep: Prepared, names: States, field: str) -> Array:
    """One column of the correction table for each interval, (n,)."""
    values = {state: float(getattr(row, field)) for state, row in prep.setup.table.items()}
    return np.array([values[str(s)] for s in names], dtype=np.float64)


def _sigma(prep: Prepared, names: States, scales: Scales, kind: str) -> Array:
    """Velocity sigma of each interval by axis, (n, 3) m/s; rows the table discards are dropped."""
    by_state = {}
    for state, row in prep.setup.table.items():
        forward = row.sigma_forward if row.use_odometer else DROPPED
        found = np.array([scales.get(f"{kind}:{state}:{axis}", 1.0) for axis in AXES])
        by_state[state] = np.array([row.sigma_lateral, forward, VERTICAL]) * found
    return np.array([by_state[str(s)] for s in names], dtype=np.float64).reshape(-1, 3)
