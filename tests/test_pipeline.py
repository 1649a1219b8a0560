"""`graphnav smooth` from files to files: every promise of interface.md on a short tracked run."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from smoothing import QUICK, changed, command, smoothed, summary, trajectory

from graphnav.batch.smoother import smooth_batch
from graphnav.common.earth import Origin
from graphnav.graph.preparation import prepare
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate

PROMISED = (
    "time lat lon height e n u v_e v_n v_u v_x v_y v_z roll_deg pitch_deg heading_deg "
    "sd_e sd_n sd_u sd_v_e sd_v_n sd_v_u sd_roll_deg sd_pitch_deg sd_heading_deg state"
)


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tracked vehicle with fixes, 300 s."""
    return simulate("tracked", tmp_path_factory.mktemp("t") / "run", 21, duration=300, gnss=True)


@pytest.fixture(scope="module")
def result(tracked: Path) -> Path:
    """Its whole result directory."""
    return smoothed(tracked, "--csv", "--report")


def test_every_file_is_there(result: Path) -> None:
    names = {path.name for path in result.iterdir()}
    assert names >= {
        "trajectory.parquet",
        "trajectory.csv",
        "states.csv",
        "events.csv",
        "calibration.json",
        "summary.json",
        "run.rrd",
        "report.html",
        "residuals.parquet",
        "dead_reckoning.parquet",
        "odometer.parquet",
        "gnss.parquet",
        "truth.parquet",
    }


def test_trajectory_has_every_column_and_no_hole(result: Path) -> None:
    table = trajectory(result)
    names = PROMISED.split()
    assert list(table.columns[: len(names)]) == names
    assert {"corr_en", "w_x", "w_y", "w_z"} <= set(table.columns)
    assert not table[names].isna().any().any()
    np.testing.assert_allclose(np.diff(table["time"]), 0.1, atol=1e-6)
    assert table["heading_deg"].between(0, 360).all()
    deviations = table[[name for name in names if name.startswith("sd_")]]
    assert (deviations > 0).all().all()
    assert table["corr_en"].between(-1, 1).all()
    pd.testing.assert_frame_equal(pd.read_csv(result / "trajectory.csv"), table, rtol=1e-12)


def test_columns_of_the_trajectory_agree_with_each_other(result: Path) -> None:
    table, said = trajectory(result), summary(result)["origin"]
    origin = Origin(np.deg2rad(said["lat"]), np.deg2rad(said["lon"]), said["height"])
    lat, lon = np.deg2rad(table[["lat", "lon"]].to_numpy().T)
    enu = table[["e", "n", "u"]].to_numpy()
    np.testing.assert_allclose(origin.local(lat, lon, table["height"]), enu, atol=1e-5)
    velocity = table[["v_e", "v_n", "v_u"]].to_numpy()
    slope = (enu[2:] - enu[:-2]) / 0.2
    assert np.sqrt(np.mean((slope - velocity[1:-1]) ** 2)) < 0.02
    speed = np.linalg.norm(velocity, axis=1)
    own = np.linalg.norm(table[["v_x", "v_y", "v_z"]].to_numpy(), axis=1)
    np.testing.assert_allclose(own, speed, atol=1e-9)
    straight = (table["state"] == "straight_high").to_numpy() & (speed > 3)
    course = np.arctan2(velocity[:, 0], velocity[:, 1])
    aside = np.angle(np.exp(1j * (course - np.deg2rad(table["heading_deg"]))))
    assert np.abs(np.rad2deg(np.median(aside[straight]))) < 0.5


def test_states_cover_the_run_without_gap(result: Path) -> None:
    states, table = pd.read_csv(result / "states.csv"), trajectory(result)
    assert list(states.columns[:3]) == ["start", "end", "state"]
    np.testing.assert_array_equal(states["start"][1:], states["end"][:-1])
    assert (states["end"] > states["start"]).all()
    assert states["start"].iloc[0] <= table["time"].iloc[0]
    assert states["end"].iloc[-1] >= table["time"].iloc[-1] - 1e-6
    middle = (states["start"] + states["end"]) / 2
    near = np.searchsorted(table["time"], middle)
    long = states["end"] - states["start"] > 0.5
    assert (table["state"].to_numpy()[near] == states["state"])[long].all()


def test_calibration_has_shapes_that_fit(result: Path) -> None:
    calibrations = json.loads((result / "calibration.json").read_text())
    assert {"gyro_bias_deg_h", "accel_bias_mg", "odometer_scale", "mounting_deg", "lever_arm_m",
            "time_offset_s", "forward_factor", "lateral_offset_m"} <= set(calibrations)  # fmt: skip
    for name, entry in calibrations.items():
        shape = (len(entry["time"]), len(entry["components"]))
        assert np.shape(entry["value"]) == np.shape(entry["sd"]) == shape, name
        assert np.shape(entry["prior"]) == np.shape(entry["prior_sd"]) == shape[1:], name
        assert len(entry["observable"]) == shape[1], name
        assert entry["constant"] == (shape[0] == 1), name
        # a run cannot know less than before; a wandering value may, by its wander
        if entry["constant"]:
            assert (np.array(entry["sd"]) <= np.array(entry["prior_sd"]) * 1.001).all(), name


def test_summary_says_what_was_promised(result: Path) -> None:
    said = summary(result)
    assert set(said) >= {
        *("run", "vehicle", "origin", "duration_s", "distance_m", "states", "solver", "stages"),
        *("peak_memory_mb", "residuals", "warnings", "verdicts", "comparison"),
        *("horizontal_rms_m", "horizontal_max_m", "horizontal_end_m"),
        *("permille_of_distance", "heading_rms_deg", "nees_horizontal"),
    }
    assert said["duration_s"] == pytest.approx(300, abs=0.1)
    assert said["distance_m"] == pytest.approx(said["comparison"]["distance_m"], rel=0.01)
    assert sum(s["seconds"] for s in said["states"].values()) == pytest.approx(300, abs=0.1)
    assert all(seconds >= 0 for seconds in said["stages"].values())
    assert {"displacement", "inertial", "gnss"} <= set(said["residuals"])


def test_other_tables_have_their_columns(result: Path) -> None:
    columns = {
        "dead_reckoning": "time e n u",
        "gnss": "time e n u sd_e sd_n sd_u weight",
        "odometer": "time raw_speed v_x v_y",
        "residuals": "time kind axis value weight",
        "truth": "time e n u state heading_deg",
    }
    for name, wanted in columns.items():
        table = pd.read_parquet(result / f"{name}.parquet")
        assert set(wanted.split()) <= set(table.columns), name
        assert len(table), name
        assert table["time"].between(-0.1, 301).all(), name
    events = pd.read_csv(result / "events.csv")
    assert list(events.columns) == ["start", "end", "kind", "axis", "peak_velocity"]


def test_times_are_on_the_files_own_clock(tracked: Path, tmp_path: Path) -> None:
    later = changed(tracked, tmp_path, lambda t: t.assign(time=t["time"] + 86400.0))
    assert command("smooth", later / "run.csv", "--out", later / "r", *QUICK) == 0
    for name in ("trajectory", "odometer", "residuals", "gnss", "dead_reckoning"):
        assert pd.read_parquet(later / "r" / f"{name}.parquet")["time"].min() > 86399, name
    assert pd.read_csv(later / "r" / "states.csv")["start"].iloc[0] > 86399


def test_tracked_run_with_fixes_is_accurate(result: Path) -> None:
    found = summary(result)["comparison"]
    assert found["horizontal_max_m"] < 1.0
    assert found["heading_rms_deg"] < 0.05
    assert found["state_accuracy"] > 0.97


def test_rows_per_second(tracked: Path) -> None:
    """The path is one, whatever the rate; above the increments' rate they become finer."""
    slow, fast = (trajectory(smoothed(tracked, *QUICK, "--rate", hz)) for hz in (1, 100))
    assert len(slow) in (300, 301)
    assert len(fast) in (30000, 30001)
    at = np.interp(slow["time"], fast["time"], fast["e"])
    np.testing.assert_allclose(slow["e"], at, atol=0.02)
    step = np.diff(fast[["v_e", "v_n"]].to_numpy(), axis=0)
    # no kink at the nodes (the simulated driver starts and stops with a jerk, twice)
    assert np.quantile(np.abs(step), 0.999) < 0.05


def test_more_nodes_tell_the_same_path(tracked: Path, result: Path) -> None:
    folders = result, smoothed(tracked, *QUICK, "--nodes", 4)
    counts = [json.loads((d / "summary.json").read_text())["solver"]["nodes"] for d in folders]
    assert counts[1] > 2.5 * counts[0]
    one, other = map(trajectory, folders)
    for axis in "en":
        assert (np.abs(one[axis] - other[axis]) < one[f"sd_{axis}"]).all()


def test_path_hits_the_nodes(tracked: Path) -> None:
    path = tracked / "run.csv.gz"
    vehicle = load_vehicle(None, path)
    found = smooth_batch(prepare(read_run(path, vehicle), vehicle, use_gnss=False, outages=()))
    nodes = found.problem.nodes
    np.testing.assert_allclose(found.path.time[nodes.edge], nodes.time, atol=1e-9)
    np.testing.assert_allclose(found.path.p_n[nodes.edge], found.estimate.p_n, atol=1e-6)
    np.testing.assert_allclose(found.path.v_n[nodes.edge], found.estimate.v_n, atol=1e-6)


def test_fixes_can_be_withheld(tracked: Path) -> None:
    """Withheld or ignored, they are still told."""
    without = smoothed(tracked, *QUICK, "--no-gnss")
    outage = smoothed(tracked, *QUICK, "--outage", "150:210", "--outage", "240:260")
    assert (without / "gnss.parquet").exists()
    used = pd.read_parquet(outage / "residuals.parquet").query("kind == 'gnss'")["time"]
    assert not used.between(150, 210).any()
    assert not used.between(240, 260).any()
    assert used.between(211, 239).any()
    assert "gnss" not in set(pd.read_parquet(without / "residuals.parquet")["kind"])


def test_a_foreign_directory_is_never_replaced(tracked: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").write_text("years of work")
    run = tracked / "run.csv.gz"
    assert command("smooth", run, "--out", mine, *QUICK) == 2
    assert [path.name for path in mine.iterdir()] == ["thesis.tex"]


def test_an_earlier_result_is_replaced_whole(tracked: Path) -> None:
    out = smoothed(tracked, *QUICK, "--csv")
    run = tracked / "run.csv.gz"
    assert command("smooth", run, "--out", out, *QUICK) == 0
    assert not (out / "trajectory.csv").exists()
    assert not (out / "truth.parquet").exists()
    assert "comparison" not in summary(out)


def test_the_same_input_gives_the_same_result(tracked: Path, result: Path) -> None:
    again = smoothed(tracked, *QUICK)
    pd.testing.assert_frame_equal(trajectory(again), trajectory(result), rtol=1e-9)
