"""Simulated runs with exact inertial truth: `graphnav simulate SCENARIO --out DIR --seed N`.

A scenario is a plan of legs (`tracked`, `wheeled`), driven over uneven ground (`drive`, `ground`)
on the rotating ellipsoid (`inertial`, `ellipsoid`), seen by sensors (`grades`, `recording`,
`gnss`) and written (`files`). A new scenario is one more line in `DRIVES` or `SCENARIOS`.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from graphnav.common.errors import InputError
from graphnav.simulation import files, tracked, wheeled
from graphnav.simulation.drive import Driven, Options
from graphnav.simulation.grades import GRADES, Grade
from graphnav.simulation.inertial import Truth
from graphnav.simulation.recording import Recording, record

__all__ = ["GRADES", "SCENARIOS", "Grade", "Options", "Recording", "Truth", "simulate"]
__all__ += ["simulate_truth"]

RATES_HZ = (100, 200)

DRIVES: dict[str, Callable[[Options], Driven]] = {
    "tracked": tracked.drive,
    "wheeled": wheeled.drive_truck,
    "slip": wheeled.drive_car,
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


def _grade(name: str) -> Grade:
    if name not in GRADES:
        raise InputError(f"IMU grade '{name}' is unknown: use {', '.join(GRADES)}")
    return GRADES[name]


SCENARIOS: dict[str, Callable[[Options], Recording]] = {
    name: lambda options, drive=drive: _recorded(options, drive) for name, drive in DRIVES.items()
} | {"rover": _rover}


def simulate(
    scenario: str,
    out: Path,
    seed: int,
    *,
    grade: str | None = None,
    ground: str = "concrete",
    duration: float | None = None,
    gnss: bool = False,
    slips: bool = False,
    rate_hz: int = 100,
) -> Path:
    """Simulate one run into the directory `out`; the same arguments give the same files.

    `scenario` tracked | wheeled | slip (wheeled with `slips`) | rover; `grade` one of GRADES or
    None for the scenario's own; `ground` concrete | soil (tracked); `duration` s;
    `rate_hz` 100 or 200, of the IMU. Raises InputError on an unknown choice or an `out` that holds
    something else.
    """
    if rate_hz not in RATES_HZ:
        raise InputError(f"IMU rate {rate_hz} Hz: choose {' or '.join(map(str, RATES_HZ))}")
    options = Options(seed, _checked(duration), grade, ground, gnss, slips, rate_hz)
    name = "slip" if slips and scenario == "wheeled" else scenario
    if name not in SCENARIOS:
        raise InputError(f"scenario '{scenario}' is unknown: use {', '.join(SCENARIOS)}")
    files.check(out)
    return files.write(SCENARIOS[name](options), out)


def simulate_truth(
    scenario: str = "tracked", seed: int = 0, *, duration: float = 600.0, ground: str = "concrete"
) -> Truth:
    """Noise-free truth in memory: turns, hills and shaking; no sensor errors."""
    return DRIVES[scenario](Options(seed, duration=_checked(duration), ground=ground)).truth


def _checked(duration: float | None) -> float | None:
    if duration is not None and not 1.0 <= duration <= 1e5:
        raise InputError(f"duration {duration:g} s: choose 1 to 100000 s")
    return duration
