"""Uneven ground and the shaking it gives the vehicle."""

from dataclasses import dataclass

import numpy as np

from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.legs import Commands

WAVES = 3  # per angle
WAVELENGTH = (45.0, 400.0)  # m, of the laboratory's ground


@dataclass(frozen=True)
class Roughness:
    """One sigma of the IMU's tilt [rad] along and across the path, and of its shaking [rad/s]."""

    pitch: float
    roll: float
    pitch_shake: float
    roll_shake: float
    pitch_hz: float
    roll_hz: float
    wavelength: tuple[float, float] = WAVELENGTH


def tilt(rng: np.random.Generator, rough: Roughness, drive: Commands) -> tuple[Array, Array]:
    """Roll and pitch (M,) rad: waves of the ground under the distance driven, and shaking."""
    dt = drive.time[1] - drive.time[0]
    distance = np.cumsum(np.abs(drive.speed)) * dt
    pitch = _waves(rng, distance, rough.pitch, rough.wavelength)
    roll = _waves(rng, distance, rough.roll, rough.wavelength)
    pitch += drive.shaking * _shake(rng, drive.time, rough.pitch_shake, rough.pitch_hz)
    roll += drive.shaking * _shake(rng, drive.time, rough.roll_shake, rough.roll_hz)
    return roll, pitch


def _waves(
    rng: np.random.Generator, distance: Array, sigma: float, wavelength: tuple[float, float]
) -> Array:
    low, high = np.log(wavelength)
    lengths = np.exp(rng.uniform(low, high, WAVES))
    share = rng.uniform(0.6, 1.4, WAVES)
    share *= sigma * np.sqrt(2 / np.sum(share**2))
    out = np.zeros(len(distance))
    for length, amplitude, phase in zip(
        lengths, share, rng.uniform(0, 2 * np.pi, WAVES), strict=True
    ):
        out += amplitude * np.sin(2 * np.pi / length * distance + phase)
    return out


def _shake(rng: np.random.Generator, time: Array, sigma: float, hz: float) -> Array:
    """An engine-like oscillation whose rate has `sigma`; its frequency differs per run."""
    if sigma == 0:
        return np.zeros(len(time))
    turn = 2 * np.pi * hz * rng.uniform(0.9, 1.1)
    wander = 0.5 * np.sin(2 * np.pi * time / rng.uniform(20, 60))
    return np.asarray(np.sqrt(2) * sigma / turn * np.sin(turn * time + wander))
