"""What the IMU makes of the true rates and forces, and how noisy it was."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from graphnav.common.errors import InputError
from graphnav.simulation.drive import Driven, Options, stream
from graphnav.simulation.ellipsoid import G_STANDARD, Array
from graphnav.simulation.grades import (
    DEG_H,
    DEG_SQRT_H,
    GRADES,
    IMPERFECTIONS,
    MG,
    Disturbed,
    disturb,
)
from graphnav.simulation.vibration import vibration

CORRELATION_S = (10.0, 100.0, 1000.0)  # of the bias instability: flicker, octaves apart
AVERAGED_S = (0.1, 1.0, 10.0)  # over which the injected noise is stated


@dataclass(frozen=True)
class SensedImu:
    """Samples, biases, noise as injected and the axes as they are."""

    imu: Disturbed
    gyro_noise: Array  # (N, 3) rad/s: sample less axes times truth less bias
    accel_noise: Array  # (N, 3) m/s^2
    gyro_axes: Array  # (3, 3): what the sensor gives per true rate, 1 sigma by grade off the unit
    accel_axes: Array  # (3, 3)


def sensed(driven: Driven, options: Options) -> SensedImu:
    """The samples of a run. Raises InputError on an unknown grade."""
    grade, field, truth = driven.setup.grade, driven.setup.field, driven.truth
    if grade not in GRADES:
        raise InputError(f"IMU grade '{grade}' is unknown: use {', '.join(GRADES)}")
    effects = field.effects if field else frozenset[str]()
    true_gyro = truth.gyro_end if options.sampled else truth.gyro
    true_accel = truth.accel_end if options.sampled else truth.accel
    gyro_axes, accel_axes, sensitivity = _axes(stream(options.seed, "axes"), grade, effects)
    gyro = true_gyro @ gyro_axes.T + true_accel @ sensitivity.T
    accel = true_accel @ accel_axes.T
    rng, dt = stream(options.seed, "imu"), 1 / options.rate_hz
    imu = disturb(rng, GRADES[grade], gyro, accel, dt, options.noise)
    if "instability" in effects:
        imu = _unstable(stream(options.seed, "instability"), imu, grade, dt)
    if "vibration" in effects:
        shaken = vibration(driven, options)
        imu = imu.shifted(shaken[0], shaken[1])
    if "quantisation" in effects:
        imu = imu.quantised(IMPERFECTIONS[grade].gyro_lsb, IMPERFECTIONS[grade].accel_lsb)
    return SensedImu(
        imu,
        imu.gyro - gyro - imu.gyro_bias,
        imu.accel - accel - imu.accel_bias,
        gyro_axes,
        accel_axes,
    )


def _axes(
    rng: np.random.Generator, grade: str, effects: frozenset[str]
) -> tuple[Array, Array, Array]:
    """Of gyros and accelerometers (3, 3), and the gyros' sensitivity to force (3, 3) rad s/m."""
    sheet, found = IMPERFECTIONS[grade], []
    for scale in (sheet.gyro_scale, sheet.accel_scale):
        factors = scale * ("scale" in effects) * np.diag(rng.standard_normal(3))
        across = sheet.misalignment * ("misalignment" in effects) * rng.standard_normal((3, 3))
        found.append(np.eye(3) + factors + across * (1 - np.eye(3)))
    felt = sheet.g_sensitivity_deg_h_g * DEG_H / G_STANDARD * ("g-sensitivity" in effects)
    return found[0], found[1], felt * rng.standard_normal((3, 3))


def _unstable(rng: np.random.Generator, imu: Disturbed, grade: str, dt: float) -> Disturbed:
    """Biases that also wander about their place: Gauss-Markov processes, equally strong."""
    sheet, (count, _) = IMPERFECTIONS[grade], imu.gyro.shape
    total = np.zeros((count, 6))
    for correlation in CORRELATION_S:
        keep = float(np.exp(-dt / correlation))
        driven = np.sqrt(1 - keep**2) * rng.standard_normal((count, 6))
        driven[0] /= np.sqrt(1 - keep**2)
        total += lfilter([1], [1, -keep], driven, axis=0)
    total /= np.sqrt(len(CORRELATION_S))
    gyro = sheet.gyro_instability_deg_h * DEG_H * total[:, :3]
    accel = sheet.accel_instability_mg * MG * total[:, 3:]
    return imu.shifted(gyro, accel, of_bias=True)


def levels(
    noise: Array, chosen: NDArray[np.bool_], dt: float, unit: float
) -> dict[str, list[float]]:
    """White noise (3,) that is worth as much over each of `AVERAGED_S`, of chosen samples (N,).

    Root of the mean square of the means over whole spans, times the root of the span: the same at
    every span where the noise is white.
    """
    found = {}
    for seconds in AVERAGED_S:
        span = max(round(seconds / dt), 1)
        whole = len(noise) // span
        inside = chosen[: whole * span].reshape(whole, span).all(1)
        means = noise[: whole * span].reshape(whole, span, 3).mean(1)[inside]
        if len(means) > 1:
            level = np.sqrt(np.mean(means**2, 0) * span * dt) / unit
            found[f"{seconds:g}"] = [float(x) for x in level]
    return found


def injected(sensed: SensedImu, driven: Driven, dt: float) -> dict[str, dict[str, object]]:
    """Noise of each axis, standing and driving apart, in the units of the vehicle file."""
    moves = driven.commands
    moving = (moves.speed != 0) | (moves.yaw_rate != 0)
    every = (len(moves.time) - 1) // len(sensed.gyro_noise)
    driving = moving[1:].reshape(-1, every).any(1)
    found: dict[str, dict[str, object]] = {}
    for name, chosen in (("standing", ~driving), ("driving", driving)):
        if chosen.sum() < 2:
            continue
        found[name] = {
            "seconds": float(chosen.sum() * dt),
            "gyro_deg_sqrt_h": levels(sensed.gyro_noise, chosen, dt, DEG_SQRT_H),
            "accel_mg_sqrt_hz": levels(sensed.accel_noise, chosen, dt, MG),
            "gyro_sd_rad_s": sensed.gyro_noise[chosen].std(0).tolist(),
            "accel_sd_m_s2": sensed.accel_noise[chosen].std(0).tolist(),
        }
    return found
