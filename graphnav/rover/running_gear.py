"""A rover's running gear made ready for the graph: motion of the wheels, sums between nodes.

Everything the graph needs to know about noise is taken from the run itself: how far wheels differ
from each other, how the accelerometer shakes, how the heading sensor scatters.
"""

from dataclasses import dataclass, replace

import numpy as np

from factors import rocker_bogie as rb
from factors.rover_wheels import WheelSums
from graphnav.common.errors import InputError
from graphnav.common.run import Accelerometer, Array, ExternalHeading, Imu, RoverGear
from graphnav.reading.vehicle import RoverSpec

SMOOTH_S = 1.0  # joint angles are smoothed over this before they are differenced
FASTEST = 50.0  # m/s on the whole
GAP_S = 1.0  # a longer silence of the running gear is a gap
FIT_SAMPLES = 3000  # of the run, from which the wheels' spread is taken
UNSTEERED = 1.0  # spread across wheels of unknown steering
K_GUESS = 0.9  # slip coefficient while nothing is known yet (C6)
HEADING_SD_RANGE = np.deg2rad([0.05, 3.0])


@dataclass(frozen=True)
class Wheels:
    """The wheels' motion on the gear's clock, and its running integrals at k_s = 1."""

    time: Array  # (N,) s
    wheels_b: Array  # (N, 6, 3) m, wheel centres from the IMU
    motion: rb.BodyMotion
    spread: rb.WheelSpread
    yaw: Array  # (N,) rad, integral of w_z
    path: Array  # (N,) m, way rolled
    ahead: Array  # (N,) m
    swept: np.ndarray[
        tuple[int], np.dtype[np.complex128]
    ]  # (N,) m, right + i forward, in yaw's axes
    climb: Array  # (N,) m
    heard: Array  # (N,) s, time with three wheels or more


def linkage_of(spec: RoverSpec, path: str) -> rb.Linkage:
    """Geometry from the vehicle file; InputError names the first key that is missing."""
    values = {name: getattr(spec, name) for name in rb.Linkage.__dataclass_fields__}
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise InputError(
            f"{path}: the vehicle file lacks [rover] {', '.join(missing)} [m]; "
            "docs/rover.md draws them"
        )
    return rb.Linkage(**values)


def wheels_of(gear: RoverGear, linkage: rb.Linkage, lever_b: Array, where: str = "run") -> Wheels:
    """Robust C2 and C4 over the whole run, the wheels' spread fitted to the run.

    `lever_b` (3,) m leads from the IMU to the linkage's body origin. Raises InputError, which
    `where` begins, when the wheels cannot have rolled like that.
    """
    joints = rb.Joints(
        steer=_filled(gear.steer, gear.time),
        rocker=_filled(gear.rocker[:, None], gear.time)[:, 0],
        bogie=_filled(np.column_stack([gear.bogie_left, gear.bogie_right]), gear.time),
    )
    rates = rb.Joints(
        steer=np.zeros_like(joints.steer),
        rocker=_rate(joints.rocker[:, None], gear.time)[:, 0],
        bogie=_rate(joints.bogie, gear.time),
    )
    spread = rb.WheelSpread()
    some = slice(None, None, max(1, len(gear.time) // FIT_SAMPLES))
    for _ in range(3):
        few = (gear.wheel[some], _picked(joints, some), _picked(rates, some))
        spread = rb.fitted_spread(rb.body_motion(linkage, *few, spread))
        if not joints.steer.any():  # no steering told: the wheels may slide sideways
            spread = replace(spread, side=UNSTEERED)
    motion = rb.body_motion(linkage, gear.wheel, joints, rates, spread)
    motion = replace(motion, centroid_b=motion.centroid_b + lever_b)
    wheels_b = rb.wheel_positions(linkage, joints) + lever_b
    return _integrated(gear.time, wheels_b, motion, spread, where)


def _integrated(
    time: Array, wheels_b: Array, motion: rb.BodyMotion, spread: rb.WheelSpread, where: str
) -> Wheels:
    known = np.isfinite(motion.w_z)
    if np.count_nonzero(known) < 2:
        raise InputError(
            f"{where}: the running gear never has three wheels at once: check wheel_1 .. wheel_6"
        )
    path = _integral(motion.speed, time)
    took = time[-1] - time[0]
    if path[-1] > FASTEST * took:
        raise InputError(
            f"{where}: the wheels roll {path[-1]:.3g} m in {took:.3g} s, as no rover does: set "
            "the unit of wheel_1 .. wheel_6 under [columns], or mend [rover] wheel_radius [m]"
        )
    v_b = np.stack([np.interp(time, time[known], motion.v_b[known, i]) for i in range(3)], -1)
    yaw = _integral(np.interp(time, time[known], motion.w_z[known]), time)
    turn = np.exp(1j * K_GUESS * yaw)
    dt = np.diff(time, prepend=time[0])
    heard = known & (dt < GAP_S)
    return Wheels(
        time=time,
        wheels_b=wheels_b,
        motion=motion,
        spread=spread,
        yaw=yaw,
        path=path,
        ahead=_integral(v_b[:, 1], time),
        swept=_integral(v_b[:, 0] * turn.real - v_b[:, 1] * turn.imag, time)
        + 1j * _integral(v_b[:, 0] * turn.imag + v_b[:, 1] * turn.real, time),
        climb=_integral(v_b[:, 2], time),
        heard=np.cumsum(np.where(heard, dt, 0.0)),
    )


def sums_between(wheels: Wheels, node_time: Array) -> WheelSums:
    """The wheels' displacement, way and yaw between nodes, and the centroid at them."""

    def at(value: Array, time: Array = node_time) -> Array:
        return np.interp(time, wheels.time, value)

    yaw = at(wheels.yaw)
    swept = np.diff(at(wheels.swept.real) + 1j * at(wheels.swept.imag))
    level = swept * np.exp(-1j * K_GUESS * 0.5 * (yaw[1:] + yaw[:-1]))
    return WheelSums(
        displacement=np.stack([level.real, level.imag, np.diff(at(wheels.climb))], -1),
        path=np.diff(at(wheels.path)),
        ahead=np.diff(at(wheels.ahead)),
        yaw=np.diff(yaw),
        centroid_b=np.stack([at(c) for c in wheels.motion.centroid_b.T], -1),
    )


def heard_share(wheels: Wheels, node_time: Array) -> Array:
    """Share (n,) of each interval in which enough wheels were heard."""
    return np.diff(np.interp(node_time, wheels.time, wheels.heard)) / np.diff(node_time)


def origin_velocity(wheels: Wheels, node_time: Array) -> Array:
    """Velocity of the IMU (N, 3) m/s at k_s = 1, smoothed over a second, b axes."""
    half = 0.5
    ahead, behind = node_time + half, node_time - half
    span = np.diff([np.interp(t, wheels.time, wheels.time) for t in (behind, ahead)], axis=0)[0]
    span = np.maximum(span, 1e-6)[:, None]
    mean = sums_between(wheels, np.stack([behind, ahead], -1).ravel())
    v_c = mean.displacement[::2] / span
    w_z = mean.yaw[::2, None] / span
    c = np.stack([np.interp(node_time, wheels.time, x) for x in wheels.motion.centroid_b.T], -1)
    return np.asarray(v_c - w_z * np.stack([-c[:, 1], c[:, 0], np.zeros(len(c))], -1))


@dataclass(frozen=True)
class Levelling:
    """Mean specific force about each node and how well it is known."""

    force_b: Array  # (N, 3) m/s^2, NaN where no sample
    sigma: Array  # (N,) m/s^2, of each axis


QUASI_STATIC = 0.02  # m/s^2, accelerations of the body that are not gravity, over a second


def levelling(source: Imu | Accelerometer, node_time: Array) -> Levelling:
    """Accelerometer means over the second about each node; scatter inside it sets the sigma."""
    n = len(node_time)
    owner = np.searchsorted(0.5 * (node_time[1:] + node_time[:-1]), source.time)
    close = np.abs(source.time - node_time[owner]) <= 1.0
    owner, accel = owner[close], source.accel[close]
    count = np.bincount(owner, minlength=n)
    some = np.maximum(count, 1)
    mean = np.stack([np.bincount(owner, a, n) / some for a in accel.T], -1)
    rest = accel - mean[owner]
    scatter = np.bincount(owner, np.mean(rest**2, axis=1), n) / some
    noise = np.sqrt(np.maximum(scatter, np.median(scatter)) / some)
    mean[count == 0] = np.nan
    return Levelling(mean, np.hypot(noise, QUASI_STATIC))


def heading_sd(seen: ExternalHeading, wheels: Wheels) -> float:
    """Scatter [rad] of the heading sensor: neighbouring samples less the wheels' yaw."""
    steady = seen.heading + K_GUESS * np.interp(seen.time, wheels.time, wheels.yaw)
    near = np.diff(seen.time) < 5.0
    if np.count_nonzero(near) < 10:
        return float(np.deg2rad(1.0))
    jump = np.angle(np.exp(1j * np.diff(steady)))[near]
    return float(np.clip(1.4826 * np.median(np.abs(jump)) / np.sqrt(2), *HEADING_SD_RANGE))


def _picked(joints: rb.Joints, some: slice) -> rb.Joints:
    return rb.Joints(joints.steer[some], joints.rocker[some], joints.bogie[some])


def _integral(rate: Array, time: Array) -> Array:
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _rate(value: Array, time: Array) -> Array:
    """Derivative (N, K) of smoothed columns."""
    half = round(0.5 * SMOOTH_S / float(np.median(np.diff(time))))
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(value, ((half, half), (0, 0)), mode="edge")
    smooth = [np.convolve(c, window / window.sum(), "valid") for c in padded.T]
    return np.stack([np.gradient(c, time) for c in smooth], -1)


def _filled(value: Array, time: Array) -> Array:
    """Blanks interpolated column by column; a column that is all blank is zero."""
    out = np.zeros_like(value)
    for i, column in enumerate(value.T):
        known = np.isfinite(column)
        if known.any():
            out[:, i] = np.interp(time, time[known], column[known])
    return out
