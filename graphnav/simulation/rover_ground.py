"""Uneven ground under a rocker-bogie rover: random fields, and the pose on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import rocker_bogie as rb
from graphnav.common.angles import rotation_of_angles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RandomField:
    """A smooth random scalar over the ground: a sum of plane waves."""

    wave: Array  # (M, 2) rad/m
    phase: Array  # (M,) rad
    amplitude: Array  # (M,)

    def value(self, at: Array) -> Array:
        """Value (...,) at east, north (..., 2) m."""
        return np.asarray(np.sin(at @ self.wave.T + self.phase) @ self.amplitude)

    def gradient(self, at: Array) -> Array:
        """Slope (..., 2) per metre at east, north (..., 2) m."""
        slope = np.cos(at @ self.wave.T + self.phase) * self.amplitude
        return np.asarray(slope @ self.wave)


def random_field(
    rng: np.random.Generator, shortest: float, longest: float, power: float, modes: int = 40
) -> RandomField:
    """Unit-variance field of wavelengths [m]; amplitude grows as wavelength^power."""
    length = np.exp(rng.uniform(np.log(shortest), np.log(longest), modes))
    course = rng.uniform(0, 2 * np.pi, modes)
    wave = (2 * np.pi / length)[:, None] * np.stack([np.cos(course), np.sin(course)], -1)
    amplitude = length**power
    amplitude *= np.sqrt(2 / np.sum(amplitude**2))
    return RandomField(wave, rng.uniform(0, 2 * np.pi, modes), amplitude)


def scaled(field: RandomField, factor: float) -> RandomField:
    """The field times a constant."""
    return RandomField(field.wave, field.phase, field.amplitude * factor)


def terrain(rng: np.random.Generator, slope: float) -> RandomField:
    """Surface of the wheel centres [m]: boulder swells to hills, `slope` rad RMS along a line."""
    field = random_field(rng, 0.9, 30.0, 1.0)
    steepness = np.sqrt(np.sum((field.wave * field.amplitude[:, None]) ** 2) / 4)
    return scaled(field, slope / float(steepness))


@dataclass(frozen=True)
class Pose:
    """The rover standing on the ground, at every sample."""

    R_nb: Array  # (N, 3, 3)
    p_n: Array  # (N, 3) m
    joints: rb.Joints  # steering not filled in
    wheels_n: Array  # (N, 6, 3) m, wheel centres


def _joints(x: Array) -> rb.Joints:
    return rb.Joints(steer=np.zeros((len(x), 6)), rocker=x[:, 3], bogie=x[:, 4:6])


def settle(linkage: rb.Linkage, ground: RandomField, en: Array, heading: Array) -> Pose:
    """Height, roll, pitch, rocker and bogies so that all six wheel centres lie on `ground`.

    Six contacts, six unknowns: Newton's method, all samples at once. `en` (N, 2) m is the body
    origin's place, `heading` (N,) rad.
    """
    n = len(en)
    x = np.zeros((n, 6))  # z, roll, pitch, rocker, bogie left, bogie right
    flat = rb.wheel_positions(linkage, _joints(x[:1]))[0]
    x[:, 0] = ground.value(en) - flat[:, 2].mean()
    for _ in range(10):
        R, p_b, wheels = _placed(linkage, x, en, heading)
        miss = wheels[..., 2] - ground.value(wheels[..., :2])
        if np.abs(miss).max() < 1e-10:
            break
        normal = np.concatenate([-ground.gradient(wheels[..., :2]), np.ones((n, 6, 1))], -1)
        moves = _moves(linkage, x, heading, R, p_b)
        x -= np.linalg.solve(np.einsum("nwk,nwik->nwi", normal, moves), miss[..., None])[..., 0]
    else:
        raise RuntimeError(f"rover does not stand: {np.abs(miss).max():.2g} m off the ground")
    return Pose(R, np.concatenate([en, x[:, :1]], 1), _joints(x), wheels)


def _placed(linkage: rb.Linkage, x: Array, en: Array, heading: Array) -> tuple[Array, Array, Array]:
    """R_nb, wheel centres in b and in n for the unknowns `x`."""
    R = rotation_of_angles(x[:, 1], x[:, 2], heading)
    p_b = rb.wheel_positions(linkage, _joints(x))
    origin = np.concatenate([en, x[:, :1]], 1)
    return R, p_b, origin[:, None] + np.einsum("nij,nwj->nwi", R, p_b)


def _moves(linkage: rb.Linkage, x: Array, heading: Array, R: Array, p_b: Array) -> Array:
    """How each unknown moves each wheel centre in n, (N, 6 wheels, 6 unknowns, 3)."""
    n = len(x)
    out = np.zeros((n, 6, 6, 3))
    out[:, :, 0, 2] = 1.0
    roll_axis = R[:, :, 1]
    pitch_axis = np.stack([np.cos(heading), -np.sin(heading), np.zeros(n)], -1)
    p_n = np.einsum("nij,nwj->nwi", R, p_b)
    out[:, :, 1] = np.cross(roll_axis[:, None], p_n)
    out[:, :, 2] = np.cross(pitch_axis[:, None], p_n)
    for k in range(3, 6):
        unit = np.zeros((n, 6))
        unit[:, k] = 1.0
        rate_b = rb.wheel_position_rates(linkage, _joints(x), _joints(unit))
        out[:, :, k] = np.einsum("nij,nwj->nwi", R, rate_b)
    return out
