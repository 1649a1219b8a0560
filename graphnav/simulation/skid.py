"""Scenario `field-skid`: a skid-steered robot, speeds of both sides, turns on the spot."""

from collections.abc import Iterator

import numpy as np

from graphnav.simulation.drive import Driven, Options, SimulatedVehicle, clock, follow, stream
from graphnav.simulation.field import SKID, without
from graphnav.simulation.legs import Commands, Leg, commands, cut
from graphnav.simulation.slip import slipping

DURATION = 600.0  # s
GAUGE, CONTACT = 1.08, 0.85  # m, of the data sheet
WIDTH = (1.35, 1.95)  # effective over nominal track width: wheels skid through every turn
UNLIKE = 0.01  # 1 sigma of the sides' difference in scale
KAPPA = (-0.15, 0.25)  # turning centre behind the middle, in contact lengths
SPEED_EASE, YAW_EASE = 0.4, 0.2  # s
DECK = ("straight",) * 4 + ("arc",) * 4 + ("pivot",) * 4 + ("reverse", "stop", "stop", "crawl")
VEHICLE = f"""[vehicle]
kind = "tracked"
track_gauge = {GAUGE}
contact_length = {CONTACT}
low_gear_ratio = 1.0
"""


def drive(options: Options) -> Driven:
    """One run, noise-free: the path as commanded, the sides as they must turn for it."""
    duration = options.duration or DURATION
    rng = stream(options.seed, "gear")
    effective, kappa = GAUGE * rng.uniform(*WIDTH), rng.uniform(*KAPPA)
    unlike = 1 + UNLIKE * rng.standard_normal() * np.array([0.5, -0.5])
    legs = cut(_legs(stream(options.seed, "plan")), duration)
    moves = commands(clock(options, duration), legs, SPEED_EASE, YAW_EASE, SKID.halt_ease)
    setup = _setup(stream(options.seed, "mounting"), options)
    sideways = -kappa * CONTACT * moves.yaw_rate
    truth = follow(options, setup, moves, sideways, np.zeros(len(moves.time)))
    constants = {
        "track_width_m": ("m", ["effective"], [effective]),
        "side_scale": ("1", ["left", "right"], unlike.tolist()),
        "kappa": ("1", ["turn_arc", "turn_pivot"], [kappa, kappa]),
    }
    sides = _sides(moves, effective) / unlike
    return Driven(setup, moves, truth, slipping(options, setup, moves, sides), constants)


def _sides(moves: Commands, effective: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Speeds (M, 2) m/s of the left and the right side without slip."""
    half = 0.5 * effective * moves.yaw_rate
    return np.stack([moves.speed - half, moves.speed + half], -1)


def _setup(rng: np.random.Generator, options: Options) -> SimulatedVehicle:
    lever = rng.uniform(0.03, 0.08, 3) * rng.choice([-1.0, 1.0], 3)
    mount = rng.uniform(0.2, 1.0, 3) * rng.choice([-1.0, 1.0], 3) * [1, 0, 1]
    field = without(SKID, options.without)
    return SimulatedVehicle(
        vehicle=VEHICLE,
        grade=options.grade or field.grade,
        pulse=0.0,
        nominal_lever=(0.0, -0.10, -0.30),
        lever_error=(lever[0], lever[1], lever[2]),
        mount_deg=(mount[0], mount[1], mount[2]),
        start=(46.78, -71.27, 90.0),
        heading_sd_deg=1.0,
        rough=field.ground,
        scale_error=(0.01, 0.05),  # a wheel's radius from the catalogue
        sides=True,
        field=field,
    )


def _legs(rng: np.random.Generator) -> Iterator[Leg]:
    """Endless legs: shuffled manoeuvres after a standstill."""
    yield Leg(rng.uniform(15, 30), 0.0, 0.0, "stop")
    while True:
        for name in rng.permutation(DECK):
            yield _leg(rng, str(name))


def _leg(rng: np.random.Generator, name: str) -> Leg:
    side = rng.choice([-1.0, 1.0])
    speed = rng.uniform(0.5, 1.8)
    if name == "arc":
        return Leg(rng.uniform(3, 10), speed, side * speed / rng.uniform(2, 8), "turn_arc")
    if name == "pivot":
        return Leg(rng.uniform(2, 6), 0.0, side * rng.uniform(0.25, 0.8), "turn_pivot")
    if name == "reverse":
        return Leg(rng.uniform(4, 8), -0.5, side * rng.uniform(0, 0.05), "straight_high")
    if name == "stop":
        return Leg(rng.uniform(5, 15), 0.0, 0.0, "stop")
    if name == "crawl":
        return Leg(rng.uniform(5, 15), 0.06, 0.0, "straight_high")
    return Leg(rng.uniform(8, 25), speed, 0.0, "straight_high")
