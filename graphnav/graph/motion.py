"""What the running gear says between and at nodes: odometer and non-holonomic constraint."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import kinds, so3
from factors.block import Block, Index
from factors.calibration import DELAY, GYRO_BIAS, TRACK_WIDTH, Layout, forward_of, lateral_of
from factors.displacement import (
    AXES,
    Coefficient,
    DisplacementReading,
    OdometerSums,
    displacement,
    phase_prior,
)
from factors.estimate import Estimate
from factors.preintegration import Preintegrated, doubt_of, interval_of_increment
from factors.track_width import track_width
from factors.velocity import VelocityReading, velocity
from graphnav.common.run import Array, Odometer
from graphnav.graph.nodes import Nodes
from graphnav.graph.preparation import Prepared
from graphnav.inertial.odometry import heard, odometer_steps, odometer_sums, speed_at

Factor = Callable[[Estimate], list[Block]]
Scales = Mapping[str, float]  # noise found in the data over noise assumed, by "kind:state:axis"
States = NDArray[np.str_]

SPARSE_S = 0.6  # an odometer slower than this gives velocities, not displacements
BOUNDARY_S = 0.3  # by which a change of state is misplaced, gears and ramps included
DROPPED = 1e6  # sigma of a row that says nothing
VERTICAL = 0.05  # m/s, suspension and bumps
YAW_FLOOR, YAW_SHARE = 0.02, 0.1  # m; of the sides' difference that a skidding turn may be off


@dataclass(frozen=True)
class Round:
    """What all factors of the running gear are made from, in one round of the solution."""

    prep: Prepared
    nodes: Nodes
    pre: Preintegrated
    state: States  # (N - 1,) motion state of each interval
    at: Estimate
    scales: Scales


def motion_factors(round_: Round, moving: Index) -> tuple[list[Factor], dict[str, States]]:
    """Displacements over the moving intervals; velocities where the odometer is sparse or absent.

    With them, by kind, the motion state each factor belongs to.
    """
    prep, nodes, state = round_.prep, round_.nodes, round_.state
    odometer = prep.sensed.run.odometer
    if odometer is None or float(np.median(np.diff(odometer.time))) > SPARSE_S:
        factors = [_velocities(round_, moving), _phase(nodes, 0.0)]
        return factors, {kinds.VELOCITY: driven(prep, state[moving])}
    on = _inside(moving, nodes, odometer.time)
    factors = [_displacements(round_, on), _phase(nodes, odometer.pulse)]
    groups = {kinds.DISPLACEMENT: driven(prep, state[on])}
    unheard = np.setdiff1d(moving, on)
    if len(unheard):  # what the odometer does not tell, the non-holonomic constraint still does
        factors.append(_velocities(round_, unheard))
        groups[kinds.VELOCITY] = driven(prep, state[unheard])
    sides = prep.sensed.run.sides
    if TRACK_WIDTH in prep.setup.layout.slices and sides is not None:
        on = _inside(moving, nodes, sides.time)
        factors.append(_track_width(round_, on))
        groups[kinds.TRACK_WIDTH] = np.full(len(on), "")
    return factors, groups


def _inside(moving: Index, nodes: Nodes, time: Array) -> Index:
    """The intervals a sensor's samples (n,) s cover."""
    return np.asarray(moving[heard(time, nodes.time[moving], nodes.time[moving + 1])])


def sums_of(prep: Prepared, nodes: Nodes, pre: Preintegrated, at: Estimate) -> OdometerSums:
    """Odometer sums with the delay and the gyro bias of an estimate."""
    assert prep.sensed.run.odometer is not None
    delay = delay_of(prep, at)
    owner = interval_of_increment(nodes.edge)
    earth = at.R_nb[:-1].transpose(0, 2, 1) @ prep.setup.alignment.origin.Omega_n
    bias = at.calibration[nodes.segment, prep.setup.layout.slices[GYRO_BIAS]][:, 2]
    steps = odometer_steps(
        prep.sensed.inc, prep.sensed.run.odometer, delay, bias[owner], earth[owner, 2]
    )
    return odometer_sums(prep.sensed.inc, pre, nodes.edge, steps, earth)


def delay_of(prep: Prepared, at: Estimate) -> float:
    """Odometer clock minus IMU clock of an estimate, s; what the vehicle file states if held."""
    column = prep.setup.layout.find(DELAY)
    if column is None:
        return prep.setup.vehicle.odometer.time_offset_s
    return float(np.median(at.calibration[:, column]))


def _phase(nodes: Nodes, pulse: float) -> Factor:
    return lambda x: [phase_prior(pulse, nodes.time, x)]


def _displacements(round_: Round, on: Index) -> Factor:
    prep, nodes = round_.prep, round_.nodes
    layout, scope = prep.setup.layout, nodes.intervals.of(on)
    names = driven(prep, round_.state[on])
    sums = sums_of(prep, nodes, round_.pre, round_.at).of(on)
    factor = _column(prep, names, "factor")
    lateral = _column(prep, names, "kappa") * prep.setup.vehicle.body.contact_length
    reading = DisplacementReading(
        sums=sums,
        forward=_coefficient(layout, [forward_of(s) for s in names], factor),
        lateral=_coefficient(layout, [lateral_of(s) for s in names], lateral),
        gauge=_column(prep, names, "half_gauge"),
        roll=float(prep.setup.vehicle.odometer.mount_b[1]),
        sigma=_displacement_sigma(round_, on, names, sums, factor),
    )
    return lambda x: [displacement(reading, layout, scope, x)]


def _displacement_sigma(
    round_: Round, on: Index, names: States, sums: OdometerSums, factor: Array
) -> Array:
    """One sigma (n, 3) m of the displacements over intervals `on` in states `names`."""
    prep, nodes = round_.prep, round_.nodes
    assert prep.sensed.run.odometer is not None
    T = np.diff(nodes.time)[on]
    sigma = _sigma(prep, names, round_.scales, kinds.DISPLACEMENT) * np.sqrt(T)[:, None]
    # pulses come late by up to one: while the vehicle turns that is a step aside
    turn = np.linalg.norm(so3.log(sums.R_mid), axis=1) * 2
    sigma[:, 0] = np.hypot(sigma[:, 0], prep.sensed.run.odometer.pulse / np.sqrt(12) * turn)
    speed = np.linalg.norm(sums.distance[:, :, 1], axis=1) / T
    # across a gap of the IMU nobody knows where the odometer's way led
    astray = speed * T * np.minimum(doubt_of(prep.sensed.inc, nodes.edge)[on, 0], 1.0)
    sigma = np.hypot(sigma, astray[:, None])
    sigma[:, 1] = np.hypot(sigma[:, 1], BOUNDARY_S * speed * _change(factor))
    return np.asarray(sigma)


def _coefficient(layout: Layout, names: list[str], held: Array) -> Coefficient:
    """Of each interval, by the name (n,) of its component; held where there is none."""
    columns = [layout.find(name) for name in names]
    on = [k for k, column in enumerate(columns) if column is not None]
    there = [column for column in columns if column is not None]
    return Coefficient(held, np.array(on, np.int64), np.array(there, np.int64))


def _change(factor: Array) -> Array:
    """How much the odometer's meaning changes at either end of each interval, (n,)."""
    step = np.abs(np.diff(factor, prepend=factor[:1], append=factor[-1:]))
    return np.maximum(step[1:], step[:-1])


def _track_width(round_: Round, on: Index) -> Factor:
    """Yaw from the two sides of a skid-steered vehicle."""
    prep, nodes = round_.prep, round_.nodes
    sides, layout = prep.sensed.run.sides, prep.setup.layout
    assert sides is not None
    rate = sides.right - sides.left
    swept = np.concatenate([[0.0], np.cumsum(np.diff(sides.time) * (rate[1:] + rate[:-1]) / 2)])
    stamp = nodes.time + delay_of(prep, round_.at)
    difference = np.diff(np.interp(stamp, sides.time, swept))[on]
    found = round_.scales.get(f"{kinds.TRACK_WIDTH}::yaw", 1.0)
    sigma = found * (YAW_FLOOR + YAW_SHARE * np.abs(difference))
    scope = nodes.intervals.of(on)
    return lambda x: [track_width(difference, sigma, layout, scope, x)]


def _velocities(round_: Round, moving: Index) -> Factor:
    """Velocity at the end of each moving interval; the forward row only with an odometer."""
    prep, pre = round_.prep, round_.pre
    names, scope = driven(prep, round_.state[moving]), round_.nodes.at(moving + 1)
    rate = so3.log(pre.dR)[moving] / pre.T[moving, None]
    sigma = _sigma(prep, names, round_.scales, kinds.VELOCITY)
    speed = np.zeros(len(moving))
    odometer = prep.sensed.run.odometer
    if odometer is None:
        sigma[:, 1] = DROPPED
    else:
        stamp = scope.time + delay_of(prep, round_.at)
        speed = _speed(odometer, stamp) * _column(prep, names, "factor")
        sigma[~heard(odometer.time, stamp, stamp), 1] = DROPPED
    lateral = -_column(prep, names, "kappa") * prep.setup.vehicle.body.contact_length * rate[:, 2]
    roll, layout = float(prep.setup.vehicle.odometer.mount_b[1]), prep.setup.layout
    reading = VelocityReading(speed, lateral, rate, sigma, roll)
    return lambda x: [velocity(reading, layout, scope, x)]


def _speed(odometer: Odometer, time: Array) -> Array:
    """As recorded; a counter has no speed of its own: differenced over 0.2 s."""
    if odometer.pulse > 0:
        return speed_at(odometer, time)
    return np.interp(time, odometer.time, odometer.speed)


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
