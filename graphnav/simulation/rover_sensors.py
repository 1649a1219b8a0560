"""What a simulated rover's sensors record of its true motion."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from factors import rocker_bogie as rb
from factors import so3
from graphnav.common.angles import rotation_of_angles
from graphnav.common.earth import Origin
from graphnav.simulation import rover_ground as ground

Array = NDArray[np.float64]

GEAR_DT, IMU_DT, SUN_DT = 0.1, 0.05, 1.0  # s


@dataclass(frozen=True)
class Conditions:
    """Ground and sensors; one sigma where not said otherwise."""

    duration: float = 3600.0  # s
    gyro: bool = False  # a MEMS gyro is fitted
    slope: float = 0.09  # rad RMS of the ground along a line
    slip: float = 0.2  # greatest slip of the ground
    slip_spread: float = 0.02  # of single wheels about it
    side_slip: float = 0.15  # sideways drift per speed and sine of the roll angle
    side_slip_spread: float = 0.005  # rad, of single wheels against their steered direction
    episodes: int = 4  # spells of one wheel spinning or blocked
    joint_noise: float = 0.0005  # rad
    joint_offset: float = 0.001  # rad
    steer_noise: float = 0.002  # rad
    steer_offset: float = 0.003  # rad
    wheel_noise: float = 0.005  # rad/s
    sun_noise: float = np.radians(0.3)
    sun_share: float = 0.5
    accel_bias: float = 0.01  # m/s^2
    accel_noise: float = 0.02  # m/s^2 per sample, standing
    shaking: float = 0.3  # m/s^2 per m/s of speed and sample
    gyro_bias: float = np.radians(40.0) / 3600  # rad/s
    gyro_noise: float = np.radians(0.3) / 60  # rad/sqrt(s)


@dataclass(frozen=True)
class Motion:
    """True motion on the gear's time grid."""

    time: Array  # (N,) s
    pose: ground.Pose
    heading: Array  # (N,) rad, unwrapped
    pitch: Array
    roll: Array
    joints: rb.Joints  # with steering
    wheel: Array  # (N, 6) rad/s, counted against the link
    slip_coefficient: Array  # (N,) k_s of the ground, single-wheel episodes left out


def gear(rng: np.random.Generator, c: Conditions, m: Motion) -> pd.DataFrame:
    """Wheel rates, steering and linkage angles at 10 Hz, with steady offsets and noise."""
    n = len(m.time)
    steer = m.joints.steer + rng.normal(0, c.steer_offset, 6) + rng.normal(0, c.steer_noise, (n, 6))
    joints = np.column_stack([m.joints.rocker, m.joints.bogie])
    joints = joints + rng.normal(0, c.joint_offset, 3) + rng.normal(0, c.joint_noise, (n, 3))
    wheel = m.wheel + rng.normal(0, c.wheel_noise, (n, 6)) * (np.abs(m.wheel) > 1e-6)
    table = {"time": m.time}
    table |= {f"wheel_{i + 1}": wheel[:, i] for i in range(6)}
    table |= {f"steer_{i + 1}": steer[:, i] for i in range(6)}
    names = ("rocker", "bogie_left", "bogie_right")
    table |= {name: joints[:, i] for i, name in enumerate(names)}
    return pd.DataFrame(table)


def imu(rng: np.random.Generator, c: Conditions, m: Motion, origin: Origin) -> pd.DataFrame:
    """Accelerometer and, where fitted, gyro at 20 Hz, in the body origin."""
    time = np.arange(0.0, c.duration + IMU_DT / 2, IMU_DT)
    angles = CubicSpline(m.time, np.column_stack([m.roll, m.pitch, m.heading]))
    place = CubicSpline(m.time, m.pose.p_n)
    R = rotation_of_angles(*angles(time).T)
    R_mid = rotation_of_angles(*angles(time[1:] - IMU_DT / 2).T)
    a_n = np.diff(place(time, 1), axis=0) / IMU_DT
    force = np.einsum("nji,nj->ni", R_mid, a_n - origin.gravity(place(time[1:])))
    speed = np.linalg.norm(place(time[1:], 1), axis=1)[:, None]
    n = len(force)
    force += rng.normal(0, c.accel_bias, 3)
    force += rng.normal(0, 1, (n, 3)) * np.hypot(c.accel_noise, c.shaking * speed)
    table = {"time": time[1:]} | {f"accel_{a}": force[:, i] for i, a in enumerate("xyz")}
    if c.gyro:
        w = so3.log(so3.transpose(R[:-1]) @ R[1:]) / IMU_DT + so3.mtv(R_mid, origin.Omega_n)
        w += rng.normal(0, c.gyro_bias, 3) + rng.normal(0, c.gyro_noise / np.sqrt(IMU_DT), (n, 3))
        table |= {f"gyro_{a}": w[:, i] for i, a in enumerate("xyz")}
    return pd.DataFrame(table)


def sun(rng: np.random.Generator, c: Conditions, m: Motion) -> pd.DataFrame:
    """`heading_deg` in spells of about one to five minutes, `c.sun_share` of the time in all."""
    spells = rng.uniform(40, 300, 2 * int(c.duration / 340 + 1))
    spells[::2] *= c.sun_share / spells[::2].sum()
    spells[1::2] *= (1 - c.sun_share) / spells[1::2].sum()
    ends = np.cumsum(spells) * c.duration
    time = np.arange(0.0, c.duration, SUN_DT)
    time = time[np.searchsorted(ends, time, side="right") % 2 == 0]
    seen = np.interp(time, m.time, m.heading) + rng.normal(0, c.sun_noise, len(time))
    return pd.DataFrame({"time": time, "heading_deg": np.degrees(seen) % 360})
