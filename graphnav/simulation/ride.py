"""How a vehicle rides over the ground: what breaks the non-holonomic constraint."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d
from scipy.signal import lfilter

from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.field import FieldConditions
from graphnav.simulation.legs import Commands

PITCH_SHARE, PITCH_LAG = 0.6, 0.4  # of a bump's slope that the body follows; lag in its lengths
HARDEST = 5.0  # m/s^2: drivers slow down for more
FINE = 20  # steps of the ground per half length of a bump
SUSPENSION_S = 0.12  # time constant, twice in a row: the body leans after the wheels have braked
ROLL_SHARE = 0.5  # of the bumps are met by one side


@dataclass(frozen=True)
class Ridden:
    """Beside the drive over waves: angles of the body and velocity of the vehicle point in m."""

    roll: Array  # (M,) rad
    pitch: Array  # (M,) rad
    sideways: Array  # (M,) m/s
    upward: Array  # (M,) m/s


def ridden(
    rng: np.random.Generator, field: FieldConditions, drive: Commands, roll: Array
) -> Ridden:
    """Bumps, squat and drift; `roll` (M,) rad is the side slope.

    The vehicle point follows the ground's slope, the body only part of it and later: what is left
    is velocity across the body's own forward axis.
    """
    dt = float(drive.time[1])
    slope, follows, leans = _bumps(rng, field, drive)
    pitch = follows + field.squat * _eased_acceleration(drive.speed, dt)
    return Ridden(
        roll=leans,
        pitch=pitch,
        sideways=field.drift * np.sin(roll) * np.abs(drive.speed),
        upward=drive.speed * (slope - pitch),
    )


def _eased_acceleration(speed: Array, dt: float) -> Array:
    """Acceleration (M,) m/s^2 as the suspension passes it on; a wheel that locks stops at once."""
    keep = float(np.exp(-dt / SUSPENSION_S))
    rise = np.diff(speed, prepend=speed[:1]) / dt
    for _ in range(2):
        rise = lfilter([1 - keep], [1, -keep], rise)
    return np.asarray(rise)


def _bumps(
    rng: np.random.Generator, field: FieldConditions, drive: Commands
) -> tuple[Array, Array, Array]:
    """Slope of the ground, pitch and roll (M,) of the body on bumps, by the way along the path."""
    way = np.cumsum(drive.speed) * float(drive.time[1])
    width = field.bump_length / 2
    grid = np.arange(way.min() - width, way.max() + width, width / FINE)
    count = int((grid[-1] - grid[0]) / field.bump_every)
    places = rng.uniform(grid[0], grid[-1], count)
    heights = field.bump_height * np.exp(0.5 * rng.standard_normal(count))
    fastest = np.interp(places, *_fastest(way, np.abs(drive.speed), 10 * width))
    heights = np.minimum(heights, HARDEST * (width / np.maximum(fastest, 0.1)) ** 2)
    heights *= rng.choice([-1.0, 1.0], count)  # bumps and holes
    sides = rng.choice([-1.0, 0.0, 1.0], count, p=[ROLL_SHARE / 2, 1 - ROLL_SHARE, ROLL_SHARE / 2])
    slope, pitch, roll = (np.zeros(len(grid)) for _ in range(3))
    for place, height, side in zip(places, heights, sides, strict=True):
        a, b = np.searchsorted(grid, [place - 5 * width, place + 6 * width])
        x = (grid[a:b] - place) / width
        late = x - 2 * PITCH_LAG
        slope[a:b] -= height / width * x * np.exp(-(x**2) / 2)
        pitch[a:b] -= PITCH_SHARE * height / width * late * np.exp(-(late**2) / 2)
        roll[a:b] += side * height / (2 * field.half_gauge) * np.exp(-(x**2) / 2)
    found = CubicSpline(grid, np.stack([slope, pitch, roll], -1))(way)
    return found[:, 0], found[:, 1], found[:, 2]


def _fastest(way: Array, speed: Array, cell: float) -> tuple[Array, Array]:
    """Middles (C,) of cells of the way and the greatest speed in each (C,) and beside it."""
    index = ((way - way.min()) / cell).astype(np.int64)
    fastest = np.zeros(index.max() + 1)
    np.maximum.at(fastest, index, speed)
    middles = way.min() + cell * (np.arange(len(fastest)) + 0.5)
    return middles, np.asarray(maximum_filter1d(fastest, 3))
