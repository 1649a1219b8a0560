"""What the running gear says between and at nodes: odometer and non-holonomic constraint."""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import Index, Scope
from factors.calibration import DELAY, TRACK_WIDTH, Layout, forward_of, lateral_of
from factors.displacement import DisplacementReading, OdometerSums, displacement, phase_prior
from factors.estimate import Estimate
from factors.odometer_model import Coefficient, OdometerModel
from factors.preintegration import Preintegrated, corrected, interval_of_increment
from factors.track_width import track_width
from factors.velocity import VelocityReading, velocity
from graphnav.common.run import Array, Odometer
from graphnav.graph.motion_noise import displacement_noise, track_width_noise, velocity_noise
from graphnav.graph.nodes import Nodes
from graphnav.graph.noise import Parts, States
from graphnav.graph.preparation import Prepared
from graphnav.graph.round import Factor, Round, with_noise
from graphnav.inertial.odometer_steps import RATE_S, heard, odometer_steps, odometer_sums, speed_at
from graphnav.inertial.standstill_evidence import Mask

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
    noise = displacement_noise(round_, on, names, sums, _column(prep, names, "factor"))
    reading = DisplacementReading(sums, _odometer_model(prep, names), noise.sigma)
    return with_noise(noise, lambda x: displacement(reading, layout, scope, x)), noise


def _odometer_model(prep: Prepared, names: States) -> OdometerModel:
    """What the odometer means in the state (n,) of each interval."""
    layout, vehicle = prep.setup.layout, prep.setup.vehicle
    kappa_l = _column(prep, names, "kappa") * vehicle.body.contact_length
    return OdometerModel(
        forward=_coefficient(
            layout, [forward_of(s) for s in names], _column(prep, names, "factor")
        ),
        lateral=_coefficient(layout, [lateral_of(s) for s in names], kappa_l),
        gauge=_column(prep, names, "half_gauge"),
        roll=float(vehicle.odometer.mount_b[1]),
    )


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
    prep, layout = round_.prep, round_.prep.setup.layout
    names, scope = driven(prep, round_.state[moving]), round_.nodes.at(moving + 1)
    spoken = _spoken(prep.sensed.run.odometer, scope.time + delay_of(prep, round_.at))
    rate_b = body_rate(round_, scope)
    noise = velocity_noise(round_, moving, names, rate_b[:, 2], spoken.heard)
    reading = VelocityReading(
        speed=spoken.speed,
        change=spoken.change,
        delay=delay_of(prep, round_.at),
        pace=np.linalg.norm(round_.at.v_n[scope.node], axis=1),
        rate_b=rate_b,
        model=_odometer_model(prep, names),
        sigma=noise.sigma,
    )
    return with_noise(noise, lambda x: velocity(reading, layout, scope, x)), noise


@dataclass(frozen=True)
class _Spoken:
    """What an odometer says at n times of its own clock."""

    speed: Array  # (n,) m/s
    change: Array  # (n,) m/s^2
    heard: Mask  # (n,) whether it says anything


def _spoken(odometer: Odometer | None, time: Array) -> _Spoken:
    """Speed as recorded; a counter has none of its own: differenced over 0.2 s."""
    none = np.zeros(len(time))
    if odometer is None:
        return _Spoken(none, none, none > 0)

    def speed(at: Array) -> Array:
        if odometer.pulse > 0:
            return speed_at(odometer, at)
        return np.interp(at, odometer.time, odometer.speed)

    change = (speed(time + RATE_S) - speed(time - RATE_S)) / (2 * RATE_S)
    return _Spoken(speed(time), change, heard(odometer.time, time, time))


def body_rate(round_: Round, at_nodes: Scope) -> Array:
    """The body's rate relative to the Earth at nodes (n, 3) rad/s, the mean of `RATE_S` to either
    side.
    """
    prep, edge = round_.prep, round_.prep.sensed.inc.edge
    owner = interval_of_increment(round_.nodes.edge)
    steps = corrected(prep.sensed.inc, round_.pre.errors[owner]).rotation
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    ends = np.clip(at_nodes.time + np.array([[-RATE_S], [RATE_S]]), edge[0], edge[-1])
    behind, ahead = np.stack([np.interp(ends, edge, angle) for angle in turned.T], -1)
    earth = so3.mtv(round_.at.R_nb[at_nodes.node], prep.setup.alignment.origin.Omega_n)
    return np.asarray((ahead - behind) / (ends[1] - ends[0])[:, None] - earth)


def driven(prep: Prepared, state: States) -> States:
    """States of intervals that are not wholly at rest: the edges of a stop are driven straight."""
    usual = "straight_high" if prep.setup.vehicle.kind == "tracked" else "moving"
    return np.where(np.isin(state, ("stop", "moving")), usual, state)


def _column(prep: Prepared, names: States, field: str) -> Array:
    """One column of the correction table for each interval, (n,)."""
    values = {state: float(getattr(row, field)) for state, row in prep.setup.table.items()}
    return np.array([values[str(s)] for s in names], dtype=np.float64)
