"""What the running gear says between and at nodes: odometer and non-holonomic constraint."""

import numpy as np

from factors import kinds, so3
from factors.block import Index
from factors.calibration import DELAY, TRACK_WIDTH, Layout, forward_of, lateral_of
from factors.displacement import (
    Coefficient,
    DisplacementReading,
    OdometerSums,
    displacement,
    phase_prior,
)
from factors.estimate import Estimate
from factors.preintegration import Preintegrated, corrected, interval_of_increment
from factors.track_width import track_width
from factors.velocity import VelocityReading, velocity
from graphnav.common.run import Array, Odometer
from graphnav.graph.motion_noise import displacement_noise, track_width_noise, velocity_noise
from graphnav.graph.nodes import Nodes
from graphnav.graph.noise import Parts, States
from graphnav.graph.preparation import Prepared
from graphnav.graph.round import Factor, Round, with_noise
from graphnav.inertial.odometry import heard, odometer_steps, odometer_sums, speed_at

SPARSE_S = 0.6  # an odometer slower than this gives velocities, not displacements


def motion_factors(round_: Round, moving: Index) -> tuple[list[Factor], dict[str, Parts]]:
    """Displacements over the moving intervals; velocities where the odometer is sparse or absent.

    With them, by kind, what their errors are sums of.
    """
    prep, nodes = round_.prep, round_.nodes
    odometer = prep.sensed.run.odometer
    if odometer is None or float(np.median(np.diff(odometer.time))) > SPARSE_S:
        velocities, noise = _velocities(round_, moving)
        return [velocities, _phase(nodes, 0.0)], {kinds.VELOCITY: noise}
    on = _inside(moving, nodes, odometer.time)
    displacements, noise = _displacements(round_, on)
    factors, found = [displacements, _phase(nodes, odometer.pulse)], {kinds.DISPLACEMENT: noise}
    unheard = np.setdiff1d(moving, on)
    if len(unheard):  # what the odometer does not tell, the non-holonomic constraint still does
        velocities, found[kinds.VELOCITY] = _velocities(round_, unheard)
        factors.append(velocities)
    sides = prep.sensed.run.sides
    if TRACK_WIDTH in prep.setup.layout.slices and sides is not None:
        on = _inside(moving, nodes, sides.time)
        yaw, found[kinds.TRACK_WIDTH] = _track_width(round_, on)
        factors.append(yaw)
    return factors, found


def _inside(moving: Index, nodes: Nodes, time: Array) -> Index:
    """The intervals a sensor's samples (n,) s cover."""
    return np.asarray(moving[heard(time, nodes.time[moving], nodes.time[moving + 1])])


def sums_of(prep: Prepared, nodes: Nodes, pre: Preintegrated, at: Estimate) -> OdometerSums:
    """Odometer sums with the delay of an estimate."""
    assert prep.sensed.run.odometer is not None
    delay = delay_of(prep, at)
    owner = interval_of_increment(nodes.edge)
    earth = at.R_nb[:-1].transpose(0, 2, 1) @ prep.setup.alignment.origin.Omega_n
    inc = prep.sensed.inc
    true = corrected(inc, pre.errors[owner])
    steps = odometer_steps(true, prep.sensed.run.odometer, delay, earth[owner, 2])
    return odometer_sums(inc, pre, nodes.edge, steps, earth)


def delay_of(prep: Prepared, at: Estimate) -> float:
    """Odometer clock minus IMU clock of an estimate, s; what the vehicle file states if held."""
    column = prep.setup.layout.find(DELAY)
    if column is None:
        return prep.setup.vehicle.odometer.time_offset_s
    return float(np.median(at.calibration[:, column]))


def _phase(nodes: Nodes, pulse: float) -> Factor:
    return lambda x: [phase_prior(pulse, nodes.time, x)]


def _displacements(round_: Round, on: Index) -> tuple[Factor, Parts]:
    prep, nodes = round_.prep, round_.nodes
    layout, scope = prep.setup.layout, nodes.intervals.of(on)
    names = driven(prep, round_.state[on])
    sums = sums_of(prep, nodes, round_.pre, round_.at).of(on)
    factor = _column(prep, names, "factor")
    lateral = _column(prep, names, "kappa") * prep.setup.vehicle.body.contact_length
    noise = displacement_noise(round_, on, names, sums, factor)
    reading = DisplacementReading(
        sums=sums,
        forward=_coefficient(layout, [forward_of(s) for s in names], factor),
        lateral=_coefficient(layout, [lateral_of(s) for s in names], lateral),
        gauge=_column(prep, names, "half_gauge"),
        roll=float(prep.setup.vehicle.odometer.mount_b[1]),
        sigma=noise.sigma,
    )
    return with_noise(noise, lambda x: displacement(reading, layout, scope, x)), noise


def _coefficient(layout: Layout, names: list[str], held: Array) -> Coefficient:
    """Of each interval, by the name (n,) of its component; held where there is none."""
    columns = [layout.find(name) for name in names]
    on = [k for k, column in enumerate(columns) if column is not None]
    there = [column for column in columns if column is not None]
    return Coefficient(held, np.array(on, np.int64), np.array(there, np.int64))


def _track_width(round_: Round, on: Index) -> tuple[Factor, Parts]:
    """Yaw from the two sides of a skid-steered vehicle."""
    prep, nodes = round_.prep, round_.nodes
    sides, layout = prep.sensed.run.sides, prep.setup.layout
    assert sides is not None
    rate = sides.right - sides.left
    swept = np.concatenate([[0.0], np.cumsum(np.diff(sides.time) * (rate[1:] + rate[:-1]) / 2)])
    stamp = nodes.time + delay_of(prep, round_.at)
    difference = np.diff(np.interp(stamp, sides.time, swept))[on]
    noise, scope = track_width_noise(round_, on), nodes.intervals.of(on)
    sigma = noise.sigma[:, 0]
    return with_noise(noise, lambda x: track_width(difference, sigma, layout, scope, x)), noise


def _velocities(round_: Round, moving: Index) -> tuple[Factor, Parts]:
    """Velocity at the end of each moving interval; the forward row only with an odometer."""
    prep, pre = round_.prep, round_.pre
    names, scope = driven(prep, round_.state[moving]), round_.nodes.at(moving + 1)
    rate = so3.log(pre.dR)[moving] / pre.T[moving, None]
    speed, told = np.zeros(len(moving)), np.zeros(len(moving), bool)
    odometer = prep.sensed.run.odometer
    if odometer is not None:
        stamp = scope.time + delay_of(prep, round_.at)
        speed = _speed(odometer, stamp) * _column(prep, names, "factor")
        told = heard(odometer.time, stamp, stamp)
    lateral = -_column(prep, names, "kappa") * prep.setup.vehicle.body.contact_length * rate[:, 2]
    roll, layout = float(prep.setup.vehicle.odometer.mount_b[1]), prep.setup.layout
    pace = np.linalg.norm(round_.at.v_n[moving + 1], axis=1)
    noise = velocity_noise(round_, names, pace, rate[:, 2], told)
    reading = VelocityReading(speed, lateral, rate, noise.sigma, roll)
    return with_noise(noise, lambda x: velocity(reading, layout, scope, x)), noise


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
