"""The running gear's factors vanish at the truth of a drive made without their equations.

The Earth turns fifty times too fast, clocks are off and the ground slips a lot: a sign or a
term that is wrong anywhere between the recorded odometer and the residual shows.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from factors import so3
from factors.block import Array, Scope
from factors.calibration import Component, Layout
from factors.displacement import DisplacementReading, displacement
from factors.estimate import Estimate
from factors.odometer_model import Coefficient, OdometerModel
from factors.preintegration import Increments, InertialNoise, corrected, preintegrate
from factors.track_width import track_width
from factors.velocity import VelocityReading, velocity
from graphnav.common.run import Odometer
from graphnav.inertial.odometer_steps import odometer_steps, odometer_sums

OMEGA = np.array([0.0, 3e-3, 2e-3])  # rad/s
MOUNT = np.array([0.03, -0.02, 0.05])  # pitch, roll, heading of the vehicle in the body
LEVER = np.array([0.4, -1.2, 0.3])
GYRO_BIAS = np.array([1e-3, -2e-3, 1.5e-3])
SCALE, DELAY, TAU = 0.02, 0.13, 0.02  # odometer's scale; s, its clock's lead; s, tyre slip
FACTOR, GAUGE, KAPPA_L = 0.8, 1.4, 0.6  # of a separated turn in low gear
STEP = 1e-3  # s, of the integrated truth
EVERY = 10  # of it, an increment
NODES = np.array([0, 100, 150, 300])
SIZES = {
    "gyro_bias": 3, "accel_bias": 3, "scale": 1, "mounting": 2, "lever": 3, "delay": 1,
    "forward:low": 1, "lateral:low": 1, "cornering": 1,
}  # fmt: skip
LAYOUT = Layout(tuple(Component(name, np.zeros(d), np.ones(d)) for name, d in SIZES.items()))


@dataclass(frozen=True)
class Drive:
    """Truth at the nodes, the rates there, and what was recorded."""

    x: Estimate
    rate_b: Array  # (N, 3) of the body against n
    v_m: Array  # (N, 3) velocity of the vehicle point in the vehicle's axes
    inc: Increments
    odometer: Odometer


def drive(tau: float, factor: float, gauge: float, kappa_l: float) -> Drive:
    """Three seconds of a bend; what the vehicle does about its odometer is given by A17, A23."""
    t = np.arange(-0.5, 3.5 + STEP / 2, STEP)
    v_o = 8.0 + 2.0 * np.sin(2 * t)  # as the odometer shows it, on the IMU's clock
    rate_m = np.stack([0.05 * np.cos(t), 0.04 * np.sin(3 * t), 0.5 + 0.2 * np.sin(t)], -1)
    R_bm = so3.exp(MOUNT)
    rate_b = rate_m @ R_bm.T
    turn = so3.exp(0.5 * STEP * (rate_b[1:] + rate_b[:-1]))
    R_nb = np.empty((len(t), 3, 3))
    R_nb[0] = so3.exp(np.array([0.1, -0.05, 0.7]))
    for k, step in enumerate(turn):
        R_nb[k + 1] = R_nb[k] @ step
    yaw = rate_b[:, 2]
    v_y = factor * (1 + SCALE) * v_o - gauge * np.abs(yaw)
    v_x = tau * v_o * yaw - kappa_l * yaw
    v_m = np.stack([v_x, v_y, 0 * v_y], -1)
    v_point = so3.mv(R_nb @ R_bm, v_m)
    p_point = np.concatenate(
        [np.zeros((1, 3)), np.cumsum(0.5 * STEP * (v_point[1:] + v_point[:-1]), 0)]
    )
    first = round(0.5 / STEP)
    edges = first + EVERY * np.arange(NODES[-1] + 1)
    at = edges[NODES]
    R_ib = so3.exp(OMEGA * t[edges][:, None]) @ R_nb[edges]
    edge = t[edges]
    dt = np.diff(edge)
    rotation = so3.log(so3.transpose(R_ib[:-1]) @ R_ib[1:]) + GYRO_BIAS * dt[:, None]
    none = np.zeros((len(dt), 3))
    # the odometer's clock is ahead: it stamps what happens at t with t + DELAY
    distance = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (v_o[1:] + v_o[:-1]))])
    return Drive(
        x=Estimate(
            R_nb[at],
            v_point[at] - so3.mv(R_nb[at], so3.cross(rate_b[at], LEVER)),
            p_point[at] - R_nb[at] @ LEVER,
            np.zeros(len(at)),
            calibration(tau, factor, kappa_l),
        ),
        rate_b=rate_b[at],
        v_m=v_m[at],
        inc=Increments(edge, rotation, none, none, np.zeros(len(dt))),
        odometer=Odometer(t + DELAY, distance, v_o, 0.0),
    )


def calibration(tau: float, factor: float, kappa_l: float) -> Array:
    """The truth as one segment (1, dim)."""
    known = {
        "gyro_bias": GYRO_BIAS, "accel_bias": np.zeros(3), "scale": SCALE,
        "mounting": MOUNT[[0, 2]], "lever": LEVER, "delay": DELAY, "forward:low": factor,
        "lateral:low": kappa_l, "cornering": tau,
    }  # fmt: skip
    return np.concatenate([np.atleast_1d(known[name]) for name in SIZES])[None]


def reading_of(d: Drive, gauge: float, bias: Array, delay: float) -> DisplacementReading:
    """The odometer summed as graphnav does, with a bias and a delay near the truth."""
    earth = so3.transpose(d.x.R_nb[:-1]) @ OMEGA
    errors = np.append(bias, np.zeros(9))
    pre = preintegrate(
        d.inc, NODES, np.tile(errors, (len(NODES) - 1, 1)), InertialNoise(1e-4, 1e-2)
    )
    owner = np.repeat(np.arange(len(NODES) - 1), np.diff(NODES))
    steps = odometer_steps(corrected(d.inc, errors), d.odometer, delay, earth[owner, 2])
    n = len(NODES) - 1

    return DisplacementReading(
        sums=odometer_sums(d.inc, pre, NODES, steps, earth),
        model=model_of(n, gauge),
        sigma=np.ones((n, 3)),
    )


def model_of(n: int, gauge: float) -> OdometerModel:
    """Of `drive`'s vehicle."""
    forward, lateral = every("forward:low", n), every("lateral:low", n)
    return OdometerModel(forward, lateral, np.full(n, gauge), float(MOUNT[1]))


def every(name: str, n: int) -> Coefficient:
    """A coefficient that all n factors have calibrated."""
    return Coefficient(np.full(n, np.nan), np.arange(n), np.full(n, LAYOUT.column(name)))


def scope() -> Scope:
    """Over all intervals, one calibration segment."""
    n = len(NODES) - 1
    return Scope(np.arange(n), np.zeros(n, np.int64), NODES[1:] * EVERY * STEP)


def worst(d: Drive, gauge: float, bias: Array = GYRO_BIAS, delay: float = DELAY) -> float:
    """Largest displacement residual, m."""
    block = displacement(reading_of(d, gauge, bias, delay), LAYOUT, scope(), d.x)
    return float(np.abs(block.residual).max())


def test_displacement_of_tyres_that_slip_in_a_bend() -> None:
    assert worst(drive(TAU, 1.0, 0.0, 0.0), 0.0) < 5e-4  # of 8 to 15 m


def test_displacement_of_a_separated_turn_in_low_gear() -> None:
    assert (
        worst(drive(0.0, FACTOR, GAUGE, KAPPA_L), GAUGE) < 4e-3
    )  # the turns' own Earth rate is left out


def test_displacement_of_sums_made_with_another_bias_and_delay() -> None:
    """What a relinearisation would change is there to first order."""
    d = drive(TAU, 1.0, 0.0, 0.0)
    # 1 mrad/s over 1.5 s and 12 m would be 9 mm and more, 10 ms of delay 80 mm
    assert worst(d, 0.0, GYRO_BIAS + 1e-3 * np.array([1, -1, 1]), DELAY - 0.01) < 4e-3


@pytest.mark.parametrize(
    "tau, factor, gauge, kappa_l", [(TAU, 1.0, 0.0, 0.0), (0.0, FACTOR, GAUGE, KAPPA_L)]
)
def test_velocity_of_the_vehicle_point(
    tau: float, factor: float, gauge: float, kappa_l: float
) -> None:
    """Read 20 ms beside the delay that holds, which the reading's change makes up for."""
    d = drive(tau, factor, gauge, kappa_l)
    ends = np.arange(1, len(NODES))
    node_time = d.inc.edge[NODES[ends]]
    off, n = 0.02, len(ends)
    stamp, half = node_time + DELAY - off, 0.01
    early, at, late = (
        np.interp(stamp + x, d.odometer.time, d.odometer.speed) for x in (-half, 0, half)
    )
    reading = VelocityReading(
        speed=at,
        change=(late - early) / (2 * half),
        delay=DELAY - off,
        pace=d.v_m[ends, 1],
        rate_b=d.rate_b[ends],
        model=model_of(n, gauge),
        sigma=np.ones((n, 3)),
    )
    block = velocity(reading, LAYOUT, replace(scope(), node=ends), d.x)
    # tyres slip by the vehicle's own speed, those of `drive` by the odometer's
    v_o = d.v_m[ends, 1] if gauge else d.v_m[ends, 1] / (1 + SCALE)
    aside = tau * d.rate_b[ends, 2] * (d.v_m[ends, 1] - v_o)
    # 20 ms of a speed that changes by up to 4 m/s^2 would be 80 mm/s; its bend is left out
    assert np.abs(block.residual[:, 0] + aside).max() < 1e-9
    assert np.abs(block.residual[:, 1:]).max() < 2e-3


def test_sides_of_a_skidding_vehicle() -> None:
    """The right side goes further in a turn to the left."""
    layout = Layout((Component("track_width", np.ones(1), np.ones(1)),))
    R_nb = np.stack([np.eye(3), so3.exp(np.array([0.0, 0.0, 0.4]))])
    x = Estimate(R_nb, np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), np.full((1, 1), 2.5))
    one = Scope(np.zeros(1, np.int64), np.zeros(1, np.int64), np.ones(1))
    assert abs(track_width(np.array([1.0]), np.ones(1), layout, one, x).residual[0, 0]) < 1e-12
