"""IMU grades: one table of noise, bias and bias wander, in the units of `vehicle.toml`.

`navigation`, `fog` and `mems` are the sensors of methods B, A and D as the sample runs show them.
"""

from dataclasses import dataclass, replace

import numpy as np

from graphnav.simulation.ellipsoid import G_STANDARD, Array

DEG_H = np.pi / 180 / 3600  # rad/s
DEG_SQRT_H = np.pi / 180 / 60  # rad/sqrt(s)
MG = 1e-3 * G_STANDARD  # m/s^2


@dataclass(frozen=True)
class ImuErrors:
    """One sigma of each error; the wander is a random walk after one hour."""

    gyro_bias_deg_h: float
    gyro_noise_deg_sqrt_h: float
    gyro_wander_deg_h: float
    accel_bias_mg: float
    accel_noise_mg_sqrt_hz: float
    accel_wander_mg: float


GRADES = {
    #                  bias   noise   wander | bias noise  wander
    "navigation": ImuErrors(0.002, 0.0005, 0.0004, 0.02, 0.005, 0.002),  # ring laser
    "fog":        ImuErrors(0.02,  0.002,  0.004,  0.1,  0.01,  0.01),
    "tactical":   ImuErrors(2.0,   0.1,    0.4,    1.0,  0.05,  0.1),
    "mems":       ImuErrors(8.0,   0.09,   1.6,    1.0,  0.08,  0.1),
}  # fmt: skip


@dataclass(frozen=True)
class Imperfection:
    """One sigma of what the field's runs have beside noise and bias, as data sheets state it."""

    gyro_scale: float
    accel_scale: float
    misalignment: float  # rad
    g_sensitivity_deg_h_g: float
    gyro_instability_deg_h: float
    accel_instability_mg: float
    gyro_lsb: float  # rad/s
    accel_lsb: float  # m/s^2


IMPERFECTIONS = {
    #                      scale gyro, accel  axes   g-sens. instability   least step
    "navigation": Imperfection(5e-6, 5e-5, 2e-5, 0.0,    0.001, 0.005, 1e-7, 1e-5),
    "fog":        Imperfection(1e-4, 2e-4, 1e-4, 0.0,    0.01,  0.02,  1e-6, 5e-5),
    "tactical":   Imperfection(3e-4, 5e-4, 5e-4, 0.5,    0.5,   0.1,   1e-5, 5e-4),
    "mems":       Imperfection(3e-3, 3e-3, 3e-3, 20.0,   6.0,   0.2,   1.3e-4, 1.2e-3),
}  # fmt: skip


@dataclass(frozen=True)
class Disturbed:
    """Samples as the sensor gives them, and the biases it had."""

    gyro: Array  # (N, 3) rad/s
    accel: Array  # (N, 3) m/s^2
    gyro_bias: Array  # (N, 3) rad/s
    accel_bias: Array  # (N, 3) m/s^2

    def shifted(self, gyro: Array, accel: Array, of_bias: bool = False) -> "Disturbed":
        """With (N, 3) added to the samples, and to the biases where it is theirs."""
        return Disturbed(
            self.gyro + gyro,
            self.accel + accel,
            self.gyro_bias + of_bias * gyro,
            self.accel_bias + of_bias * accel,
        )

    def quantised(self, gyro_step: float, accel_step: float) -> "Disturbed":
        """In whole steps [rad/s], [m/s^2]."""
        gyro = gyro_step * np.round(self.gyro / gyro_step)
        return replace(self, gyro=gyro, accel=accel_step * np.round(self.accel / accel_step))


def disturb(
    rng: np.random.Generator,
    grade: ImuErrors,
    gyro: Array,
    accel: Array,
    dt: float,
    noise: float = 1.0,
) -> Disturbed:
    """True means (N, 3) with constant bias, slow random walk and white noise added.

    `noise` is the white noise over the grade's.
    """
    gyro_bias = _bias(
        rng, gyro.shape, grade.gyro_bias_deg_h * DEG_H, grade.gyro_wander_deg_h * DEG_H, dt
    )
    accel_bias = _bias(rng, accel.shape, grade.accel_bias_mg * MG, grade.accel_wander_mg * MG, dt)
    gyro_sd = noise * grade.gyro_noise_deg_sqrt_h * DEG_SQRT_H / np.sqrt(dt)
    accel_sd = noise * grade.accel_noise_mg_sqrt_hz * MG / np.sqrt(dt)
    return Disturbed(
        gyro + gyro_bias + gyro_sd * rng.standard_normal(gyro.shape),
        accel + accel_bias + accel_sd * rng.standard_normal(accel.shape),
        gyro_bias,
        accel_bias,
    )


def _bias(
    rng: np.random.Generator, shape: tuple[int, ...], sigma: float, wander: float, dt: float
) -> Array:
    step = wander * np.sqrt(dt / 3600)
    walk = step * np.cumsum(rng.standard_normal(shape), axis=0)
    return np.asarray(sigma * rng.standard_normal(3) + walk)
