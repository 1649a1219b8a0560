"""What a stream takes in: samples in pieces, late, broken or misused."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from streams import cut, with_run

from graphnav import Smoother
from graphnav.cli.cli import main
from graphnav.common.errors import InputError
from graphnav.graph.preparation import Prepared
from graphnav.inertial.increments import increments
from graphnav.stream import replay as incremental
from graphnav.stream.inertial_intake import InertialIntake
from graphnav.stream.intake import Distance


def test_increments_of_a_stream_are_those_of_the_run(prep: Prepared) -> None:
    imu = prep.sensed.run.imu
    assert imu is not None
    inertial = InertialIntake()
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


def test_samples_one_by_one_and_a_latitude(wheeled_run: Path) -> None:
    table = pd.read_csv(wheeled_run / "run.csv.gz").head(14000)
    smoother = Smoother(wheeled_run / "vehicle.toml")
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
    truth = pd.read_csv(wheeled_run / "truth.csv.gz")
    at = np.interp(known.time, truth["time"], truth["lat"])
    assert abs(np.rad2deg(known.geodetic[0]) - at) < 2e-4
    assert 138.0 < known.time < 140.0


def test_a_stream_without_samples_says_so(wheeled_run: Path) -> None:
    with pytest.raises(InputError, match="too few"):
        Smoother(wheeled_run / "vehicle.toml").finish()
    with pytest.raises(InputError, match="either speed"):
        Smoother(wheeled_run / "vehicle.toml").add_odometer(0.0)


def test_lag_needs_the_mode(wheeled_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = str(wheeled_run / "run.csv.gz")
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


def test_an_odometer_that_begins_late_is_heard(prep: Prepared) -> None:
    run = cut(prep, 150.0).sensed.run
    assert run.odometer is not None
    on = run.odometer.time > 100.0
    late = replace(
        run.odometer, **{k: getattr(run.odometer, k)[on] for k in ("time", "distance", "speed")}
    )
    graph = incremental.replayed(with_run(prep, replace(run, odometer=late)), None).graph
    assert graph is not None
    kinds = {b.kind for b in graph.whole(graph.everything()).linearise(graph.everything())}
    assert "displacement" in kinds


def test_samples_that_are_no_numbers_are_left_out(wheeled_run: Path) -> None:
    smoother = Smoother(wheeled_run / "vehicle.toml")
    t = np.arange(1, 301) / 100
    gyro, accel = np.zeros((300, 3)), np.tile([0.0, 0.0, 9.8], (300, 1))
    gyro[17, 1], accel[40, 2] = np.nan, np.inf
    smoother.add_odometer(t[::10], pulses=np.where(t[::10] > 1, np.nan, 0.0))
    smoother.add_gnss(t[:1], [np.nan], [11.0], [100.0])
    smoother.add_imu([], np.zeros((0, 3)), np.zeros((0, 3)))
    smoother.add_imu(t, gyro, accel)
    assert np.isfinite(smoother.increments.rotation).all()


def test_misuse_of_the_stream_is_told_in_one_line(wheeled_run: Path) -> None:
    smoother = Smoother(wheeled_run / "vehicle.toml")
    smoother.add_imu(0.01, np.zeros(3), np.array([0.0, 0.0, 9.8]))
    smoother.add_odometer([0.1, 0.2], pulses=[0, 1])
    calls = [
        (lambda: smoother.add_imu(0.01, np.zeros(3), np.zeros(3)), "add_imu: time 0.01 after 0.01"),
        (lambda: smoother.add_imu([0.02, 0.03], np.zeros((3, 2)), np.zeros((3, 2))), "shape"),
        (lambda: smoother.add_odometer([0.3], pulses=[1, 2]), "add_odometer: values of shape"),
        (lambda: smoother.add_odometer([0.3], speed=[1.0]), "the same all the way"),
    ]
    for call, message in calls:
        with pytest.raises(InputError, match=message) as error:
            call()
        assert "\n" not in str(error.value)
