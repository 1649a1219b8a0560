"""Scenarios `wheeled` (methods B, a truck), `slip` (methods D, a car that skids and hops), and
`field-wheeled`, a car on real roads."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from graphnav.simulation.drive import (
    Driven,
    Episode,
    Options,
    SimulatedVehicle,
    clock,
    follow,
    stream,
)
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.field import WHEELED, without
from graphnav.simulation.ground import Roughness
from graphnav.simulation.legs import Commands, Leg, commands, cut
from graphnav.simulation.slip import slipping

SPEED_EASE, YAW_EASE = 3.0, 0.8  # s
VEHICLE = '[vehicle]\nkind = "wheeled"\n'
EPISODE_EVERY = 1500.0 / 4  # s, of the unlisted ones
KINDS = ("side_slip", "hop", "wheel_spin", "wheel_lock")
SHARES = (0.4, 0.2, 0.2, 0.2)
LISTED = (Episode(400.0, 405.0, "side_slip", 5.0), Episode(900.0, 905.0, "hop", 5.0))


@dataclass(frozen=True)
class Traffic:
    """How a vehicle is driven: a turn may begin every `cadence`, speed and stops by chance."""

    duration: float  # s, default
    standstill: float  # s, before the first move
    cadence: float  # s
    speeds: tuple[float, ...]  # m/s
    stop_share: float  # of the cells, after the first ten minutes' first two
    lateral: float  # m/s^2, greatest
    tyre: float  # s, outward slip per lateral acceleration


TRUCK = Traffic(3848.0, 90.0, 45.0, (6.0, 10.0, 14.0, 17.0, 20.0), 0.08, 2.2, 0.0138)
CAR = Traffic(1500.0, 60.0, 50.0, (6.0, 8.0, 10.0, 12.0), 0.0, 1.6, 0.0)
FIELD_CAR = Traffic(900.0, 30.0, 40.0, (5.0, 8.0, 12.0, 16.0), 0.15, 2.0, 0.005)


def drive_truck(options: Options) -> Driven:
    """Methods B: ring-laser IMU, coarse pulses, lever arm and mounting known too badly."""
    rng = stream(options.seed, "mounting")
    lever = rng.uniform(0.10, 0.15, 3) * rng.choice([-1.0, 1.0], 3)
    mount = rng.uniform(0.1, 0.2, 3) * rng.choice([-1.0, 1.0], 3) * [1, 0, 1]
    setup = SimulatedVehicle(
        vehicle=VEHICLE,
        grade=options.grade or "navigation",
        pulse=0.02,
        nominal_lever=(0.20, -1.40, 0.90),
        lever_error=(lever[0], lever[1], lever[2]),
        mount_deg=(mount[0], mount[1], mount[2]),
        start=(39.8, 116.5, 40.0),
        heading_sd_deg=0.05,
        rough=Roughness(0.0189, 0.0083, 0.027, 0.0155, pitch_hz=9.3, roll_hz=5.0),
    )
    return _driven(options, setup, TRUCK, ())


def drive_car(options: Options) -> Driven:
    """Methods D: MEMS IMU, two listed episodes and others of any kind."""
    duration = options.duration or CAR.duration
    known = episodes(stream(options.seed, "episodes"), duration)
    return _driven(options, _car(options), CAR, known)


def drive_field(options: Options) -> Driven:
    """A car in traffic on uneven roads; the IMU is mounted a little askew."""
    field = without(WHEELED, options.without)
    rng = stream(options.seed, "mounting")
    lever = rng.uniform(0.03, 0.08, 3) * rng.choice([-1.0, 1.0], 3)
    mount = rng.uniform(0.2, 1.0, 3) * rng.choice([-1.0, 1.0], 3) * [1, 0, 1]
    setup = replace(
        _car(options),
        grade=options.grade or field.grade,
        nominal_lever=(0.2, -1.2, -0.4),
        lever_error=(lever[0], lever[1], lever[2]),
        mount_deg=(mount[0], mount[1], mount[2]),
        heading_sd_deg=1.0,
        rough=field.ground,
        field=field,
    )
    return _driven(options, setup, FIELD_CAR, ())


def _car(options: Options) -> SimulatedVehicle:
    return SimulatedVehicle(
        vehicle=VEHICLE,
        grade=options.grade or "mems",
        pulse=0.0,
        nominal_lever=(0.0, 0.0, 0.0),
        lever_error=(0.0, 0.0, 0.0),
        mount_deg=(0.0, 0.0, 0.0),
        start=(45.7796, 125.6705, 1.2),
        heading_sd_deg=0.3,
        rough=Roughness(0.0108, 0.0070, 0.0, 0.0, pitch_hz=9.0, roll_hz=5.0),
    )


def episodes(rng: np.random.Generator, duration: float) -> tuple[Episode, ...]:
    """The two listed episodes and four more per 1500 s, on straights, apart from each other."""
    found = [event for event in LISTED if event.end < duration]
    free = [
        start
        for start in np.arange(140.0, duration - 40.0, CAR.cadence).tolist()
        if all(abs(start + 25.0 - event.start) > 40.0 for event in LISTED)
    ]
    count = min(round(duration / EPISODE_EVERY), len(free))
    for cell in rng.choice(free, count, replace=False):
        start = round(float(cell + rng.uniform(18.0, 32.0)), 2)
        kind = str(rng.choice(KINDS, p=SHARES))
        seconds = float(rng.uniform(1.5, 3.0))
        peak = {
            "side_slip": rng.uniform(1.0, 2.0) * rng.choice([-1.0, 1.0]),
            "hop": rng.uniform(1.0, 2.0),
            "wheel_spin": rng.uniform(2.0, 5.0),
            "wheel_lock": -np.inf,
        }[kind]
        found.append(Episode(start, round(start + seconds, 2), kind, float(peak)))
    return tuple(sorted(found, key=lambda event: event.start))


def _driven(
    options: Options, setup: SimulatedVehicle, traffic: Traffic, events: tuple[Episode, ...]
) -> Driven:
    duration = options.duration or traffic.duration
    time = clock(options, duration)
    legs = cut(_legs(stream(options.seed, "plan"), traffic, events), duration)
    halt_ease = setup.field.halt_ease if setup.field else 0.0
    moves = commands(time, legs, SPEED_EASE, YAW_EASE, halt_ease)
    sideways = traffic.tyre * moves.speed * moves.yaw_rate + _burst(time, events, "side_slip")
    truth = follow(options, setup, moves, sideways, _burst(time, events, "hop"))
    odometer, known = _wheel_speed(moves, events)
    return Driven(setup, moves, truth, slipping(options, setup, moves, odometer), {}, known)


def _legs(rng: np.random.Generator, traffic: Traffic, events: tuple[Episode, ...]) -> Iterator[Leg]:
    """Endless cells of one cadence each: a turn at its start, then straight, or a stop."""
    yield Leg(traffic.standstill, 0.0, 0.0, "stop")
    speed = float(rng.choice(traffic.speeds))
    time, cell = traffic.standstill, 0
    yield Leg(10.0, speed, 0.0, "moving")
    time += 10.0
    while True:
        seconds = round(rng.uniform(6.0, 15.0), 1)
        angle = np.radians(rng.uniform(15.0, 95.0)) * rng.choice([-1.0, 1.0])
        rate = float(np.clip(angle / seconds, -traffic.lateral / speed, traffic.lateral / speed))
        clear = all(time > e.end + 5 or time + seconds < e.start - 5 for e in events)
        turns = rng.random() < 0.8 and clear and cell > 0
        yield Leg(seconds, speed, rate if turns else 0.0, "moving")
        rest = traffic.cadence - seconds
        if rng.random() < traffic.stop_share and cell > 2:
            halt = round(rng.uniform(12.0, 22.0), 1)
            yield Leg(halt, 0.0, 0.0, "stop")
            rest -= halt
        if rng.random() < 0.45:
            speed = float(rng.choice(traffic.speeds))
        yield Leg(rest, speed, 0.0, "moving")
        time, cell = time + traffic.cadence, cell + 1


def _burst(time: Array, events: tuple[Episode, ...], kind: str) -> Array:
    """Velocity (M,) m/s of a kind's episodes: constant acceleration up to the peak and back."""
    out = np.zeros(len(time))
    for event in events:
        if event.kind == kind:
            middle = (event.start + event.end) / 2
            rise = [event.start, middle, event.end]
            out += np.interp(time, rise, [0.0, event.peak_velocity, 0.0])
    return out


def _wheel_speed(moves: Commands, events: tuple[Episode, ...]) -> tuple[Array, tuple[Episode, ...]]:
    """Speed (M,) m/s at the wheel: spinning adds to it, a locked wheel stands still."""
    wheel = moves.speed + _burst(moves.time, events, "wheel_spin")
    known = []
    for event in events:
        peak = event.peak_velocity
        if event.kind == "wheel_lock":
            span = (moves.time >= event.start) & (moves.time < event.end)
            peak = -float(moves.speed[span].max(initial=0.0))
            wheel[span] = 0.0
        known.append(Episode(event.start, event.end, event.kind, peak))
    return wheel, tuple(known)
