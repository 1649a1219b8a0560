"""The result is judged before it is given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from smoothing import QUICK, changed, command, summary

from factors import so3
from graphnav.batch import causes, doubts, fix_doubts, noise_doubts
from graphnav.batch.hypotheses import hypotheses
from graphnav.batch.judgement import judge
from graphnav.common.angles import wrapped
from graphnav.common.remark import Remark
from graphnav.common.run import Run
from graphnav.pipeline import solve
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import trajectory
from graphnav.result.quality import Spread, graded, in_one_line
from graphnav.result.result_directory import load
from graphnav.result.solved import Solved, start_heading_deg
from graphnav.simulation import simulate

SPREAD = Spread(0.8, 2.1, 1834.0)
FIXES = ["gnss_lat", "gnss_lon", "gnss_height"]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated car with fixes."""
    where = tmp_path_factory.mktemp("quality") / "drive"
    simulate("wheeled", where, 5, grade="mems", duration=240, gnss=True)
    return where


@pytest.fixture(scope="module")
def solved(drive: Path) -> Solved:
    """The drive, smoothed."""
    path = drive / "run.csv.gz"
    vehicle = load_vehicle(None, path)
    return solve(read_run(path, vehicle), vehicle)


def grade_of(solved: Solved) -> str:
    return judge(solved, trajectory.table(solved, 10.0), solved.run).grade


def doubting(solved: Solved, kind: str, share: float, away: float = 50.0) -> Solved:
    """The run with a share of the factors of a kind doubted, `away` sigma off."""
    blocks, weights = [], []
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        doubted = (np.arange(len(weight)) < share * len(weight))[:, None] & (block.kind == kind)
        blocks.append(replace(block, residual=block.residual + away * doubted))
        weights.append(np.where(doubted, 0.1, 1.0) * np.ones_like(weight))
    return replace(solved, blocks=blocks, weights=weights)


def test_a_quality_is_as_bad_as_its_worst_doubt_which_is_told_first() -> None:
    found = graded(
        [Remark("a", "x", level=1), Remark("b", level=2), Remark("c", "x")], SPREAD, 0.02
    )
    assert (found.grade, found.why, found.remedy) == ("rejected", ("b", "a", "c"), ("x",))
    assert graded([Remark("c")], SPREAD, 0.02).grade == "good"
    assert graded([], SPREAD, 0.02).grade == "good"


def test_the_first_line_says_how_far_to_rely_on_it() -> None:
    line = in_one_line(graded([Remark("turned", level=2)], SPREAD, 0.0213).as_dict())
    assert line == (
        "position +- 0.8 m, worst +- 2.1 m at 1834 s; heading +- 0.021 deg: REJECTED; turned"
    )


def test_a_heading_is_told_of_what_it_is_stated_of(solved: Solved) -> None:
    """A user who states the vehicle's heading is told the vehicle's, not that of an IMU askew."""
    ten = so3.exp(np.array([0, 0, np.deg2rad(-10.0)]))  # the vehicle points 10 deg to its right
    askew = replace(solved, R_bm=ten)
    start = solved.vehicle.start.model_copy(update={"heading_of": "vehicle"})
    of_vehicle = replace(askew, vehicle=solved.vehicle.model_copy(update={"start": start}))
    by_deg = wrapped(start_heading_deg(of_vehicle) - start_heading_deg(askew), 360.0)
    assert by_deg == pytest.approx(10.0, abs=0.1)


def test_a_healthy_run_is_good(solved: Solved) -> None:
    assert grade_of(solved) == "good"


@pytest.mark.parametrize(
    ("kind", "share", "grade"),
    [
        ("gnss", 0.3, "doubtful"),
        ("gnss", 0.6, "rejected"),
        ("displacement", 0.2, "doubtful"),
        ("displacement", 0.7, "rejected"),
    ],
)
def test_what_was_doubted_grades(
    solved: Solved, kind: str, share: float, grade: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(causes, "likeliest", lambda run, vehicle, work: [])
    assert grade_of(doubting(solved, kind, share)) == grade


def test_fixes_that_scatter_about_the_path_do_not_reject_it(
    solved: Solved, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(causes, "likeliest", lambda run, vehicle, work: [])
    assert grade_of(doubting(solved, "gnss", 0.9, away=0.0)) == "doubtful"
    assert grade_of(doubting(solved, "displacement", 0.9, away=0.0)) == "doubtful"
    gnss = solved.run.gnss
    assert gnss is not None and not fix_doubts.of_fix_deviations(solved)
    bold = replace(solved, run=replace(solved.run, gnss=replace(gnss, sd_enu=gnss.sd_enu / 30)))
    [remark] = fix_doubts.of_fix_deviations(bold)
    assert "scatter" in remark.why and "gnss_sd_e" in remark.remedy


def test_multipath_between_good_fixes_is_a_disturbance() -> None:
    time, doubted = np.arange(100.0), np.zeros(100, bool)
    doubted[[3, 20, 21, 22, 23, 24]] = True
    doubted[40:75] = doubted[97:] = True
    # single ones, one of 34 s and one that goes on to the end may be the path's own fault
    expected = np.zeros(100, bool)
    expected[20:25] = True
    np.testing.assert_array_equal(doubts.disturbed(time, doubted, 30.0), expected)
    assert not doubts.disturbed(time, doubted, 0.0).any()


def test_a_start_of_another_day_is_told(solved: Solved) -> None:
    columns = trajectory.table(solved, 10.0)
    assert not fix_doubts.of_stated_position(solved, columns)
    at = solved.vehicle.start
    assert at.lat is not None
    elsewhere = at.model_copy(update={"lat": at.lat + 0.01})
    moved = replace(solved, vehicle=solved.vehicle.model_copy(update={"start": elsewhere}))
    [remark] = fix_doubts.of_stated_position(moved, columns)
    assert remark.why == "[start] is 1.1 km from where the fixes put the start"
    found = judge(moved, columns, moved.run)
    assert (found.grade, found.why) == ("doubtful", (remark.why,))
    before = replace(remark, why="[start] is not used")
    found = judge(replace(moved, remarks=(before,)), columns, moved.run)
    assert (found.grade, found.why) == ("doubtful", (before.why,))


def test_a_calibration_its_prior_excludes_is_told(solved: Solved) -> None:
    [scale] = [c for c in solved.calibrated if c.name == "odometer_scale"]
    off = replace(scale, value=0 * scale.value + 0.2776)
    [doubt] = doubts.of_calibrations([off])
    assert doubt.level == 1
    assert "0.2776 (km/h?)" in doubt.why and "unit" in doubt.remedy
    assert not doubts.of_calibrations([scale])


def test_motion_no_vehicle_has_is_rejected() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    speed = np.where(time < 10, 10.0, 150.0)
    columns = {"time": time, "v_e": speed, "v_n": 0 * time, "v_u": 0 * time}
    said = doubts.of_motion(columns)
    assert [d.level for d in said] == [2, 2]
    assert "150 m/s" in said[0].why
    assert not doubts.of_motion(columns | {"v_e": np.full(len(time), 30.0)})


def test_a_rejected_result_is_written_and_marked(
    drive: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(causes, "likeliest", lambda run, vehicle, work: [])  # tried elsewhere

    def backwards(table: pd.DataFrame) -> pd.DataFrame:
        """The fixes of a drive the other way round."""
        on = table["gnss_lat"].notna()
        table.loc[on, FIXES] = table.loc[on, FIXES].to_numpy()[::-1]
        return table

    run = changed(drive, tmp_path, backwards) / "run.csv"
    assert command("smooth", run, "--out", tmp_path / "out", *QUICK) == 3
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and "rejected" in said.err
    assert said.out.startswith("position +- ") and "REJECTED" in said.out.splitlines()[0]
    found = summary(tmp_path / "out")["quality"]
    assert set(found) == {"grade", "why", "remedy", "position_sd_m", "heading_sd_deg"}
    assert found["grade"] == "rejected" and found["why"]
    assert "REJECTED" in load(tmp_path / "out").title
    assert pd.read_parquet(tmp_path / "out" / "trajectory.parquet").attrs["quality"] == "rejected"


MIRRORED = np.diag([-1.0, 1.0, 1.0])
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def lying(run: Run, turn: np.ndarray) -> Run:
    """The run with its IMU turned."""
    assert run.imu is not None
    imu = replace(run.imu, gyro=run.imu.gyro @ turn.T, accel=run.imu.accel @ turn.T)
    return replace(run, imu=imu)


@pytest.mark.parametrize(
    ("turn", "why", "remedy"), [(MIRRORED, "x is mirrored", "sign"), (TURNED, "90 deg", '"BRU"')]
)
def test_how_an_imu_lies_is_felt_in_bends(
    solved: Solved, turn: np.ndarray, why: str, remedy: str
) -> None:
    first = hypotheses(replace(lying(solved.run, turn), gnss=None), solved.vehicle)[0]
    assert why in first.why(solved) and remedy in first.remedy(solved)


def test_a_cause_is_tried_before_it_is_named(
    solved: Solved, monkeypatch: pytest.MonkeyPatch
) -> None:
    odometer = solved.run.odometer
    assert odometer is not None
    km_h = replace(odometer, distance=3.6 * odometer.distance, speed=3.6 * odometer.speed)
    run, allowed = replace(solved.run, odometer=km_h), 10**9
    [found] = causes.likeliest(run, solved.vehicle, allowed)
    assert "km/h" in found.why
    # trials take no longer than what is allowed, and that is told
    monkeypatch.setattr(causes, "FREE", 0)
    [stopped] = causes.likeliest(run, solved.vehicle, 1)
    assert "0 of" in stopped.why and stopped.level == 0


def test_a_healthy_run_has_no_cause(solved: Solved) -> None:
    assert causes.likeliest(solved.run, solved.vehicle, 10**9) == []


def test_a_stated_heading_that_does_not_hold_is_doubt(solved: Solved) -> None:
    heading = float(trajectory.table(solved, 10.0)["heading_deg"][0])

    def doubt(off: float) -> float:
        start = solved.vehicle.start.model_copy(
            update={"heading_deg": (heading + off) % 360, "heading_sd_deg": 1.0}
        )
        vehicle = solved.vehicle.model_copy(update={"start": start})
        return causes.doubt(replace(solved, vehicle=vehicle))

    assert doubt(180.0) == doubt(-90.0) == pytest.approx(doubt(0.5) + 0.3)


def test_the_imus_noise_is_told_where_its_residuals_show_it(solved: Solved) -> None:
    noise = solved.solver["imu_noise"]
    assert set(noise) == {"standing", "driving"}
    assert noise["driving"]["accel_mg_sqrt_hz"] == pytest.approx([0.2] * 3, rel=1.0)
    assert not noise_doubts.of_inertial_noise(solved)
    sheet = solved.vehicle.imu.gyro_noise_deg_sqrt_h
    loud = noise | {"driving": noise["driving"] | {"gyro_deg_sqrt_h": [sheet, sheet, 40 * sheet]}}
    shaken = replace(solved, solver=solved.solver | {"imu_noise": loud})
    [remark] = noise_doubts.of_inertial_noise(shaken)
    assert "gyros are 40 times as noisy while driving" in remark.why and remark.level == 0
    blocks = [replace(b, residual=0 * b.residual) for b in solved.blocks]
    assert not noise_doubts.of_inertial_noise(replace(shaken, blocks=blocks))


def test_a_vehicle_carried_as_it_stands_is_told(solved: Solved) -> None:
    assert not fix_doubts.of_carried(solved)
    moved = np.array([[40.0, 90.0, 1.0, 0.0], [100.0, 110.0, 0.0, 1.0]])
    ferry, lift = fix_doubts.of_carried(replace(solved, moved=moved))
    assert ferry.why == "the odometer stands while the fixes move from 40 to 90 s"
    assert lift.why == "the vehicle is lifted or lowered as it stands from 100 to 110 s"


@pytest.mark.parametrize(
    ("left", "named"),
    [([0.05, 0.4], True), ([0.28, 0.52], True), ([0.28, 0.29], False), ([0.5, 0.57], False)],
)
def test_a_cause_is_named_where_it_stands_out(left: list[float], named: bool) -> None:
    assert causes._convicted(0.57, left) == named
