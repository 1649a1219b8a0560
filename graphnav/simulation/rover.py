"""Scenario `rover`: one hour of a six-wheeled rocker-bogie rover over uneven, slippery ground.

The body follows a planned course; its height, roll, pitch and linkage angles are those with which
all six wheel centres touch the ground; each wheel is steered along its own velocity and turns
faster than it rolls by the slip of the ground under it. The IMU sits in the body origin.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from factors import rocker_bogie as rb
from graphnav.common.earth import Origin
from graphnav.simulation import rover_ground as ground
from graphnav.simulation import rover_sensors as sensors
from graphnav.simulation.grades import DEG_H, DEG_SQRT_H, MG, ImuErrors
from graphnav.simulation.rover_sensors import GEAR_DT, IMU_DT, Conditions, Motion

Array = NDArray[np.float64]

LINKAGE = rb.Linkage(
    l_m1=0.32, l_m2=0.58, l_r1=0.30, l_r2=0.30, d_a1=0.36, d_a2=0.22, d_a3=0.22, d_r=0.14,
    l_x=0.05, l_z=0.02, l_d=0.55, wheel_radius=0.15,
)  # fmt: skip
ORIGIN = Origin(np.radians(40.12), np.radians(98.45), 1250.0)
CLOCK_START = 1000.0  # s
TRUTH_DT = 1.0  # s
LEAST = 1e-3  # mg; a vehicle file states no perfect sensor
START_HEADING_SD = np.radians(1.0)


@dataclass(frozen=True)
class Simulated:
    """One simulated run in the layout of interface.md."""

    run: pd.DataFrame
    truth: pd.DataFrame  # and, beyond interface.md, the column slip_coefficient
    vehicle: str  # TOML

    def write(self, out: Path) -> None:
        """run.csv, truth.csv and vehicle.toml into the directory `out`."""
        out.mkdir(parents=True, exist_ok=True)
        self.run.to_csv(out / "run.csv", index=False, float_format="%.9g")
        self.truth.to_csv(out / "truth.csv", index=False, float_format="%.12g")
        (out / "vehicle.toml").write_text(self.vehicle)


def with_gyro(c: Conditions, grade: ImuErrors) -> Conditions:
    """The same ground with gyros of a grade fitted."""
    return replace(
        c,
        gyro=True,
        gyro_bias=grade.gyro_bias_deg_h * DEG_H,
        gyro_noise=grade.gyro_noise_deg_sqrt_h * DEG_SQRT_H,
    )


def simulate(seed: int, conditions: Conditions | None = None) -> Simulated:
    """One run; the same seed and conditions give the same files."""
    c = conditions or Conditions()
    rng = np.random.default_rng(seed)
    motion = drive(rng, c)
    tables = [sensors.gear(rng, c, motion), sensors.imu(rng, c, motion, ORIGIN)]
    run = _merged([*tables, sensors.sun(rng, c, motion)])
    start_heading = float(motion.heading[0] + rng.normal(0, START_HEADING_SD))
    return Simulated(run=run, truth=_truth(motion), vehicle=_vehicle(c, motion, start_heading))


def drive(rng: np.random.Generator, c: Conditions) -> Motion:
    """The true motion: course, pose on the ground, wheel rates with slip."""
    surface = ground.terrain(rng, c.slope)
    time = np.arange(0.0, c.duration + GEAR_DT / 2, GEAR_DT)
    speed, w_up = plan(rng, time)
    heading = rng.uniform(-np.pi, np.pi) - CubicSpline(time, w_up).antiderivative()(time)
    ahead = np.stack([np.sin(heading), np.cos(heading)], -1)
    right = np.stack([np.cos(heading), -np.sin(heading)], -1)
    planned = _integral(time, speed[:, None] * ahead)
    coarse = slice(None, None, 10)
    on_plan = ground.settle(LINKAGE, surface, planned[coarse], heading[coarse])
    tilt = CubicSpline(time[coarse], -on_plan.R_nb[:, 2, 0])(time)  # right side down
    sideways = c.side_slip * speed * tilt
    en = _integral(time, speed[:, None] * ahead + sideways[:, None] * right)
    pose = ground.settle(LINKAGE, surface, en, heading)
    drift_n = sideways[:, None] * pose.R_nb[:, :, 0]
    joints, rolling, link_turn = _wheels(time, pose, drift_n)
    skewed = ground.random_field(rng, 1.0, 5.0, 0.5).value(pose.wheels_n[..., :2])
    joints = replace(joints, steer=joints.steer + c.side_slip_spread * skewed)
    slip = _slip(rng, c, pose)
    wheel = rolling / (1 - slip) + link_turn
    return Motion(
        time=time,
        pose=pose,
        heading=heading,
        pitch=np.arcsin(pose.R_nb[:, 2, 1]),
        roll=np.arctan2(-pose.R_nb[:, 2, 0], pose.R_nb[:, 2, 2]),
        joints=joints,
        wheel=_misbehaving(rng, c, wheel),
        slip_coefficient=1 / np.mean(1 / (1 - slip), axis=1),
    )


def plan(rng: np.random.Generator, time: Array) -> tuple[Array, Array]:
    """Speed (N,) m/s and yaw rate (N,) rad/s, left positive: stops, straights, turns."""
    legs = [(40.0, 0.0, 0.0)]  # seconds, speed, yaw rate
    while sum(leg[0] for leg in legs) < time[-1] - 20.0:
        kind = rng.choice(["straight", "arc", "turn", "stop"], p=[0.40, 0.42, 0.09, 0.09])
        speed, sign = rng.uniform(0.05, 0.2), rng.choice([-1.0, 1.0])
        if kind == "straight":
            legs.append((rng.uniform(30, 120), speed, 0.0))
        elif kind == "arc":
            legs.append((rng.uniform(20, 60), speed, sign * speed / rng.uniform(2.5, 6.0)))
        elif kind == "turn":
            standstill = (4.0, 0.0, 0.0)
            legs += [
                standstill,
                (rng.uniform(8, 25), 0.0, sign * rng.uniform(0.04, 0.08)),
                standstill,
            ]
        else:
            legs.append((rng.uniform(10, 60), 0.0, 0.0))
    ends = np.cumsum([leg[0] for leg in legs])
    at = np.array(legs)[np.minimum(np.searchsorted(ends, time), len(legs) - 1)]
    at[time > time[-1] - 20.0] = 0.0
    window = np.hanning(32)[1:-1]  # 3 s
    window /= window.sum()
    eased = [np.convolve(np.pad(col, 15, mode="edge"), window)[29:][: len(time)] for col in at.T]
    return eased[1], eased[2]


def _integral(time: Array, rate: Array) -> Array:
    return np.asarray(CubicSpline(time, rate).antiderivative()(time))


def _rate(time: Array, value: Array) -> Array:
    return np.asarray(CubicSpline(time, value)(time, 1))


def _wheels(time: Array, pose: ground.Pose, drift_n: Array) -> tuple[rb.Joints, Array, Array]:
    """Steering along each wheel's velocity, rolling rates (N, 6) and the axles' turning (N, 6)."""
    v_n = _rate(time, pose.wheels_n) - drift_n[:, None]
    v_b = np.einsum("nji,nwj->nwi", pose.R_nb, v_n)
    pitch = rb.link_pitch(pose.joints)
    c, s = np.cos(pitch), np.sin(pitch)
    ahead, above = v_b[..., 1] * c + v_b[..., 2] * s, v_b[..., 2] * c - v_b[..., 1] * s
    forward = np.where(ahead < 0, -1.0, 1.0)
    steer = np.arctan2(forward * v_b[..., 0], forward * ahead)
    moving = np.hypot(v_b[..., 0], ahead) > 2e-3
    for i in range(6):  # standing: the wheel is on its way from the last angle to the next
        on = moving[:, i]
        steer[:, i] = np.interp(time, time[on], steer[on, i]) if on.any() else 0.0
    u_speed = v_b[..., 0] * np.sin(steer) + ahead * np.cos(steer)
    rolling = np.sign(u_speed) * np.hypot(u_speed, above) / LINKAGE.wheel_radius
    joint_rates = rb.Joints(
        steer=np.zeros_like(steer),
        rocker=_rate(time, pose.joints.rocker),
        bogie=_rate(time, pose.joints.bogie),
    )
    w_b = _body_rate(time, pose.R_nb)
    link_w = rb.link_pitch(joint_rates) + w_b[:, :1]
    across = w_b[:, 1:2] * c + w_b[:, 2:] * s  # link's own forward axis
    link_turn = link_w * np.cos(steer) - across * np.sin(steer)
    return replace(pose.joints, steer=steer), rolling, link_turn


def _body_rate(time: Array, R_nb: Array) -> Array:
    """Angular rate (N, 3) rad/s in b."""
    dR = _rate(time, R_nb)
    S = np.einsum("nji,njk->nik", R_nb, dR)
    return 0.5 * np.stack(
        [S[:, 2, 1] - S[:, 1, 2], S[:, 0, 2] - S[:, 2, 0], S[:, 1, 0] - S[:, 0, 1]], -1
    )


def _slip(rng: np.random.Generator, c: Conditions, pose: ground.Pose) -> Array:
    """Slip (N, 6) of each wheel on the ground under it, 0 to `c.slip`."""
    soft, patch = (ground.random_field(rng, a, b, 0.5) for a, b in ((8.0, 80.0), (1.0, 5.0)))
    en = pose.wheels_n[..., :2]
    broad = 0.5 * c.slip * (1 + np.tanh(1.2 * soft.value(en)))
    return np.clip(broad + c.slip_spread * patch.value(en), 0.0, c.slip)


def _misbehaving(rng: np.random.Generator, c: Conditions, wheel: Array) -> Array:
    """Spells of 5-20 s in which one wheel spins half as fast again, or is blocked."""
    out = wheel.copy()
    for _ in range(c.episodes):
        start = rng.integers(600, max(len(wheel) - 200, 601))
        span = slice(start, start + rng.integers(50, 200))
        out[span, rng.integers(6)] *= rng.choice([0.0, 1.5])
    return out


def _merged(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """One row per instant, blank where a sensor has no sample."""
    keyed = [t.assign(time=(t["time"] + CLOCK_START).round(6)).set_index("time") for t in tables]
    return pd.concat(keyed, axis=1).sort_index().reset_index()


def _truth(m: Motion) -> pd.DataFrame:
    rows = slice(None, None, round(TRUTH_DT / GEAR_DT))
    lat, lon, height = ORIGIN.geodetic(m.pose.p_n[rows])
    v_n = _rate(m.time, m.pose.p_n)[rows]
    table = {
        "time": m.time[rows] + CLOCK_START,
        "lat": np.degrees(lat), "lon": np.degrees(lon), "height": height,
        "v_e": v_n[:, 0], "v_n": v_n[:, 1], "v_u": v_n[:, 2],
        "roll_deg": np.degrees(m.roll[rows]), "pitch_deg": np.degrees(m.pitch[rows]),
        "heading_deg": np.degrees(m.heading[rows]) % 360,
        "state": np.where(np.abs(m.wheel[rows]).max(axis=1) > 1e-3, "moving", "stop"),
        "slip_coefficient": m.slip_coefficient[rows],
    }  # fmt: skip
    return pd.DataFrame(table)


def _vehicle(c: Conditions, m: Motion, heading: float) -> str:
    lat, lon, height = (float(x[0]) for x in ORIGIN.geodetic(m.pose.p_n[:1]))
    geometry = "\n".join(f"{name} = {value}" for name, value in vars(LINKAGE).items())
    gyro = f"""gyro_bias_deg_h = {np.degrees(c.gyro_bias) * 3600:.3g}
gyro_noise_deg_sqrt_h = {np.degrees(c.gyro_noise) * 60:.3g}
"""
    return f"""# simulated rover; see docs/rover.md for the linkage's names
[vehicle]
kind = "rover"

[rover]
{geometry}

[imu]
axes = "RFU"
{gyro if c.gyro else ""}accel_bias_mg = {max(c.accel_bias / MG, LEAST):.3g}
accel_noise_mg_sqrt_hz = {max(c.accel_noise * np.sqrt(IMU_DT) / MG, LEAST):.3g}

[start]
lat = {np.degrees(lat):.9f}
lon = {np.degrees(lon):.9f}
height = {height:.3f}
heading_deg = {np.degrees(heading) % 360:.3f}
heading_sd_deg = {np.degrees(START_HEADING_SD):.3g}
"""
