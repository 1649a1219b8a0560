"""Alignment at rest, on the move, and what is said when it cannot be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from factors import so3
from graphnav.common.angles import angles_of_rotation, rotation_of_angles
from graphnav.common.earth import Origin
from graphnav.common.errors import InputError
from graphnav.common.run import Array, ExternalHeading, Gnss, Imu, Odometer, Run
from graphnav.inertial.alignment import Alignment, align
from graphnav.inertial.increments import increments
from graphnav.reading.vehicle import BodySpec, GnssSpec, ImuSpec, StartSpec, Vehicle

ORIGIN = Origin(np.deg2rad(45.0), np.deg2rad(10.0), 100.0)
STATED = StartSpec(lat=45.0, lon=10.0, height=100.0, heading_deg=77.0, heading_sd_deg=0.5)
PLACE = StartSpec(lat=45.0, lon=10.0, height=100.0)
RATE = 50.0


def vehicle(start: StartSpec = STATED, grade: str = "navigation") -> Vehicle:
    """A wheeled vehicle."""
    imu = ImuSpec.model_validate({"grade": grade})
    return Vehicle(vehicle=BodySpec(kind="wheeled"), imu=imu, gnss=GnssSpec(), start=start)


def at_standstill(roll: float, pitch: float, heading: float, gyro_bias: Array) -> Run:
    """60 s at rest on the turning Earth, angles in degrees, bias in rad/s."""
    R_nb = rotation_of_angles(*np.deg2rad(np.array([roll, pitch, heading])))
    n = round(60 * RATE)
    gyro = np.tile(R_nb.T @ ORIGIN.Omega_n + gyro_bias, (n, 1))
    accel = np.tile(-R_nb.T @ ORIGIN.gravity(np.zeros(3)), (n, 1))
    imu = Imu(np.arange(1, n + 1) / RATE, np.full(n, 1 / RATE), gyro, accel)
    return Run(Path("run.csv"), 0.0, 60.0, imu, None, None, None, None, None)


def moving(heading: float, fixes: bool = True) -> Run:
    """60 s at 10 m/s with bends, from the first sample on; flat ground."""
    n = round(60 * RATE)
    t = np.arange(1, n + 1) / RATE
    turn = 0.2 * np.sin(t / 4)
    angle = np.deg2rad(heading) - np.cumsum(turn) / RATE
    gyro = np.stack([0 * t, 0 * t, turn], -1)
    accel = np.stack([-10 * turn, 0 * t, 9.806 + 0 * t], -1)
    path = np.cumsum(10 / RATE * np.stack([np.sin(angle), np.cos(angle), 0 * t], -1), 0)
    at = np.arange(0, n, round(RATE))
    lat, lon, height = ORIGIN.geodetic(path[at])
    sd = np.ones((len(at), 3))
    gnss = Gnss(t[at], np.rad2deg(lat), np.rad2deg(lon), height, sd) if fixes else None
    odometer = Odometer(t, 10 * t, 10 + 0 * t, 0.0)
    imu = Imu(t, np.full(n, 1 / RATE), gyro, accel)
    return Run(Path("run.csv"), 0.0, 60.0, imu, odometer, None, gnss, None, None)


def aligned(run: Run, of: Vehicle, standstill_until: float = 60.0) -> Alignment:
    assert run.imu is not None
    return align(run, of, increments(run.imu), standstill_until)


def degrees(found: Alignment) -> Array:
    """Roll, pitch, heading."""
    return np.rad2deg(np.stack(angles_of_rotation(found.start.R_nb)))


@pytest.mark.parametrize(("roll", "pitch"), [(0, 0), (5, -3), (-10, 8)])
def test_levelling(roll: float, pitch: float) -> None:
    found = aligned(at_standstill(roll, pitch, 77.0, np.zeros(3)), vehicle())
    np.testing.assert_allclose(degrees(found), [roll, pitch, 77.0], atol=1e-4)
    assert found.source == "stated in [start]"
    assert found.start.sd[2] == pytest.approx(np.deg2rad(0.5))


def test_gyro_bias_of_a_standing_start() -> None:
    bias = np.array([1e-6, -2e-6, 1.5e-6])
    found = aligned(at_standstill(2, 1, 77.0, bias), vehicle(grade="tactical"))
    np.testing.assert_allclose(found.gyro_bias, bias, atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 77.0, 200.0, 359.0])
def test_gyrocompassing(heading: float) -> None:
    found = aligned(at_standstill(3, -2, heading, np.zeros(3)), vehicle(PLACE))
    assert found.source == "gyrocompass"
    error = (degrees(found)[2] - heading + 180) % 360 - 180
    assert error == pytest.approx(0, abs=1e-4)


def test_a_poor_gyro_does_not_compass() -> None:
    with pytest.raises(InputError, match="heading at the start is unknown"):
        aligned(at_standstill(0, 0, 10, np.zeros(3)), vehicle(PLACE, "mems"))


@pytest.mark.parametrize("heading", [20.0, 135.0, 300.0])
@pytest.mark.parametrize("with_odometer", [True, False])
def test_moving_start_takes_the_satellite_course(heading: float, with_odometer: bool) -> None:
    run = moving(heading)
    run = run if with_odometer else replace(run, odometer=None)
    found = aligned(run, vehicle(StartSpec(), "mems"), 0.0)
    assert found.source == "satellite course"
    roll, pitch, course = degrees(found)
    assert (course - heading + 180) % 360 - 180 == pytest.approx(0, abs=2.0)
    assert np.hypot(roll, pitch) < (0.5 if with_odometer else 8.0)


@pytest.mark.parametrize("off", [0.0, 13.0, 150.0])
def test_no_source_outvotes_the_path_alone(off: float) -> None:
    sensed = ExternalHeading(np.array([0.02]), np.deg2rad([20.0 + off]))
    stated = StartSpec(heading_deg=20.0 + off, heading_sd_deg=0.1)
    for run, start, source in (
        (replace(moving(20.0), heading=sensed), StartSpec(), "external heading"),
        (moving(20.0), stated, "stated in [start]"),
    ):
        found = aligned(run, vehicle(start, "mems"), 0.0)
        assert abs(degrees(found)[2] - 20.0) < 1.0
        assert found.source == (source if off == 0 else "satellite course")
        assert len(found.remarks) == (off > 0)
        for line in found.remarks:
            said = float(
                line.why.removeprefix(f"the heading {source} is wrong by ").split(" deg")[0]
            )
            assert said == pytest.approx(off, abs=1.0)


def test_the_origin_is_at_the_fixes_or_at_the_stated_start() -> None:
    run = moving(20.0)
    found = aligned(run, vehicle(StartSpec(), "mems"), 0.0)
    away = found.origin.local(np.float64(ORIGIN.lat), np.float64(ORIGIN.lon), np.float64(100.0))
    assert np.linalg.norm(away) < 100
    stated = aligned(moving(20.0, fixes=False), vehicle(STATED, "mems"), 0.0)
    assert (stated.origin.lat, stated.origin.height) == (np.deg2rad(45.0), 100.0)
    np.testing.assert_array_equal(stated.start.p_n, 0)


def test_no_place_is_said() -> None:
    with pytest.raises(InputError, match=r"\[start\] lat, lon, height and heading_deg"):
        aligned(moving(20.0, fixes=False), vehicle(StartSpec(), "mems"), 0.0)


def test_attitude_is_a_rotation() -> None:
    R = aligned(moving(20.0), vehicle(), 0.0).start.R_nb
    np.testing.assert_allclose(so3.orthonormalised(R), R, atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)


@pytest.mark.parametrize("off_m", [0.0, 1000.0])
def test_a_start_of_another_day_is_left_to_the_fixes(off_m: float) -> None:
    run = moving(20.0)
    assert run.gnss is not None
    late = run.gnss.time > 35.0
    columns = {k: v[late] for k, v in run.gnss.__dict__.items()}
    run = replace(run, gnss=Gnss(**columns))
    lat = 45.0 + off_m / 111_130
    at = StartSpec(lat=lat, lon=10.0, height=100.0, heading_deg=20.0, heading_sd_deg=1.0)
    found = aligned(run, vehicle(at, "mems"), 0.0)
    truth = found.origin.local(*np.deg2rad([45.0, 10.0]), np.asarray(100.0))
    assert np.linalg.norm((found.start.p_n - truth)[:2]) < (1e-3 if off_m == 0 else 60.0)
    assert found.start.sd[6] == (0.1 if off_m == 0 else 300.0)
    assert [remark.why[:12] for remark in found.remarks] == ["[start] is 9"] * (off_m > 0)
