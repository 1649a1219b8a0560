"""A rover through the graph: gyro-free, with gyros, with sensors missing; the paper beside it."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graphnav.common.angles import angles_of_rotation
from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.reading.read import read_run
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import parse_vehicle
from graphnav.result.solved import Solved
from graphnav.rover.result import solve_rover
from graphnav.simulation import rover as simulator
from graphnav.simulation.rover_sensors import Conditions
from tools.rover_baseline import paper_track


class Case:
    """A simulated run through the files, as a user would give it."""

    def __init__(self, folder: Path, seed: int, conditions: Conditions) -> None:
        self.simulated = simulator.simulate(seed, conditions)
        self.simulated.write(folder)
        self.vehicle: Vehicle = parse_vehicle(tomllib.loads(self.simulated.vehicle))
        self.run: Run = read_run(folder / "run.csv", self.vehicle)
        truth = self.simulated.truth
        self.time = truth["time"].to_numpy() - self.run.clock_start
        origin = simulator.ORIGIN
        lla = np.radians(truth["lat"]), np.radians(truth["lon"]), truth["height"]
        p_n = origin.local(*(np.asarray(x) for x in lla))
        self.p_n = p_n - p_n[0]
        self.heading = np.radians(truth["heading_deg"].to_numpy())
        self.k = truth["slip_coefficient"].to_numpy()

    def errors(self, solved: Solved) -> tuple[float, float, float]:
        """Position at worst m, heading RMS deg, slip coefficient RMS while turning."""
        R, _, p = solved.path.at(self.time)
        k = next(c for c in solved.calibrated if c.name == "slip_coefficient")
        slip = np.interp(self.time, k.time, k.value[:, 0]) - self.k
        return self.scores(p, angles_of_rotation(R)[2], slip)

    def scores(
        self, p: np.ndarray, heading: np.ndarray, slip: np.ndarray
    ) -> tuple[float, float, float]:
        wrong = np.angle(np.exp(1j * (heading - self.heading)))
        turning = np.abs(np.gradient(np.unwrap(self.heading), self.time)) > 0.01
        return (
            float(np.linalg.norm((p - p[0] - self.p_n)[:, :2], axis=1).max()),
            float(np.degrees(np.sqrt(np.mean(wrong**2)))),
            float(np.sqrt(np.mean(slip[turning] ** 2))),
        )

    def paper(self) -> tuple[float, float, float]:
        track = paper_track(self.run, simulator.LINKAGE, float(self.heading[0]))
        p = np.stack([np.interp(self.time, track.time, x) for x in track.p_n.T], -1)
        heading = np.interp(self.time, track.time, np.unwrap(track.heading))
        slip = np.interp(self.time, track.time, track.slip_coefficient) - self.k
        return self.scores(p, heading, slip)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return Case(tmp_path_factory.mktemp("rover"), 21, Conditions(duration=1200.0))


@pytest.fixture(scope="module")
def solved(case: Case) -> Solved:
    return solve_rover(case.run, case.vehicle)


def test_gyro_free_beats_the_paper(case: Case, solved: Solved) -> None:
    assert case.run.imu is None
    worst, heading, slip = case.errors(solved)
    paper_worst, paper_heading, paper_slip = case.paper()
    assert worst < paper_worst / 3
    assert heading < paper_heading / 3
    assert slip < 0.025 < paper_slip


def test_errors_are_as_large_as_told(case: Case, solved: Solved) -> None:
    _, _, p = solved.path.at(case.time)
    node = np.searchsorted(solved.node_time, case.time).clip(0, len(solved.node_time) - 1)
    sd = np.sqrt(np.einsum("nii->ni", solved.node_covariance[node])[:, 6:8])
    share = (p - p[0] - case.p_n)[60:, :2] / sd[60:]
    assert np.mean(share**2) < 4  # one run is one draw: a small error proves nothing
    assert sd[-1].max() < 0.02 * float(np.sum(np.linalg.norm(np.diff(case.p_n, axis=0), axis=1)))


def test_states_and_spinning_wheels_are_told(case: Case, solved: Solved) -> None:
    true = case.simulated.truth["state"].to_numpy()
    assert np.mean(solved.timeline.state_at(case.time) == true) > 0.97
    wheel = case.run.rover.wheel.copy()  # type: ignore[union-attr]
    driven = np.flatnonzero(np.abs(wheel).min(axis=1) > 0.3)
    start = int(driven[len(driven) // 2])
    wheel[start : start + 100, 3] *= 1.8
    spun = replace(case.run, rover=replace(case.run.rover, wheel=wheel))  # type: ignore[type-var]
    again = solve_rover(spun, case.vehicle)
    spins = [e for e in again.wheel_events if e.kind == "wheel_spin" and e.axis == "wheel_4"]
    assert any(abs(e.start - 0.1 * start) < 3 for e in spins)
    assert case.errors(again)[0] < case.errors(solved)[0] + 0.5


def test_slip_is_not_read_from_ground_that_does_not_match(case: Case) -> None:
    gear = case.run.rover
    assert gear is not None
    level = replace(
        gear, rocker=0 * gear.rocker, bogie_left=0 * gear.rocker, bogie_right=0 * gear.rocker
    )
    blind = solve_rover(replace(case.run, rover=level), case.vehicle)
    assert not any(b.kind == "terrain_slip" and len(b.time) for b in blind.blocks)
    assert case.errors(blind)[1] < 3


@pytest.mark.parametrize("lost", ["heading", "accelerometer", "wheel", "steer"])
def test_a_sensor_may_be_missing(case: Case, lost: str) -> None:
    run, gear = case.run, case.run.rover
    assert gear is not None
    if lost == "heading":
        run = replace(run, heading=None)
    elif lost == "accelerometer":
        run = replace(run, accelerometer=None)
    elif lost == "wheel":
        wheel = gear.wheel.copy()
        wheel[:, 2] = np.nan
        run = replace(run, rover=replace(gear, wheel=wheel))
    else:
        run = replace(run, rover=replace(gear, steer=0 * gear.steer))
    worst, _, _ = case.errors(solve_rover(run, case.vehicle))
    way = float(np.linalg.norm(np.diff(case.p_n, axis=0), axis=1).sum())
    assert worst < 0.15 * way


def test_without_any_heading_it_says_what_is_missing(case: Case) -> None:
    start = case.vehicle.start.model_copy(update={"heading_deg": None})
    vehicle = case.vehicle.model_copy(update={"start": start})
    with pytest.raises(InputError, match="heading_deg"):
        solve_rover(replace(case.run, heading=None), vehicle)
    worst, _, _ = case.errors(solve_rover(case.run, vehicle))  # the sun alone suffices
    assert worst < 5


def test_without_geometry_it_names_the_keys(case: Case) -> None:
    spec = case.vehicle.rover.model_copy(update={"l_r1": None, "wheel_radius": None})
    with pytest.raises(InputError, match="l_r1, wheel_radius"):
        solve_rover(case.run, case.vehicle.model_copy(update={"rover": spec}))


def test_a_mems_gyro_makes_it_better_again(tmp_path: Path, case: Case, solved: Solved) -> None:
    with_gyro = Case(tmp_path, 21, Conditions(duration=1200.0, gyro=True))
    assert with_gyro.run.imu is not None
    worst, heading, slip = with_gyro.errors(solve_rover(with_gyro.run, with_gyro.vehicle))
    free = case.errors(solved)
    assert heading < 0.3 * free[1] and slip < free[2] * 1.05 and worst < 2.0


def test_a_solution_that_creeps_is_told(
    case: Case, solved: Solved, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not solved.remarks
    monkeypatch.setattr("graphnav.rover.smoother.FINE", 0.0)
    creeping = solve_rover(case.run, case.vehicle)
    assert [r.level for r in creeping.remarks] == [1]
    assert "does not settle" in creeping.remarks[0].why
