"""Runs of fewer sensors than six: accelerometers left out or zero throughout."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import driven, fixes, saved

from factors import so3
from graphnav.batch.smoother import position_variances, smooth_batch
from graphnav.common.errors import InputError
from graphnav.common.run import Array, Run
from graphnav.graph.inertial_noise import MISSED, inertial_noise
from graphnav.graph.preparation import Prepared, prepare
from graphnav.inertial.level_force import felt_when_level
from graphnav.inertial.measured import measured
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.simulation import simulate
from graphnav.stream.replay import smooth_incremental

ACCEL = ["accel_x", "accel_y", "accel_z"]
LEVEL_GYROS = ["gyro_x", "gyro_y"]


def read(path: Path) -> Run:
    return measured(read_run(path, load_vehicle(None, path)))


def prepared(path: Path, use_gnss: bool = True) -> Prepared:
    vehicle = load_vehicle(None, path)
    return prepare(read(path), vehicle, use_gnss=use_gnss, outages=())


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car with fixes, the first of them 23 m too high; it stands for some 87 s."""
    out = tmp_path_factory.mktemp("fewer") / "run"
    return simulate("wheeled", out, 61, duration=200, grade="mems", gnss=True)


def without(drive: Path, where: Path, names: list[str]) -> Path:
    table = pd.read_csv(drive / "run.csv.gz").drop(columns=names)
    return saved(table, where, (drive / "vehicle.toml").read_text())


def errors(prep: Prepared, truth: pd.DataFrame) -> tuple[Array, Array]:
    """Error (N, 3) m of the nodes and over its sigma."""
    found = smooth_batch(prep)
    time, origin = found.problem.nodes.time, prep.setup.alignment.origin
    lat, lon, height = (np.interp(time, truth.time, truth[k]) for k in ("lat", "lon", "height"))
    off = found.estimate.p_n - origin.local(np.deg2rad(lat), np.deg2rad(lon), height)
    return off, off / np.sqrt(position_variances(found.covariances))


@pytest.mark.parametrize(
    ("dropped", "use_gnss"),
    [(ACCEL, True), (LEVEL_GYROS + ACCEL, False), (ACCEL[1:2], False)],
)
def test_a_drive_without_accelerometers_is_honest(
    drive: Path, tmp_path: Path, dropped: list[str], use_gnss: bool
) -> None:
    path = without(drive, tmp_path, dropped)
    truth = pd.read_csv(drive / "truth.csv.gz")
    off, by_sigma = errors(prepared(path, use_gnss), truth)
    assert np.abs(off[:, :2]).max() < (2.0 if use_gnss else 8.0)
    assert np.sqrt((by_sigma**2).mean(0)).max() < 2.5


@pytest.mark.parametrize("way", ["left out", "zero"])
def test_accelerometers_that_were_not_recorded_are_told(tmp_path: Path, way: str) -> None:
    table = driven()
    kept = (
        table.drop(columns=ACCEL) if way == "left out" else table.assign(**dict.fromkeys(ACCEL, 0))
    )
    run = read(saved(kept, tmp_path))
    assert run.sensed == (True, True, True, False, False, False)
    assert any("accel_x, accel_y, accel_z not recorded" in note for note in run.notes)


def test_a_stand_in_is_not_screened(tmp_path: Path) -> None:
    """No sample of it is a spike or stuck."""
    run = read(saved(driven().drop(columns=ACCEL), tmp_path))
    assert not any("accelerometer is" in note for note in run.notes)


def test_a_stand_in_feels_the_odometer_in_the_vehicles_axes(tmp_path: Path) -> None:
    """What the odometer says once the vehicle is level, in the axes of a mounted IMU."""
    table = driven()
    run = read(saved(table.drop(columns=ACCEL), tmp_path))
    on = (table.time > 20) & (table.time < 59.5)
    true = table[ACCEL].to_numpy()[on]
    for mount_b in (np.zeros(3), np.array([0.05, 0.0, 0.02])):
        imu = felt_when_level(run, mount_b).imu
        assert imu is not None
        felt = (imu.accel @ so3.exp(mount_b))[on]  # v R_bm turns b into m
        assert np.abs(felt - true).max() < 0.5  # of 3 m/s^2; the odometer speaks at 5 Hz
        assert np.corrcoef(felt[:, 0], true[:, 0])[0, 1] > 0.99


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_was_not_recorded_has_no_say_and_no_noise(tmp_path: Path, axis: int) -> None:
    """Without one accelerometer its own row and the gyro that it held against gravity."""
    prep = prepared(saved(driven().drop(columns=ACCEL[axis]), tmp_path))
    nodes = np.arange(0, len(prep.sensed.inc.edge), 10)
    parts = inertial_noise(prep.sensed, nodes, np.zeros(0, np.int64), prep.setup.noise, {})
    learnt = np.all([(part > 0).any(0) for part in parts.parts.values()], axis=0)
    held = {0: [1, 3], 1: [0, 4], 2: [5]}[axis]
    np.testing.assert_array_equal(np.flatnonzero(~learnt), held)
    assert (parts.sigma[:, 3 + axis] > 100).all()


def test_what_a_stand_in_misses_leaks_into_other_axes_in_bends(tmp_path: Path) -> None:
    """As far as an interval turns about the third axis: 0.3 rad/s over a second, to and fro."""
    prep = prepared(saved(driven().drop(columns="accel_y"), tmp_path))
    nodes = np.arange(0, len(prep.sensed.inc.edge), 16)
    none = np.zeros(0, np.int64)
    fixed = inertial_noise(prep.sensed, nodes, none, prep.setup.noise, {}).fixed
    leaked = np.sqrt(fixed[:, 3:])
    turned = np.abs(np.add.reduceat(prep.sensed.inc.rotation, nodes[:-1])[:, 2])
    np.testing.assert_allclose(leaked[:, 0], MISSED * turned / np.sqrt(3))
    assert leaked[:, 0].max() > 0.05
    assert leaked[:, 2].max() < 1e-3


@pytest.mark.parametrize("dropped", [["odo_speed"], [*ACCEL, "odo_speed"], ACCEL])
def test_a_speed_that_rests_on_the_fixes_alone_is_doubtful(
    tmp_path: Path, dropped: list[str]
) -> None:
    prep = prepared(saved(fixes(driven()).drop(columns=dropped), tmp_path))
    said = [r for r in prep.setup.alignment.remarks if "fixes alone" in r.why]
    assert [r.level for r in said] == [1] * (len(dropped) == 4)


def test_a_stream_without_accelerometers_is_refused(tmp_path: Path) -> None:
    prep = prepared(saved(driven().drop(columns=ACCEL), tmp_path))
    with pytest.raises(InputError, match="without accelerometers a stream is not supported"):
        smooth_incremental(prep)


def test_a_run_in_which_nothing_tells_the_speed_is_refused(tmp_path: Path) -> None:
    table = driven().drop(columns=[*ACCEL, "odo_speed"])
    with pytest.raises(InputError, match="nothing tells the vehicle's speed"):
        prepared(saved(table, tmp_path))
