"""Simulated rover runs: graphnav, gyro-free and with a MEMS gyro, against the source's estimator.

python -m tools.rover_comparison 101 102 103 104 105
"""

import sys
import tempfile
import tomllib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graphnav.common.angles import angles_of_rotation
from graphnav.common.run import Run
from graphnav.reading.read import read_run
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import parse_vehicle
from graphnav.rover.result import solve_rover
from graphnav.simulation import rover
from graphnav.simulation.rover_sensors import Conditions
from tools.rover_baseline import paper_track

Array = NDArray[np.float64]
Score = tuple[float, float, float, float]  # end m, rms m, heading rms deg, k rms while turning
TURNING = 0.01  # rad/s


class Truth:
    """A run's truth on its own times."""

    def __init__(self, simulated: rover.Simulated) -> None:
        table = simulated.truth
        self.time = table["time"].to_numpy() - rover.CLOCK_START
        lat, lon = (np.radians(table[name].to_numpy()) for name in ("lat", "lon"))
        p_n = rover.ORIGIN.local(lat, lon, table["height"].to_numpy())
        self.p_n = p_n - p_n[0]
        self.heading = np.unwrap(np.radians(table["heading_deg"].to_numpy()))
        self.k = table["slip_coefficient"].to_numpy()

    def score(self, p_n: Array, heading: Array, k: Array) -> Score:
        """Errors of an estimate given at the truth's times."""
        off = np.linalg.norm((p_n - p_n[0] - self.p_n)[:, :2], axis=1)
        wrong = np.angle(np.exp(1j * (heading - self.heading)))
        turning = np.abs(np.gradient(self.heading, self.time)) > TURNING
        parts = (off, np.degrees(wrong), (k - self.k)[turning])
        rms = [float(np.sqrt(np.mean(x**2))) for x in parts]
        return float(off[-1]), rms[0], rms[1], rms[2]


def graphnav_score(run: Run, vehicle: Vehicle, truth: Truth, feel_ground: bool = True) -> Score:
    """This project's smoother."""
    solved = solve_rover(run, vehicle, feel_ground=feel_ground)
    R_nb, _, p_n = solved.path.at(truth.time)
    k = next(c for c in solved.calibrated if c.name == "slip_coefficient")
    slip = np.interp(truth.time, k.time, k.value[:, 0])
    return truth.score(p_n, angles_of_rotation(R_nb)[2], slip)


def paper_score(run: Run, truth: Truth, difference: float, compensate: bool) -> Score:
    """C1-C7; `difference` s and `compensate` choose the reading, see `paper_track`."""
    start = float(truth.heading[0])
    track = paper_track(run, rover.LINKAGE, start, difference, compensate)
    p_n = np.stack([np.interp(truth.time, track.time, x) for x in track.p_n.T], -1)
    heading = np.interp(truth.time, track.time, np.unwrap(track.heading))
    slip = np.interp(truth.time, track.time, track.slip_coefficient)
    return truth.score(p_n, heading, slip)


def loaded(seed: int, conditions: Conditions) -> tuple[Run, Vehicle, Truth]:
    """Simulate, write and read back."""
    simulated = rover.simulate(seed, conditions)
    with tempfile.TemporaryDirectory() as folder:
        simulated.write(Path(folder))
        vehicle = parse_vehicle(tomllib.loads(simulated.vehicle))
        return read_run(Path(folder) / "run.csv", vehicle), vehicle, Truth(simulated)


def scores(seed: int, episodes: int) -> dict[str, Score]:
    """All estimators on one seed."""
    run, vehicle, truth = loaded(seed, Conditions(episodes=episodes))
    table = {
        "paper as printed": paper_score(run, truth, 1.0, False),
        "paper, 10 s differences, k_s in yaw": paper_score(run, truth, 10.0, True),
        "graphnav, profile not felt": graphnav_score(run, vehicle, truth, False),
        "graphnav, gyro-free": graphnav_score(run, vehicle, truth),
    }
    table["graphnav, MEMS gyro"] = graphnav_score(
        *loaded(seed, Conditions(episodes=episodes, gyro=True))
    )
    return table


def main(arguments: list[str]) -> None:
    """One line per seed and estimator, then the means."""
    seeds = [int(x) for x in arguments if x.isdigit()] or [101, 102, 103, 104, 105]
    episodes = 0 if "--no-episodes" in arguments else Conditions.episodes
    print("seed  estimator                              end m   rms m  heading deg  k turning")
    every: dict[str, list[Score]] = {}
    for seed in seeds:
        for name, score in scores(seed, episodes).items():
            every.setdefault(name, []).append(score)
            print(_line(str(seed), name, score))
    for name, found in every.items():
        print(_line("mean", name, np.mean(found, axis=0)))


def _line(first: str, name: str, score: Iterable[float]) -> str:
    end, rms, heading, slip = score
    return f"{first:<5} {name:<36} {end:7.2f} {rms:7.2f} {heading:12.3f} {slip:10.4f}"


if __name__ == "__main__":
    main(sys.argv[1:])
