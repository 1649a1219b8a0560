"""What takes the place of accelerometers that were not recorded, axis by axis: the vehicle gains
speed as its running gear says, and roads are level on the whole.
"""

import numpy as np

from factors import so3
from factors.block import Index
from factors.driving import ExpectedDriving, driving
from factors.level import level
from graphnav.common.earth import G_STANDARD
from graphnav.common.run import Array
from graphnav.graph.motion import body_rate, delay_of
from graphnav.graph.motion_noise import DROPPED
from graphnav.graph.round import Factor, Round
from graphnav.inertial.odometer_steps import heard, speed_at, turned_to_middles
from graphnav.inertial.standstill_evidence import Mask

# orders of magnitude: a speed wanders about the odometer's by 0.3 m/s in a second, and where the
# odometer changes it may lie (wheels that slip, gears, a sign that it does not tell)
STEADY, CHANGE = 0.3, 1.0  # m/s/sqrt(s); of the change of the odometer's speed
PACE = 2.5  # m/s/sqrt(s), without an odometer: accelerations of 1 m/s^2 that last for 3 s
GRADE, GRADE_S = 0.05, 20.0  # 1 sigma of a road's slope and for how long it lasts: 5 % over 20 s


def unfelt_factors(round_: Round, at_standstill: Index, carried: Mask) -> list[Factor]:
    """Driving factors for the axes whose gain of speed the IMU does not tell, level factors for
    those that no accelerometer told; none where all did.

    Intervals in `at_standstill` say nothing new of the slope, what is `carried` (N - 1,) drives
    unlike its odometer.
    """
    sensed = np.array(round_.prep.sensed.run.sensed)
    felt, gains = sensed[3:], gains_told(sensed)
    if gains.all():
        return []
    expected, intervals = _expected(round_, carried, gains), round_.nodes.intervals
    found: list[Factor] = [lambda x: [driving(expected, intervals, x)]]
    return found if felt[:2].all() else [*found, _level(round_, at_standstill, felt)]


def gains_told(sensed: Mask) -> Mask:
    """Axes (3,) along which the accelerometer tells a gain of speed, by what of gyro and
    accelerometer (6,) was `sensed`: what is felt ahead (y) is as well a slope, unless the gyro
    about x tells that the vehicle did not tilt; and likewise across.
    """
    return np.asarray(sensed[3:] & np.append(sensed[[1, 0]], True))


def _expected(round_: Round, carried: Mask, gains: Mask) -> ExpectedDriving:
    """The odometer's change of speed, told at the IMU; its sigma grows with it. Nothing is said
    along the axes (3,) whose gain of speed the IMU tells.
    """
    prep, nodes, at = round_.prep, round_.nodes, round_.at
    vehicle, odometer, T = prep.setup.vehicle.odometer, prep.sensed.run.odometer, round_.pre.T
    rate_b = body_rate(round_, nodes.at(np.arange(len(nodes.time)), nodes.time))
    u_b = -so3.cross(rate_b, np.broadcast_to(vehicle.lever_b, rate_b.shape))
    told = np.zeros(len(T), bool)
    if odometer is not None:
        stamp = nodes.time + delay_of(prep, at)
        u_b = u_b + speed_at(odometer, stamp)[:, None] * so3.exp(vehicle.mount_b)[:, 1]
        told = heard(odometer.time, stamp[:-1], stamp[1:]) & ~carried
    change = np.diff(u_b, axis=0) * told[:, None]
    density = np.where(told, STEADY, PACE)
    along = np.hypot(density * np.sqrt(T), CHANGE * np.linalg.norm(change, axis=1))
    sigma = along[:, None] * np.where(gains, DROPPED, 1.0)
    return ExpectedDriving(
        T=T,
        change=change,
        turn=_mean_turn(round_),
        sigma_v=sigma,
        sigma_p=sigma * T[:, None] / np.sqrt(12),
    )


def _mean_turn(round_: Round) -> Array:
    """Mean rotation since the node over each interval, (N - 1, 3, 3)."""
    inc, pre, edge = round_.prep.sensed.inc, round_.pre, round_.nodes.edge
    lasting = turned_to_middles(inc, pre, edge) * np.diff(inc.edge)[:, None, None]
    return np.asarray(np.add.reduceat(lasting, edge[:-1], axis=0) / pre.T[:, None, None])


def _level(round_: Round, at_standstill: Index, felt: Mask) -> Factor:
    """The vehicle level but for slopes that come and go: nodes share what lasts."""
    prep, nodes = round_.prep, round_.nodes
    moving = round_.pre.T.copy()
    moving[at_standstill] = 0
    share = 0.5 * (np.append(moving, 0) + np.append(0, moving))  # s of driving about each node
    slope = GRADE * np.sqrt(2 * GRADE_S / np.maximum(share, 1 / DROPPED))
    # a missing y tells no pitch, a missing x no roll
    sigma = G_STANDARD * slope[:, None] * np.where(felt[:2], DROPPED, 1.0)
    g_n = prep.setup.alignment.origin.gravity(np.zeros(3))
    up_b = so3.exp(prep.setup.vehicle.odometer.mount_b)[:, 2] * np.linalg.norm(g_n)
    force_b = np.broadcast_to(up_b, (len(nodes.time), 3))
    scope = nodes.at(np.arange(len(nodes.time)), nodes.time)
    return lambda x: [level(force_b, g_n, sigma, prep.setup.layout, scope, x)]
