"""Prepared runs for tests of the stream: whole, cut, changed."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from graphnav import Smoother
from graphnav.common.run import Array, Run
from graphnav.graph.preparation import Prepared, prepare
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate


def wheeled(where: Path, seconds: float) -> Path:
    """A simulated car with fixes that stands for the first 90 s or so."""
    out = where / "wheeled"
    simulate("wheeled", out, 11, duration=seconds, grade="tactical", gnss=True)
    return out


def prepared(directory: Path) -> Prepared:
    path = directory / "run.csv.gz"
    vehicle = load_vehicle(None, path)
    return prepare(read_run(path, vehicle), vehicle, use_gnss=True, outages=())


def positions(stream: Smoother) -> tuple[Array, Array]:
    """Times and positions of what was known."""
    return np.array([k.time for k in stream.history]), np.array([k.p_n for k in stream.history])


def with_run(prep: Prepared, run: Run) -> Prepared:
    return replace(prep, sensed=replace(prep.sensed, run=run))


def cut(prep: Prepared, end: float) -> Prepared:
    """The same run, recorded until `end` only."""
    run = prep.sensed.run
    i, o, g = (np.searchsorted(s.time, end, "right") for s in (run.imu, run.odometer, run.gnss))
    sensors = {
        name: type(s)(*(v[:n] if np.ndim(v) else v for v in vars(s).values()))
        for name, s, n in (
            ("imu", run.imu, i),
            ("odometer", run.odometer, o),
            ("gnss", run.gnss, g),
        )
    }
    return with_run(prep, replace(run, end=end, **sensors))
