"""Simulated runs with exact inertial truth: `graphnav simulate SCENARIO --out DIR --seed N`.

A scenario is a plan of legs (`tracked`, `wheeled`, `skid`), driven over uneven ground (`drive`,
`ground`, `ride`, `slip`) on the rotating ellipsoid (`inertial`, `ellipsoid`), seen by sensors
(`grades`, `imu`, `vibration`, `recording`, `gnss`), stamped and lost (`stamps`) and written
(`files`). What the `field-*` scenarios add is in `field`. A new scenario is one more line in
`DRIVES` or `SCENARIOS`.

In: a scenario and a seed. Out: run, vehicle file and truth, as files.
Not here: the smoother's equations; what is tested by them must not be made by them.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, Unpack

from graphnav.common.errors import InputError
from graphnav.simulation import files, skid, tracked, wheeled
from graphnav.simulation.drive import Driven, Options
from graphnav.simulation.grades import GRADES, ImuErrors
from graphnav.simulation.inertial import Truth
from graphnav.simulation.recording import Recording, record

__all__ = ["GRADES", "SCENARIOS", "ImuErrors", "Options", "Recording", "Truth", "simulate"]
__all__ += ["simulate_truth"]

DRIVES: dict[str, Callable[[Options], Driven]] = {
    "tracked": tracked.drive,
    "wheeled": wheeled.drive_truck,
    "slip": wheeled.drive_car,
    "field-tracked": tracked.drive_field,
    "field-wheeled": wheeled.drive_field,
    "field-skid": skid.drive,
}


def _recorded(options: Options, drive: Callable[[Options], Driven]) -> Recording:
    return record(drive(options), options)


def _rover(options: Options) -> Recording:
    """Methods C; its own motion and sensors, kept apart for their size. A grade fits gyros."""
    from graphnav.simulation import rover, rover_sensors

    conditions = rover_sensors.Conditions()
    if options.duration is not None:
        conditions = replace(conditions, duration=options.duration)
    made = rover.simulate(options.seed, conditions)
    return Recording(made.run.round(10), made.truth.round(10), made.vehicle, {"seed": options.seed})


SCENARIOS: dict[str, Callable[[Options], Recording]] = {
    name: lambda options, drive=drive: _recorded(options, drive) for name, drive in DRIVES.items()
} | {"rover": _rover}


class Choices(TypedDict, total=False):
    """Keywords of `simulate`: the fields of Options."""

    grade: str | None  # one of GRADES, or None for the scenario's own
    ground: str  # concrete | soil (tracked)
    duration: float | None  # s
    gnss: bool
    slips: bool  # wheeled
    rate_hz: int  # 10 to 1000, of the IMU
    noise: float  # the IMU's white noise over its data sheet's
    sampled: bool  # values of an instant in place of means
    vibration: float  # of the field scenario's own
    without: tuple[str, ...]  # of field.EFFECTS


def simulate(scenario: str, out: Path, seed: int, **chosen: Unpack[Choices]) -> Path:
    """Simulate one run into the directory `out`; the same arguments give the same files.

    `scenario` is one of SCENARIOS, or slip as wheeled with `slips`. Raises InputError on an unknown
    choice or an `out` that holds something else.
    """
    options = Options(seed, **chosen)
    _checked(options)
    if not scenario.startswith("field-") and (options.without or options.vibration != 1):
        raise InputError(f"scenario '{scenario}' does not vibrate: use field-{scenario}")
    name = "slip" if options.slips and scenario == "wheeled" else scenario
    if name not in SCENARIOS:
        raise InputError(f"scenario '{scenario}' is unknown: use {', '.join(SCENARIOS)}")
    files.check(out)
    return files.write(SCENARIOS[name](options), out)


def simulate_truth(
    scenario: str = "tracked", seed: int = 0, *, duration: float = 600.0, ground: str = "concrete"
) -> Truth:
    """Noise-free truth in memory: turns, hills and shaking; no sensor errors."""
    options = Options(seed, duration=duration, ground=ground)
    _checked(options)
    return DRIVES[scenario](options).truth


def _checked(options: Options) -> None:
    """InputError on a figure out of range."""
    ranges = {
        "duration": (1.0, 1e5, "s"),
        "rate_hz": (10, 1000, "Hz"),
        "noise": (0.0, 1e4, ""),
        "vibration": (0.0, 100.0, ""),
    }
    for name, (least, most, unit) in ranges.items():
        value = getattr(options, name)
        if value is not None and not least <= value <= most:
            raise InputError(
                f"{name} {value:g} {unit}: choose {least:g} to {most:g} {unit}".strip()
            )
