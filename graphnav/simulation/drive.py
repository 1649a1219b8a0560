"""A vehicle driven over the ground: commands to exact truth and what its odometer sees."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from graphnav.simulation import inertial, rotation
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.ground import Roughness, tilt
from graphnav.simulation.inertial import Body, Truth
from graphnav.simulation.legs import Commands

INTERNAL_HZ = 400  # of the exact motion; the samples are means over several of its steps


@dataclass(frozen=True)
class Options:
    """What the user may choose; None is the scenario's own default."""

    seed: int
    duration: float | None = None  # s
    grade: str | None = None  # key of GRADES
    ground: str = "concrete"  # concrete | soil
    gnss: bool = False
    slips: bool = False
    rate_hz: int = 100  # of the samples, a divisor of INTERNAL_HZ

    @property
    def every(self) -> int:
        """Internal steps per sample."""
        return INTERNAL_HZ // self.rate_hz


@dataclass(frozen=True)
class Setup:
    """The vehicle, its sensors' places and how well the vehicle file knows them."""

    vehicle: str  # the [vehicle] table of vehicle.toml
    grade: str
    pulse: float  # m; 0: odo_speed at 10 Hz
    nominal_lever: tuple[float, float, float]  # m, b frame, IMU to odometer point
    lever_error: tuple[float, float, float]  # m, truth minus nominal
    mount_deg: tuple[float, float, float]  # true rotation vector b <- m; nominal is zero
    start: tuple[float, float, float]  # deg, deg, m of the IMU
    heading_sd_deg: float
    rough: Roughness

    @property
    def lever(self) -> Array:
        """True lever arm (3,) m."""
        return np.add(self.nominal_lever, self.lever_error)


@dataclass(frozen=True)
class Event:
    """A slip episode; the kinds are those of `events.csv`."""

    start: float  # s
    end: float  # s
    kind: str  # side_slip | hop | wheel_spin | wheel_lock
    peak_velocity: float  # m/s, signed, of the axis that slips

    @property
    def axis(self) -> str:
        """The axis of m that breaks the constraint."""
        return {"side_slip": "x", "hop": "z"}.get(self.kind, "y")


@dataclass(frozen=True)
class Driven:
    """The noise-free half of a run."""

    setup: Setup
    commands: Commands
    truth: Truth
    odometer_speed: Array  # (M,) m/s at the internal nodes, scale factor not applied
    constants: dict[str, Any] = field(default_factory=dict)  # calibration.json entries
    events: Sequence[Event] = ()


def stream(seed: int, topic: str) -> np.random.Generator:
    """Random numbers of one topic: changing one topic leaves the others' numbers alone."""
    return np.random.default_rng([seed, *topic.encode()])


def clock(options: Options, duration: float) -> Array:
    """Internal time grid (M,) s of a run of `duration` seconds: whole samples."""
    steps = round(duration * options.rate_hz) * options.every
    return np.arange(steps + 1) / INTERNAL_HZ


def follow(
    options: Options, setup: Setup, commands: Commands, sideways: Array, upward: Array
) -> Truth:
    """Truth of a vehicle point with velocity `[sideways, speed, upward]` (M,) m/s in m."""
    dt = float(commands.time[1])
    w = commands.yaw_rate
    turned = np.concatenate([[0.0], np.cumsum(w[1:] + w[:-1]) * (dt / 2)])
    heading = stream(options.seed, "heading").uniform(0, 2 * np.pi) - turned
    roll, pitch = tilt(stream(options.seed, "ground"), setup.rough, commands)
    mount = rotation.single(np.radians(setup.mount_deg))
    lat, lon, height = setup.start
    body = Body(np.array([np.radians(lat), np.radians(lon), height]), mount, setup.lever)
    v_m = np.stack([sideways, commands.speed, upward], -1)
    R_nb = inertial.attitude(roll, pitch, heading)
    return inertial.truth(commands.time, R_nb, v_m, body, options.every)
