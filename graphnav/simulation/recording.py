"""What the sensors make of a drive: run.csv, truth.csv, vehicle.toml and the true constants."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from graphnav.simulation import imu, stamps
from graphnav.simulation.drive import Driven, Options, SimulatedVehicle, stream
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.gnss import ANTENNA, fixes
from graphnav.simulation.grades import DEG_H, GRADES, MG

TRUTH_HZ = 10
KEPT_EVERY = 10.0  # s, of the true bias and scale curves
SPEED_HZ = 10  # of odo_speed
SPEED_NOISE = 0.03  # m/s
SPEED_STEP = 0.02  # m/s, of a quantised odo_speed
SIDE_HZ, SIDE_STEP = 20, 0.005  # of odo_left and odo_right, m/s


@dataclass(frozen=True)
class Recording:
    """One simulated run, ready to be written."""

    run: pd.DataFrame
    truth: pd.DataFrame
    vehicle: str  # TOML
    calibration: dict[str, Any]  # truth_calibration.json


def record(driven: Driven, options: Options) -> Recording:
    """Add the sensors' errors. Raises InputError on an unknown grade."""
    setup, truth = driven.setup, driven.truth
    sensed = imu.sensed(driven, options)
    scale = scale_curve(stream(options.seed, "scale"), truth.time, driven)
    run = {"time": np.round(truth.time[1:], 6)} | _samples(sensed.imu.gyro, sensed.imu.accel)
    run |= _odometer(stream(options.seed, "odometer"), driven, scale, options)
    if options.gnss:
        run |= fixes(stream(options.seed, "gnss"), truth)
    effects = setup.field.effects if setup.field else frozenset[str]()
    rng, dt = stream(options.seed, "stamps"), 1 / options.rate_hz
    rows = stamps.delivered(rng, pd.DataFrame(run), dt, effects)
    start_deg = float(truth.angles_deg[0, 2])
    wrong_deg = stream(options.seed, "start").normal(0.0, setup.heading_sd_deg)
    return Recording(
        run=rows,
        truth=_truth(driven, options.rate_hz),
        vehicle=_vehicle(setup, (start_deg + wrong_deg) % 360, options.gnss),
        calibration={
            "seed": options.seed,
            "ground": options.ground,
            "grade": {"name": setup.grade, **asdict(GRADES[setup.grade])},
            "effects": sorted(effects),
            "distance_m": float(np.sum(np.abs(driven.commands.speed)) / options.internal_hz),
            "start_heading_deg": start_deg,
            "lost_samples": len(truth.time) - 1 - len(rows),
            "noise": imu.injected(sensed, driven, dt),
            "calibration": _constants(driven, sensed, scale, options.rate_hz),
            "events": [asdict(e) | {"axis": e.axis} for e in driven.events],
        },
    )


def _samples(gyro: Array, accel: Array) -> dict[str, Array]:
    """IMU columns, to the last digit that a sensor could mean."""
    columns = {f"gyro_{name}": np.round(gyro[:, k], 12) for k, name in enumerate("xyz")}
    return columns | {f"accel_{name}": np.round(accel[:, k], 9) for k, name in enumerate("xyz")}


def scale_curve(rng: np.random.Generator, time: Array, driven: Driven) -> Array:
    """True over indicated distance at each sample node (N + 1,), methods B.

    Pulses: warm-up of tyres or sprockets and a slow wave; wheels also lose 1.5 permille at once.
    A speed column is off by one constant, up to 1.5 % or what the setup says.
    """
    if not driven.setup.pulse:
        off = rng.uniform(*driven.setup.scale_error) * rng.choice([-1.0, 1.0])
        return np.full(len(time), 1 / (1 + off))
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
    """`odo_pulses` at every sample, `odo_speed` at 10 Hz or both sides' speeds at 20 Hz."""
    speed, dt, every = driven.odometer_speed, 1 / options.internal_hz, options.every
    if driven.setup.pulse:
        step = 0.5 * (speed[1:] + speed[:-1]) * dt
        per_sample = step.reshape(-1, every).sum(1) / (0.5 * (scale[1:] + scale[:-1]))
        counted = np.floor(np.cumsum(per_sample) / driven.setup.pulse + rng.uniform())
        return {"odo_pulses": counted.astype(np.int64)}
    field = driven.setup.field
    coarse = field is not None and "quantisation" in field.effects
    if speed.ndim == 1:
        at = _ticks(len(scale) - 1, options.rate_hz, SPEED_HZ)
        clean = speed[every::every][at] / scale[1:][at]
        noisy = clean + SPEED_NOISE * rng.standard_normal(len(clean))
        if field is not None:
            noisy[clean == 0] = 0.0  # a counter of teeth, differenced, is still when they are
        return {"odo_speed": _sparse(len(scale) - 1, at, noisy, SPEED_STEP if coarse else 1e-4)}
    at = _ticks(len(scale) - 1, options.rate_hz, SIDE_HZ)
    sides = speed[every::every][at] / scale[1:][at, None]
    step_size = SIDE_STEP if coarse else 1e-4
    columns = (_sparse(len(scale) - 1, at, side, step_size) for side in sides.T)
    return dict(zip(("odo_left", "odo_right"), columns, strict=True))


def _ticks(count: int, rate_hz: int, hz: int) -> NDArray[np.int64]:
    """Rows of `count` samples in which a sensor of `hz` reports: its own ticks, or the next row."""
    ticks = np.arange(1, count * hz // rate_hz + 1)
    return np.unique(-(-ticks * rate_hz // hz) - 1)


def _sparse(count: int, at: NDArray[np.int64], value: Array, step: float) -> Array:
    column = np.full(count, np.nan)
    column[at] = np.round(np.round(value / step) * step, 4)
    return column


def _truth(driven: Driven, rate_hz: int) -> pd.DataFrame:
    """truth.csv at 10 Hz, from the first sample on."""
    truth = driven.truth
    count = (len(truth.time) - 2) * TRUTH_HZ // rate_hz + 1
    rows = 1 + np.arange(count) * rate_hz // TRUTH_HZ
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


def _constants(driven: Driven, sensed: imu.SensedImu, scale: Array, rate_hz: int) -> dict[str, Any]:
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
        "gyro_bias_deg_h": ("deg/h", sensed.imu.gyro_bias / DEG_H),
        "accel_bias_mg": ("mg", sensed.imu.accel_bias / MG),
    }
    out = {
        name: entry(unit, ["x", "y", "z"], np.concatenate([b[:1], b])[::every], time)
        for name, (unit, b) in padded.items()
    }
    axes = {"gyro": sensed.gyro_axes, "accel": sensed.accel_axes}
    for name, matrix in axes.items() if driven.setup.field else ():
        across = [f"{a}{b}" for a in "xyz" for b in "xyz" if a != b]
        off = matrix - np.eye(3)
        out[f"{name}_scale"] = entry("1", ["x", "y", "z"], np.diag(off))
        out[f"{name}_misalignment"] = entry("rad", across, off[~np.eye(3, dtype=bool)])
    out["odometer_scale"] = entry("1", ["scale"], scale[::every, None], time)
    mount = driven.setup.mount_deg
    out["mounting_deg"] = entry("deg", ["pitch", "heading"], np.array([mount[0], mount[2]]))
    out["lever_arm_m"] = entry("m", ["x", "y", "z"], driven.setup.lever)
    for name, (unit, parts, value) in driven.constants.items():
        out[name] = entry(unit, parts, np.asarray(value))
    return out


def _vehicle(setup: SimulatedVehicle, heading_deg: float, gnss: bool) -> str:
    """vehicle.toml: nominal values, and the start heading as well as it is known."""
    grade = GRADES[setup.grade]
    lat, lon, height = setup.start
    column = "" if setup.sides else 'column = "odo_speed"\n'
    if setup.pulse:
        column = f'column = "odo_pulses"\nmetres_per_pulse = {setup.pulse}\n'
    sheet = f'grade = "{setup.grade}"\n' if setup.field else ""
    antenna = f"\n[gnss]\nlever_arm = {list(ANTENNA)}\n" if gnss else ""
    return f"""{setup.vehicle}
[odometer]
{column}lever_arm = {list(setup.nominal_lever)}
mount_deg = [0.0, 0.0, 0.0]

[imu]
axes = "RFU"
{sheet}gyro_bias_deg_h = {grade.gyro_bias_deg_h}
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
