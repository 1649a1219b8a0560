"""The streaming smoother: causal, independent of how samples are cut, and equal to the batch."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from factors import so3
from graphnav import Smoother
from graphnav.batch.smoother import smooth_batch
from graphnav.cli.cli import main
from graphnav.common.errors import InputError
from graphnav.common.run import Array, Run
from graphnav.graph.common_error import ASSUMED
from graphnav.graph.nodes import next_node
from graphnav.graph.preparation import Prepared, prepare
from graphnav.inertial.increments import increments
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate
from graphnav.stream import incremental_graph as growing
from graphnav.stream import isam
from graphnav.stream import replay as incremental
from graphnav.stream.inertial_intake import Inertial
from graphnav.stream.intake import Distance

SECONDS = 240.0  # of which the first 90 or so at rest


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("stream") / "wheeled"
    simulate("wheeled", out, 11, duration=SECONDS, grade="tactical", gnss=True)
    return out


@pytest.fixture(scope="module")
def prep(directory: Path) -> Prepared:
    return prepared(directory)


@pytest.fixture(scope="module")
def stream(prep: Prepared) -> Smoother:
    return incremental.replayed(prep, None)


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
    assert min(found.values()) >= growing.BOLDEST
    usual = "displacement:moving:{}:usual"
    for axis in ("lateral", "forward"):
        scale = max(batch[usual.format(axis)], growing.BOLDEST)
        assert found[usual.format(axis)] == pytest.approx(scale, rel=0.3)


def test_shedding_old_nodes_changes_nothing(
    prep: Prepared, stream: Smoother, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = cut(prep, 200.0)
    t, p = positions(incremental.replayed(short, None))
    monkeypatch.setattr(growing, "KEPT_S", 22.0)
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


def test_increments_of_a_stream_are_those_of_the_run(prep: Prepared) -> None:
    imu = prep.sensed.run.imu
    assert imu is not None
    inertial = Inertial()
    for part in np.array_split(np.arange(1500), [7, 8, 30, 131, 800, 802]):
        inertial.add(imu.time[part], imu.gyro[part], imu.accel[part])
    inertial.finish()
    n = len(inertial)
    whole, found = increments(imu), inertial.between(0, n)
    assert n >= 1500 // 5 - 1
    np.testing.assert_allclose(found.edge, whole.edge[: n + 1], atol=1e-12)
    for name in ("rotation", "velocity", "position", "jump"):
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name)[:n], atol=1e-12)


def test_distance_of_a_stream_is_that_of_the_run(prep: Prepared) -> None:
    odometer = prep.sensed.run.odometer
    assert odometer is not None and odometer.pulse > 0
    counts, speeds = Distance(odometer.pulse), Distance(0.0)
    for part in np.array_split(np.arange(400), [1, 2, 57, 300]):
        t = odometer.time[part]
        counts.add_pulses(t, odometer.distance[part] / odometer.pulse + 17, 150.0)
        speeds.add_speed(t, np.cos(t))
    found, by_speed = (d.around(0.0, odometer.time[399]) for d in (counts, speeds))
    assert found is not None and by_speed is not None
    np.testing.assert_allclose(found.distance, odometer.distance[:400], atol=1e-9)
    expected = np.sin(by_speed.time) - np.sin(by_speed.time[0])
    np.testing.assert_allclose(by_speed.distance, expected, atol=1e-2)


def test_nodes_stand_at_rests_fixes_and_seconds() -> None:
    edge = np.arange(0, 40, 0.05)
    still = ((edge[:-1] > 10.3) & (edge[:-1] < 25.7)).astype(float)
    fixes = np.array([2.4, 2.5, 3.3, 15.0])
    nodes = [0]
    while (found := next_node(nodes[-1], edge, still, fixes, 0.0, 1.0)) is not None:
        nodes.append(found)
    t = edge[nodes]
    near = [0, 1, 2, 2.4, 3, 3.3, 4, 5, 6, 7, 8, 9, 10, 10.35, 20.35, 25.7, 26]
    np.testing.assert_allclose(t[: len(near)], near, atol=0.051)
    assert np.diff(t).max() < 10.06
    # with less recorded the same nodes, as far as they are known
    part = [0]
    while (found := next_node(part[-1], edge, still[:500], fixes, 0.0, 1.0)) is not None:
        part.append(found)
    assert part == nodes[: len(part)] and len(part) >= 13


def test_nodes_stand_as_close_as_told() -> None:
    edge, still = np.arange(0, 20, 0.05), np.zeros(399)
    nodes = [0]
    while (found := next_node(nodes[-1], edge, still, np.array([3.33]), 0.0, 0.1)) is not None:
        nodes.append(found)
    step = np.diff(edge[nodes])
    assert len(nodes) > 190 and step.max() < 0.151 and step.min() > 0.049


def test_samples_one_by_one_and_a_latitude(directory: Path) -> None:
    table = pd.read_csv(directory / "run.csv.gz").head(14000)
    smoother = Smoother(directory / "vehicle.toml")
    assert smoother.estimate() is None
    for k in range(0, len(table), 50):
        rows = table.iloc[k : k + 50]
        for sensor in ("odo_pulses", "gnss_lat"):
            there = rows[rows[sensor].notna()]
            if sensor == "odo_pulses" and len(there):
                smoother.add_odometer(there["time"], pulses=there[sensor])
            elif len(there):
                place = (there[f"gnss_{k}"] for k in ("lat", "lon", "height"))
                smoother.add_gnss(there["time"], *place)
        gyro, accel = (rows[[f"{k}_{x}" for x in "xyz"]] for k in ("gyro", "accel"))
        smoother.add_imu(rows["time"], gyro, accel)
    known = smoother.estimate()
    assert known is not None
    truth = pd.read_csv(directory / "truth.csv.gz")
    at = np.interp(known.time, truth["time"], truth["lat"])
    assert abs(np.rad2deg(known.geodetic[0]) - at) < 2e-4
    assert 138.0 < known.time < 140.0


def test_a_stream_without_samples_says_so(directory: Path) -> None:
    with pytest.raises(InputError, match="too few"):
        Smoother(directory / "vehicle.toml").finish()
    with pytest.raises(InputError, match="either speed"):
        Smoother(directory / "vehicle.toml").add_odometer(0.0)


def test_command_writes_what_was_known(
    directory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "result"
    run = str(directory / "run.csv.gz")
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


def test_lag_needs_the_mode(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = str(directory / "run.csv.gz")
    monkeypatch.setattr(sys, "argv", ["graphnav", "smooth", run, "--lag", "5"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2


def test_importing_graphnav_stays_fast() -> None:
    code = "import sys, graphnav; sys.exit('gtsam' in sys.modules or 'numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("seconds", [2.5, 6.0, 40.0])
def test_a_short_run_begins_when_it_ends(prep: Prepared, seconds: float) -> None:
    stream = incremental.replayed(cut(prep, seconds), None)  # all of it at rest
    assert stream.graph is not None
    assert stream.graph.log.time.rows[-1] == pytest.approx(seconds, abs=0.1)
    assert np.isfinite(stream.graph.everything().p_n).all()


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


def test_an_odometer_that_begins_late_is_heard(prep: Prepared) -> None:
    run = prep.sensed.run
    assert run.odometer is not None
    on = run.odometer.time > 100.0
    late = replace(
        run.odometer, **{k: getattr(run.odometer, k)[on] for k in ("time", "distance", "speed")}
    )
    graph = incremental.replayed(with_run(prep, replace(run, odometer=late)), None).graph
    assert graph is not None
    kinds = {b.kind for b in graph.whole(graph.everything()).linearise(graph.everything())}
    assert "displacement" in kinds


def test_samples_that_are_no_numbers_are_left_out(directory: Path) -> None:
    smoother = Smoother(directory / "vehicle.toml")
    t = np.arange(1, 301) / 100
    gyro, accel = np.zeros((300, 3)), np.tile([0.0, 0.0, 9.8], (300, 1))
    gyro[17, 1], accel[40, 2] = np.nan, np.inf
    smoother.add_odometer(t[::10], pulses=np.where(t[::10] > 1, np.nan, 0.0))
    smoother.add_gnss(t[:1], [np.nan], [11.0], [100.0])
    smoother.add_imu([], np.zeros((0, 3)), np.zeros((0, 3)))
    smoother.add_imu(t, gyro, accel)
    assert np.isfinite(smoother.increments.rotation).all()


def test_misuse_of_the_stream_is_told_in_one_line(directory: Path) -> None:
    smoother = Smoother(directory / "vehicle.toml")
    smoother.add_imu(0.01, np.zeros(3), np.array([0.0, 0.0, 9.8]))
    smoother.add_odometer([0.1, 0.2], pulses=[0, 1])
    calls = [
        (lambda: smoother.add_imu(0.01, np.zeros(3), np.zeros(3)), "add_imu: time 0.01 after 0.01"),
        (lambda: smoother.add_imu([0.02, 0.03], np.zeros((3, 2)), np.zeros((3, 2))), "shape"),
        (lambda: smoother.add_odometer([0.3], pulses=[1, 2]), "add_odometer: values of shape"),
        (lambda: smoother.add_odometer([0.3], speed=[1.0]), "the same all the way"),
    ]
    for call, told in calls:
        with pytest.raises(InputError, match=told) as error:
            call()
        assert "\n" not in str(error.value)


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
