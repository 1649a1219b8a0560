"""The streaming smoother: causal, independent of how samples are cut, and equal to the batch."""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from streams import cut, positions, prepared

from factors import so3
from graphnav import Smoother
from graphnav.batch.smoother import smooth_batch
from graphnav.cli.cli import main
from graphnav.graph.common_error import ASSUMED
from graphnav.graph.preparation import Prepared, prepare
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate
from graphnav.stream import incremental_graph, isam
from graphnav.stream import replay as incremental


@pytest.fixture(scope="module")
def stream(prep: Prepared) -> Smoother:
    return incremental.replayed(prep, None)


def test_an_estimate_never_changes_by_what_is_recorded_later(
    prep: Prepared, stream: Smoother
) -> None:
    part = incremental.replayed(cut(prep, 170.0), None)
    t, p = positions(stream)
    t_part, p_part = positions(part)
    common = t_part <= 170.0 - 1.0
    assert common.sum() > 40
    assert np.array_equal(t[: common.sum()], t_part[common])
    np.testing.assert_allclose(p_part[common], p[: common.sum()], atol=1e-9)


def test_the_pieces_samples_come_in_matter_only_to_the_linearisation(
    prep: Prepared, stream: Smoother
) -> None:
    whole, single = stream, incremental.replayed(prep, None, piece=1.0)
    t, p = positions(whole)
    t_single, p_single = positions(single)
    np.testing.assert_array_equal(t_single, t)
    sd = np.array([k.sd_enu for k in whole.history])
    settled = t > 150.0
    assert np.all(np.abs(p_single - p)[settled] < 0.6 * sd[settled])  # 0.50 as noise is learnt


def test_isam_holds_the_batch_solution_of_the_same_factors(stream: Smoother) -> None:
    graph = stream.graph
    assert graph is not None
    assert incremental.distance_from_batch(graph) < 0.05
    for _ in range(5):  # robust weights settle linearly, not quadratically
        graph.relinearise()
    assert incremental.distance_from_batch(graph) < 1e-3


def test_noise_is_learnt_as_the_run_doubles(prep: Prepared, stream: Smoother) -> None:
    """From what was driven so far; that of the running gear and the IMU, not that of the fixes."""
    graph, early = stream.graph, incremental.replayed(cut(prep, 130.0), None).graph
    assert graph is not None and early is not None
    assert not any("displacement" in key for key in early.log.scales)
    found, batch = graph.log.scales, smooth_batch(prep).scales
    assert found.keys() - ASSUMED.keys() == {key for key in batch if not key.startswith("gnss")}
    assert min(found.values()) >= incremental_graph.BOLDEST
    usual = "displacement:moving:{}:usual"
    for axis in ("lateral", "forward"):
        scale = max(batch[usual.format(axis)], incremental_graph.BOLDEST)
        assert found[usual.format(axis)] == pytest.approx(scale, rel=0.3)


def test_shedding_old_nodes_changes_nothing(
    prep: Prepared, stream: Smoother, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = cut(prep, 200.0)
    t, p = positions(incremental.replayed(short, None))
    monkeypatch.setattr(incremental_graph, "KEPT_S", 22.0)
    monkeypatch.setattr(isam, "MOST", 7)
    t_shed, p_shed = positions(incremental.replayed(short, None))
    np.testing.assert_array_equal(t_shed, t)
    np.testing.assert_allclose(p_shed, p, atol=1e-6)


def test_the_final_answer_is_the_batch_one(prep: Prepared) -> None:
    batch, replay = smooth_batch(prep), incremental.smooth_incremental(prep)
    path, other = replay.smoothed.path, batch.path
    assert np.linalg.norm(path.p_n - other.p_n, axis=1).max() < 0.01
    turn = so3.log(so3.transpose(path.R_nb) @ other.R_nb)
    assert np.rad2deg(np.linalg.norm(turn, axis=1)).max() < 1e-3
    assert replay.solver["isam_minus_batch_max_m"] < 0.05
    assert replay.solver["updates"] == len(replay.known)


def test_known_later_is_known_better(prep: Prepared, stream: Smoother) -> None:
    lagging = incremental.replayed(prep, 20.0)
    t, _ = positions(stream)
    t_lag, _ = positions(lagging)
    assert np.all(np.diff(t_lag) > 0)
    np.testing.assert_array_equal(t_lag[-len(t) :], t)
    sd = np.array([k.sd_enu for k in stream.history])
    sd_lag = np.array([k.sd_enu for k in lagging.history])[-len(t) :]
    early = t < t[-1] - 25.0
    assert np.all(sd_lag[early] <= sd[early] * 1.02)
    assert sd_lag[early].mean() < 0.95 * sd[early].mean()


def test_command_writes_what_was_known(
    wheeled_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "result"
    run = str(wheeled_run / "run.csv.gz")
    options = ["--mode", "incremental", "--out", str(out), "--no-rrd", "--no-report"]
    monkeypatch.setattr(sys, "argv", ["graphnav", "smooth", run, *options])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    found = pd.read_parquet(out / "trajectory_causal.parquet")
    known = ["time", "e", "n", "u", "v_e", "v_n", "v_u", "heading_deg"]
    sds = ["sd_e", "sd_n", "sd_v_e", "sd_v_n", "sd_v_u", "sd_heading_deg"]
    assert list(found) == [*known, *sds, "latency_ms"]
    assert len(found) > 100 and np.isfinite(found.to_numpy()).all()
    solver = json.loads((out / "summary.json").read_text())["solver"]
    assert solver["updates"] == len(found) and solver["median_ms"] > 0


def test_a_gap_of_the_imu_is_doubted_in_the_stream_too(tmp_path: Path) -> None:
    simulate("wheeled", tmp_path / "run", 8, duration=400.0, grade="mems", slips=True)
    path = tmp_path / "run" / "run.csv.gz"
    table = pd.read_csv(path)
    imu = [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    table.loc[table["time"].between(250.0, 256.0), imu] = np.nan
    table.to_csv(path, index=False)
    prep, truth = prepared(tmp_path / "run"), pd.read_csv(tmp_path / "run" / "truth.csv.gz")
    stream = incremental.replayed(prep, None)
    last = stream.history[-1]
    true = prep.setup.alignment.origin.local(
        *np.deg2rad(truth[["lat", "lon"]].to_numpy()[-1]), truth["height"].to_numpy()[-1]
    )
    assert np.linalg.norm((last.p_n - true)[:2]) < 4 * np.hypot(*last.sd_enu[:2])


def test_both_sides_take_part_in_the_stream(tmp_path: Path) -> None:
    """A skid-steered vehicle whose two sides are recorded: their turn finds the width of skidding
    in the stream as in the batch.
    """
    simulate("tracked", tmp_path / "run", 4, duration=400.0, grade="tactical")
    path = tmp_path / "run" / "run.csv.gz"
    table = pd.read_csv(path)
    turn, there = table["gyro_z"].rolling(20, min_periods=1).mean(), table["odo_pulses"].notna()
    speed = np.gradient(table.loc[there, "odo_pulses"] * 0.0108, table.loc[there, "time"])
    width = 4.2
    for name, way in (("odo_left", -0.5), ("odo_right", 0.5)):
        table.loc[there, name] = speed + way * width * turn[there]
    table.drop(columns="odo_pulses").to_csv(path, index=False)
    vehicle = load_vehicle(None, path)
    vehicle = vehicle.model_copy(
        update={"odometer": vehicle.odometer.model_copy(update={"column": "odo_speed"})}
    )
    prep = prepare(read_run(path, vehicle), vehicle, use_gnss=True, outages=())
    graph = incremental.replayed(prep, None).graph
    assert graph is not None
    column = prep.setup.layout.column("track_width")
    assert graph.everything().calibration[-1, column] == pytest.approx(width, abs=0.2)
    kinds = {block.kind for block in graph.whole(graph.everything()).linearise(graph.everything())}
    assert "track_width" in kinds
    assert incremental.distance_from_batch(graph) < 0.05


def test_a_stream_that_began_in_a_wrong_direction_begins_again(tmp_path: Path) -> None:
    """A stated heading 150 degrees wrong is followed only until the fixes contradict it."""
    simulate("wheeled", tmp_path / "run", 11, duration=200.0, grade="mems", gnss=True)
    vehicle = tmp_path / "run" / "vehicle.toml"
    text = vehicle.read_text()
    stated = text.split("heading_deg = ")[1].split("\n")[0]
    vehicle.write_text(text.replace(stated, f"{(float(stated) + 150) % 360:.4f}"))
    of = load_vehicle(vehicle, vehicle)
    run = read_run(next((tmp_path / "run").glob("run.csv*")), of)
    prep = prepare(run, of, use_gnss=True, outages=())
    stream = incremental.replayed(prep, None, piece=5.0)
    truth = pd.read_csv(next((tmp_path / "run").glob("truth.csv*")))
    known = stream.history[-1]
    last = truth.iloc[(truth["time"] - known.time).abs().argmin()]
    assert abs((known.heading_deg - last["heading_deg"] + 180) % 360 - 180) < 3.0
    assert all(a.time < b.time for a, b in zip(stream.history, stream.history[1:], strict=False))
