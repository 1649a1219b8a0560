"""Scenario `tracked`: methods A, all motion states of the paper's table 1."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from graphnav.common.errors import InputError
from graphnav.simulation.drive import Driven, Options, SimulatedVehicle, clock, follow, stream
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.field import TRACKED, FieldConditions, without
from graphnav.simulation.ground import Roughness
from graphnav.simulation.legs import Commands, Leg, commands, cut, eased
from graphnav.simulation.slip import slipping

DURATION, FIELD_DURATION = 4000.0, 900.0  # s
GAUGE, CONTACT, LOW_GEAR = 2.80, 3.84, 1.42  # B m, L m, ratio
R_ARC = 1.549 * 2.88 * GAUGE  # m, A13
FAST_SHARE = 0.3  # of the manoeuvres are followed by a fast straight
R_PIVOT = 1.531 * GAUGE / 2  # m, A9
STANDSTILL = 120.0  # s, before the first move
SPEED_EASE, YAW_EASE, GEAR_EASE = 0.9, 0.28, 0.2  # s
DECK = (
    *("arc",) * 6, "separated", "separated", "pivot", "pivot_low", "separated_low",
    "low", "stop", "stop", "stop", "large",
)  # fmt: skip
VEHICLE = f"""[vehicle]
kind = "tracked"
track_gauge = {GAUGE}
contact_length = {CONTACT}
low_gear_ratio = {LOW_GEAR}
"""
ROUGH = Roughness(0.0217, 0.0124, 0.030, 0.030, pitch_hz=8.3, roll_hz=6.6)


@dataclass(frozen=True)
class Ground:
    """Constants of the ground: `v_y = factor * v_o / gear - half_gauge * |phi_dot|` (A19-A23)."""

    arc: float  # factor in an arc turn
    separated: float  # factor in a separated turn, beside the half gauge
    pivot: float
    large: float
    kappa: float  # v_x = -kappa L phi_dot (A17)


CONCRETE = Ground(arc=0.8688, separated=1.0, pivot=0.527, large=0.45, kappa=0.10)


def drive_field(options: Options) -> Driven:
    """Scenario `field-tracked`: the same vehicle, as the field has it."""
    return drive(options, without(TRACKED, options.without))


def drive(options: Options, field: FieldConditions | None = None) -> Driven:
    """One run, noise-free. Raises InputError on an unknown ground."""
    ground = _ground(options)
    duration = options.duration or (FIELD_DURATION if field else DURATION)
    legs = cut(_legs(stream(options.seed, "plan")), duration)
    time = clock(options, duration)
    moves = commands(time, legs, SPEED_EASE, YAW_EASE, field.halt_ease if field else 0.0)
    sideways = -ground.kappa * CONTACT * moves.yaw_rate
    setup = _setup(stream(options.seed, "mounting"), options)
    if field:
        grade = options.grade or field.grade
        setup = replace(setup, grade=grade, rough=field.ground, field=field)
    truth = follow(options, setup, moves, sideways, np.zeros(len(time)))
    gearbox = slipping(options, setup, moves, _track_speed(moves, ground))
    return Driven(setup, moves, truth, gearbox, _constants(ground))


def _setup(rng: np.random.Generator, options: Options) -> SimulatedVehicle:
    lever = rng.uniform(0.05, 0.10, 3) * rng.choice([-1.0, 1.0], 3)
    mount = rng.uniform(0.1, 0.2, 3) * rng.choice([-1.0, 1.0], 3) * [1, 0, 1]
    return SimulatedVehicle(
        vehicle=VEHICLE,
        grade=options.grade or "fog",
        pulse=0.0108,
        nominal_lever=(0.30, -1.00, 0.80),
        lever_error=(lever[0], lever[1], lever[2]),
        mount_deg=(mount[0], mount[1], mount[2]),
        start=(40.12, 116.23, 60.0),
        heading_sd_deg=0.1,
        rough=ROUGH,
    )


def _ground(options: Options) -> Ground:
    """Concrete as in the paper; on soil the factors are 5-15 % off, mostly down, kappa larger."""
    if options.ground == "concrete":
        return CONCRETE
    if options.ground != "soil":
        raise InputError(f"ground '{options.ground}' is unknown: use concrete or soil")
    rng = stream(options.seed, "soil")
    off = 1 + rng.uniform(0.05, 0.15, 4) * rng.choice([-1.0, 1.0], 4, p=[0.7, 0.3])
    return Ground(
        arc=CONCRETE.arc * off[0],
        separated=CONCRETE.separated * off[1],
        pivot=CONCRETE.pivot * off[2],
        large=CONCRETE.large * off[3],
        kappa=rng.uniform(0.14, 0.25),
    )


def _legs(rng: np.random.Generator) -> Iterator[Leg]:
    """Endless legs: shuffled manoeuvres, now and then a fast straight between them."""
    yield Leg(STANDSTILL, 0.0, 0.0, "stop")
    while True:
        for name in rng.permutation(DECK):
            yield from _manoeuvre(rng, str(name))
            if rng.random() < FAST_SHARE:
                yield Leg(rng.uniform(60, 170), rng.uniform(7, 13.9), 0.0, "straight_high")


def _manoeuvre(rng: np.random.Generator, name: str) -> list[Leg]:
    """The legs of one manoeuvre: slow down first, turn, come out of it."""
    side = rng.choice([-1.0, 1.0])

    def turn(state: str, speed: float, radius: float, seconds: float) -> Leg:
        return Leg(seconds, speed, side * speed / radius, state)

    def between(gear: str, speed: float, middle: Leg) -> list[Leg]:
        straight = Leg(8.0, speed, 0.0, f"straight_{gear}")
        return [straight, middle, straight]

    if name == "arc":
        radius = R_ARC * rng.uniform(0.97, 1.06)
        return between("high", 4.0, turn("turn_arc", 4.0, radius, rng.uniform(3.2, 7.0)))
    if name == "separated":
        speed = rng.uniform(4.0, 5.2)
        radius = rng.uniform(35.0, 60.0)
        return between("high", speed, turn("turn_separated", speed, radius, rng.uniform(7, 13)))
    if name == "pivot":
        rate = rng.uniform(0.36, 0.42)
        return between(
            "high", 2.7, turn("turn_pivot", rate * R_PIVOT, R_PIVOT, rng.uniform(4.5, 6))
        )
    if name == "pivot_low":
        rate = rng.uniform(0.34, 0.40)
        middle = turn("turn_pivot_low", rate * R_PIVOT, R_PIVOT, rng.uniform(4.5, 6))
        return between("low", 2.0, middle)
    if name == "separated_low":
        middle = turn("turn_separated_low", 2.0, rng.uniform(30.0, 50.0), rng.uniform(8, 14))
        return between("low", 2.0, middle)
    if name == "low":
        return [Leg(rng.uniform(15, 30), 2.0, 0.0, "straight_low")]
    if name == "large":
        rate = rng.uniform(0.75, 0.95)
        return between("high", 2.7, turn("turn_large", 2.4, 2.4 / rate, rng.uniform(2.5, 4)))
    return [Leg(rng.uniform(22, 60), 0.0, 0.0, "stop")]


def _track_speed(moves: Commands, ground: Ground) -> Array:
    """The gearbox odometer (M,) m/s: the faster track, low gear ratio included."""
    factor, half_gauge = _tables(ground)
    gain = [
        (LOW_GEAR if leg.state.endswith("_low") else 1.0) / factor[leg.state] for leg in moves.legs
    ]
    half = [half_gauge[leg.state] for leg in moves.legs]
    gain_now = eased(moves.time, moves.edges, gain, GEAR_EASE)
    half_now = eased(moves.time, moves.edges, half, GEAR_EASE)
    return gain_now * (moves.speed + half_now * np.abs(moves.yaw_rate))


def _tables(ground: Ground) -> tuple[dict[str, float], dict[str, float]]:
    """Factor and half gauge [m] of every state, gear ratio left out."""
    factor = {
        "straight_high": 1.0,
        "straight_low": 1.0,
        "stop": 1.0,
        "turn_arc": ground.arc,
        "turn_pivot": ground.pivot,
        "turn_separated": ground.separated,
        "turn_separated_low": ground.separated,
        "turn_pivot_low": ground.pivot,
        "turn_large": ground.large,
    }
    half = {state: GAUGE / 2 if "separated" in state else 0.0 for state in factor}
    return factor, half


def _constants(ground: Ground) -> dict[str, object]:
    factor = _tables(ground)[0]
    low = {state: f / (LOW_GEAR if state.endswith("_low") else 1.0) for state, f in factor.items()}
    turning = [state for state in factor if state.startswith("turn")]
    return {
        "forward_factor": ("1", list(low), list(low.values())),
        "kappa": ("1", turning, [ground.kappa] * len(turning)),
        "lateral_offset_m": ("m", turning, [ground.kappa * CONTACT] * len(turning)),
    }
