"""A vehicle driven over the ground: commands to exact truth and what its odometer sees."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from graphnav.simulation import inertial, ride, rotation
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.field import FieldConditions
from graphnav.simulation.ground import Roughness, tilt
from graphnav.simulation.inertial import Body, Truth
from graphnav.simulation.legs import Commands

INTERNAL_HZ = 400  # of the exact motion, at least; the samples are means over several of its steps


@dataclass(frozen=True)
class Options:
    """What the user may choose; None is the scenario's own default."""

    seed: int
    duration: float | None = None  # s
    grade: str | None = None  # key of GRADES
    ground: str = "concrete"  # concrete | soil
    gnss: bool = False
    slips: bool = False
    rate_hz: int = 100  # of the samples
    noise: float = 1.0  # the IMU's white noise over its data sheet's
    sampled: bool = False  # the IMU's values are those of an instant, not means
    vibration: float = 1.0  # of the scenario's own; `field` scenarios
    without: tuple[str, ...] = ()  # of field.EFFECTS

    @property
    def every(self) -> int:
        """Internal steps per sample."""
        return -(-INTERNAL_HZ // self.rate_hz)

    @property
    def internal_hz(self) -> int:
        """Rate of the internal grid: the least multiple of the samples' from INTERNAL_HZ on."""
        return self.every * self.rate_hz


@dataclass(frozen=True)
class SimulatedVehicle:
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
    scale_error: tuple[float, float] = (0.005, 0.015)  # bounds of a speed column's, either sign
    sides: bool = False  # odo_left and odo_right
    field: FieldConditions | None = None  # None: a laboratory's sensors on a laboratory's ground

    @property
    def lever(self) -> Array:
        """True lever arm (3,) m."""
        return np.add(self.nominal_lever, self.lever_error)


@dataclass(frozen=True)
class Episode:
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

    setup: SimulatedVehicle
    commands: Commands
    truth: Truth
    odometer_speed: Array  # (M,) or, of both sides, (M, 2) m/s at the internal nodes, unscaled
    constants: dict[str, Any] = field(default_factory=dict)  # calibration.json entries
    events: Sequence[Episode] = ()


def stream(seed: int, topic: str) -> np.random.Generator:
    """Random numbers of one topic: changing one topic leaves the others' numbers alone."""
    return np.random.default_rng([seed, *topic.encode()])


def clock(options: Options, duration: float) -> Array:
    """Internal time grid (M,) s of a run of `duration` seconds: whole samples."""
    steps = round(duration * options.rate_hz) * options.every
    return np.arange(steps + 1) / options.internal_hz


def follow(
    options: Options, setup: SimulatedVehicle, commands: Commands, sideways: Array, upward: Array
) -> Truth:
    """Truth of a vehicle point with velocity `[sideways, speed, upward]` (M,) m/s in m."""
    dt = float(commands.time[1])
    w = commands.yaw_rate
    turned = np.concatenate([[0.0], np.cumsum(w[1:] + w[:-1]) * (dt / 2)])
    heading = stream(options.seed, "heading").uniform(0, 2 * np.pi) - turned
    roll, pitch = tilt(stream(options.seed, "ground"), setup.rough, commands)
    if setup.field and "bumps" in setup.field.effects:
        ridden = ride.ridden(stream(options.seed, "bumps"), setup.field, commands, roll)
        pitch, roll = pitch + ridden.pitch, roll + ridden.roll
        sideways, upward = sideways + ridden.sideways, upward + ridden.upward
    mount = rotation.single(np.radians(setup.mount_deg))
    lat, lon, height = setup.start
    body = Body(np.array([np.radians(lat), np.radians(lon), height]), mount, setup.lever)
    v_m = np.stack([sideways, commands.speed, upward], -1)
    R_nb = inertial.attitude(roll, pitch, heading)
    return inertial.truth(commands.time, R_nb, v_m, body, options.every)
