"""What the sensors make of a drive: run.csv, truth.csv, vehicle.toml and the true constants."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from graphnav.common.errors import InputError
from graphnav.simulation.drive import INTERNAL_HZ, Driven, Options, Setup, stream
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.gnss import ANTENNA, fixes
from graphnav.simulation.grades import DEG_H, GRADES, MG, Disturbed, disturb

TRUTH_HZ = 10
KEPT_EVERY = 10.0  # s, of the true bias and scale curves
SPEED_HZ = 10  # of odo_speed
SPEED_NOISE = 0.03  # m/s


@dataclass(frozen=True)
class Recording:
    """One simulated run, ready to be written."""

    run: pd.DataFrame
    truth: pd.DataFrame
    vehicle: str  # TOML
    calibration: dict[str, Any]  # truth_calibration.json


def record(driven: Driven, options: Options) -> Recording:
    """Add the sensors' errors. Raises InputError on an unknown grade."""
    setup = driven.setup
    if setup.grade not in GRADES:
        raise InputError(f"IMU grade '{setup.grade}' is unknown: use {', '.join(GRADES)}")
    rng = stream(options.seed, "imu")
    truth = driven.truth
    imu = disturb(rng, GRADES[setup.grade], truth.gyro, truth.accel, 1 / options.rate_hz)
    run = {"time": np.round(truth.time[1:], 6)}
    for axis, name in enumerate("xyz"):
        run[f"gyro_{name}"] = np.round(imu.gyro[:, axis], 12)
    for axis, name in enumerate("xyz"):
        run[f"accel_{name}"] = np.round(imu.accel[:, axis], 9)
    scale = scale_curve(stream(options.seed, "scale"), truth.time, driven)
    run |= _odometer(stream(options.seed, "odometer"), driven, scale, options)
    if options.gnss:
        run |= fixes(stream(options.seed, "gnss"), truth)
    constants = _constants(driven, imu, scale, options.rate_hz)
    start_deg = float(truth.angles_deg[0, 2])
    wrong_deg = stream(options.seed, "start").normal(0.0, setup.heading_sd_deg)
    return Recording(
        run=pd.DataFrame(run),
        truth=_truth(driven, options.rate_hz),
        vehicle=_vehicle(setup, (start_deg + wrong_deg) % 360, options.gnss),
        calibration={
            "seed": options.seed,
            "ground": options.ground,
            "grade": {"name": setup.grade, **asdict(GRADES[setup.grade])},
            "distance_m": float(np.sum(driven.commands.speed) / INTERNAL_HZ),
            "start_heading_deg": start_deg,
            "calibration": constants,
            "events": [asdict(e) | {"axis": e.axis} for e in driven.events],
        },
    )


def scale_curve(rng: np.random.Generator, time: Array, driven: Driven) -> Array:
    """True over indicated distance at each sample node (N + 1,), methods B.

    Pulses: warm-up of tyres or sprockets and a slow wave; wheels also lose 1.5 permille at once.
    A speed column is off by one constant, up to 1.5 %.
    """
    if not driven.setup.pulse:
        return np.full(len(time), 1 / (1 + rng.uniform(0.005, 0.015) * rng.choice([-1.0, 1.0])))
    warm_up = rng.uniform(2e-3, 4e-3) * rng.choice([-1.0, 1.0])
    curve = warm_up * (1 - np.exp(-time / rng.uniform(500, 900)))
    period, phase = rng.uniform(1200, 2500), rng.uniform(0, 2 * np.pi)
    curve += rng.uniform(5e-4, 1e-3) * np.sin(2 * np.pi * time / period + phase)
    if 'kind = "wheeled"' in driven.setup.vehicle:
        puncture = rng.uniform(0.35, 0.75) * time[-1]
        curve += 1.5e-3 * rng.choice([-1.0, 1.0]) * (time >= puncture)
    return np.asarray(1 + curve)


def _odometer(
    rng: np.random.Generator, driven: Driven, scale: Array, options: Options
) -> dict[str, Array]:
    """`odo_pulses` at every sample or `odo_speed` at 10 Hz."""
    speed, dt, every = driven.odometer_speed, 1 / INTERNAL_HZ, options.every
    if not driven.setup.pulse:
        column = np.full(len(scale) - 1, np.nan)
        apart = options.rate_hz // SPEED_HZ
        at = slice(apart - 1, None, apart)
        clean = speed[every::every][at] / scale[1:][at]
        column[at] = np.round(clean + SPEED_NOISE * rng.standard_normal(len(clean)), 4)
        return {"odo_speed": column}
    step = 0.5 * (speed[1:] + speed[:-1]) * dt
    per_sample = step.reshape(-1, every).sum(1) / (0.5 * (scale[1:] + scale[:-1]))
    counted = np.floor(np.cumsum(per_sample) / driven.setup.pulse + rng.uniform())
    return {"odo_pulses": counted.astype(np.int64)}


def _truth(driven: Driven, rate_hz: int) -> pd.DataFrame:
    """truth.csv at 10 Hz, from the first sample on."""
    truth, rows = driven.truth, slice(1, None, rate_hz // TRUTH_HZ)
    columns: dict[str, Any] = {"time": np.round(truth.time[rows], 6)}
    for k, name in enumerate(("lat", "lon", "height")):
        columns[name] = np.round(truth.lla[rows, k], 12 if k < 2 else 6)
    for k, name in enumerate(("v_e", "v_n", "v_u")):
        columns[name] = np.round(truth.v_n[rows, k], 9) + 0.0  # + 0.0: no minus zero
    angles = truth.angles_deg[rows]
    for k, name in enumerate(("roll_deg", "pitch_deg", "heading_deg")):
        columns[name] = np.round(angles[:, k], 9)
    columns["state"] = driven.commands.state_at(truth.time[rows])
    return pd.DataFrame(columns)


def _constants(driven: Driven, imu: Disturbed, scale: Array, rate_hz: int) -> dict[str, Any]:
    """What calibration.json estimates, as it truly was."""
    every = round(KEPT_EVERY * rate_hz)
    time = driven.truth.time[::every]

    def entry(unit: str, parts: list[str], value: Array, at: Array | None = None) -> dict[str, Any]:
        return {
            "unit": unit,
            "components": parts,
            "constant": at is None,
            "time": [0.0] if at is None else at.tolist(),
            "value": np.atleast_2d(value).tolist(),
        }

    padded = {
        "gyro_bias_deg_h": ("deg/h", imu.gyro_bias / DEG_H),
        "accel_bias_mg": ("mg", imu.accel_bias / MG),
    }
    out = {
        name: entry(unit, ["x", "y", "z"], np.concatenate([b[:1], b])[::every], time)
        for name, (unit, b) in padded.items()
    }
    out["odometer_scale"] = entry("1", ["scale"], scale[::every, None], time)
    mount = driven.setup.mount_deg
    out["mounting_deg"] = entry("deg", ["pitch", "heading"], np.array([mount[0], mount[2]]))
    out["lever_arm_m"] = entry("m", ["x", "y", "z"], driven.setup.lever)
    for name, (unit, parts, value) in driven.constants.items():
        out[name] = entry(unit, parts, np.asarray(value))
    return out


def _vehicle(setup: Setup, heading_deg: float, gnss: bool) -> str:
    """vehicle.toml: nominal values, and the start heading as well as it is known."""
    grade = GRADES[setup.grade]
    lat, lon, height = setup.start
    column = f'"odo_pulses"\nmetres_per_pulse = {setup.pulse}' if setup.pulse else '"odo_speed"'
    antenna = f"\n[gnss]\nlever_arm = {list(ANTENNA)}\n" if gnss else ""
    return f"""{setup.vehicle}
[odometer]
column = {column}
lever_arm = {list(setup.nominal_lever)}
mount_deg = [0.0, 0.0, 0.0]

[imu]
axes = "RFU"
gyro_bias_deg_h = {grade.gyro_bias_deg_h}
gyro_noise_deg_sqrt_h = {grade.gyro_noise_deg_sqrt_h}
accel_bias_mg = {grade.accel_bias_mg}
accel_noise_mg_sqrt_hz = {grade.accel_noise_mg_sqrt_hz}
{antenna}
[start]
lat = {lat}
lon = {lon}
height = {height}
heading_deg = {heading_deg:.4f}
heading_sd_deg = {setup.heading_sd_deg}
"""
