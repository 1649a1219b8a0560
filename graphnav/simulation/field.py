"""What the field adds to a drive: the effects, each of which can be left out, and three vehicles.

Amounts are those of recorded vehicles (kingston2008, comma2k19, husky, warthog, marmotte,
pathfinder17): 0.3 to 2.5 m/s^2 and 0.01 to 0.1 rad/s about the mean of a second while driving.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from graphnav.common.errors import InputError
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.ground import Roughness

EFFECTS = (
    "vibration",  # of running gear, ground and engine, coloured, growing with speed and ground
    "bumps",  # bumps, squat under acceleration, drift on side slopes: v_x, v_z of m are not zero
    "hills",  # grades and side slopes
    "scale",  # factors of the IMU's axes
    "misalignment",  # of the IMU's axes to each other
    "g-sensitivity",  # of the gyros
    "instability",  # of the biases
    "quantisation",  # of IMU and wheels
    "jitter",  # of the host's stamps; the IMU's own clock is even
    "losses",  # of samples, singly and in bursts
    "slip",  # of the wheels or tracks, either side by itself
)


class Shaking(NamedTuple):
    """Vibration at `speed` on middling ground; rms by axis x, y, z."""

    accel: tuple[float, float, float]  # m/s^2
    gyro: tuple[float, float, float]  # rad/s
    speed: float  # m/s of the running gear
    power: float  # rms grows with this power of the speed
    pitch: float  # m, of track links, tyre lugs or wheel grousers: a tone of speed / pitch
    idle: float  # the engine's share of the rms, standing too
    engine_hz: float


@dataclass(frozen=True)
class FieldConditions:
    """How one vehicle takes the ground."""

    grade: str  # of the IMU, unless another is asked for
    shaking: Shaking
    half_gauge: float  # m: a turn on the spot moves the running gear, too
    hills: Roughness
    plain: Roughness  # the ground without hills
    halt_ease: float  # s, in which the last of the speed is braked away
    stretch: float  # m, mean length of one kind of ground
    bump_every: float  # m
    bump_height: float  # m, median
    bump_length: float  # m
    squat: float  # rad per m/s^2 of forward acceleration
    drift: float  # side slip per rad of side slope
    slip_sd: float  # of one side about its mean
    slip_climb: float  # slip per rad of climb
    effects: frozenset[str] = frozenset(EFFECTS)

    @property
    def ground(self) -> Roughness:
        """Hills, or the laboratory's ground."""
        return self.hills if "hills" in self.effects else self.plain


TRACKED = FieldConditions(
    grade="tactical",
    shaking=Shaking((0.6, 0.5, 0.9), (0.012, 0.018, 0.006), 5.0, 0.8, 0.152, 0.12, 37.0),
    half_gauge=1.4,
    hills=Roughness(0.05, 0.035, 0.030, 0.030, 8.3, 6.6, (20.0, 300.0)),
    plain=Roughness(0.0217, 0.0124, 0.030, 0.030, 8.3, 6.6),
    halt_ease=1.2,
    stretch=150.0,
    bump_every=60.0, bump_height=0.06, bump_length=3.0,
    squat=0.006, drift=0.10, slip_sd=0.015, slip_climb=0.15,
)  # fmt: skip
WHEELED = FieldConditions(
    grade="mems",
    shaking=Shaking((0.35, 0.30, 0.6), (0.015, 0.010, 0.004), 12.0, 0.7, 0.035, 0.04, 26.0),
    half_gauge=0.75,
    hills=Roughness(0.04, 0.02, 0.010, 0.010, 9.0, 5.0, (45.0, 500.0)),
    plain=Roughness(0.0108, 0.0070, 0.0, 0.0, 9.0, 5.0),
    halt_ease=2.4,
    stretch=300.0,
    bump_every=150.0, bump_height=0.04, bump_length=2.5,
    squat=0.010, drift=0.02, slip_sd=0.004, slip_climb=0.03,
)  # fmt: skip
SKID = FieldConditions(
    grade="mems",
    shaking=Shaking((0.6, 0.55, 0.8), (0.03, 0.02, 0.015), 1.2, 0.7, 0.05, 0.0, 0.0),
    half_gauge=0.54,
    hills=Roughness(0.06, 0.05, 0.0, 0.0, 9.0, 5.0, (6.0, 80.0)),
    plain=Roughness(0.0, 0.0, 0.0, 0.0, 9.0, 5.0),
    halt_ease=0.5,
    stretch=25.0,
    bump_every=12.0, bump_height=0.025, bump_length=0.8,
    squat=0.015, drift=0.15, slip_sd=0.025, slip_climb=0.25,
)  # fmt: skip
GROUNDS = (0.5, 1.0, 1.0, 2.0)  # vibration on smooth, middling and rough ground


def without(field: FieldConditions, left_out: tuple[str, ...]) -> FieldConditions:
    """The field less some of its effects. Raises InputError on an unknown one."""
    for name in left_out:
        if name not in EFFECTS:
            raise InputError(f"effect '{name}' is unknown: use {', '.join(EFFECTS)}")
    return replace(field, effects=field.effects - frozenset(left_out))


def roughness(rng: np.random.Generator, stretch: float, distance: Array) -> Array:
    """Roughness of the ground (M,) about 1 under the distance driven (M,) m."""
    count = int(3 * distance[-1] / stretch) + 5
    edges = np.cumsum(rng.exponential(stretch, count))
    kinds = rng.choice(GROUNDS, count + 1) * np.exp(0.2 * rng.standard_normal(count + 1))
    ease = 0.05 * stretch  # one ground becomes the next
    at = np.stack([edges - ease, edges + ease], 1)
    ramps = np.maximum.accumulate(at.ravel())
    return np.asarray(np.interp(distance, ramps, np.repeat(kinds, 2)[1:-1]))


def wander(rng: np.random.Generator, length: float, distance: Array) -> Array:
    """A first-order Gauss-Markov process (M,) of unit sd over the distance driven (M,) m."""
    step = length / 4
    count = int(distance[-1] / step) + 2
    keep = float(np.exp(-step / length))
    drive = np.sqrt(1 - keep**2) * rng.standard_normal(count)
    drive[0] /= np.sqrt(1 - keep**2)
    return np.asarray(np.interp(distance, step * np.arange(count), lfilter([1], [1, -keep], drive)))
