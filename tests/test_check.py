"""Checks: wrong units and axes are caught, right ones pass, genuine jolts do not matter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from runs import VEHICLE, driven, saved, shared

from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.inertial.measured import measured
from graphnav.reading.axes import axes_matrix
from graphnav.reading.check import check
from graphnav.reading.read import read_run
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import load_vehicle, parse_vehicle

NAMES = ["kingston2008", "comma2k19", "husky", "sim_tracked", "sim_rlg", "sim_mimu"]
WITHOUT_START = VEHICLE[: VEHICLE.index("[start]")]


def pair(path: Path) -> tuple[Run, Vehicle]:
    vehicle = load_vehicle(None, path)
    return read_run(path, vehicle), vehicle


def with_imu(run: Run, gyro: float = 1.0, accel: float = 1.0, axes: str = "RFU") -> Run:
    """The run as an IMU of other units or axes would have recorded it."""
    assert run.imu is not None
    turn = axes_matrix(axes)
    imu = replace(run.imu, gyro=run.imu.gyro @ turn * gyro, accel=run.imu.accel @ turn * accel)
    return replace(run, imu=imu)


def with_way(run: Run, factor: float) -> Run:
    assert run.odometer is not None
    return replace(run, odometer=replace(run.odometer, distance=run.odometer.distance * factor))


def test_a_sound_run_has_no_findings(tmp_path: Path) -> None:
    assert check(*pair(saved(driven(), tmp_path))) == []


@pytest.mark.parametrize("name", NAMES)
def test_shared_runs_pass(name: str) -> None:
    findings = check(*pair(shared(name)))
    slow = name in ("kingston2008", "husky")  # 10 and 30 Hz
    assert len(findings) == slow, findings


@pytest.mark.parametrize("name", NAMES)
def test_degrees_given_as_radians_are_refused(name: str) -> None:
    run, vehicle = pair(shared(name))
    with pytest.raises(InputError, match=r'gyro = \{ unit = "deg/s" \}'):
        check(with_imu(run, gyro=180 / np.pi), vehicle)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("factor", "unit"), [(1 / 9.80665, "g"), (1000 / 9.80665, "mg")])
def test_accelerations_in_g_are_refused(name: str, factor: float, unit: str) -> None:
    run, vehicle = pair(shared(name))
    with pytest.raises(InputError, match=rf'accel = {{ unit = "{unit}" }}'):
        check(with_imu(run, accel=factor), vehicle)


@pytest.mark.parametrize("name", NAMES)
def test_gravity_taken_out_is_refused(name: str) -> None:
    run, vehicle = pair(shared(name))
    assert run.imu is not None
    accel = run.imu.accel - [0.0, 0.0, 9.8]
    with pytest.raises(InputError, match="leave gravity in"):
        check(replace(run, imu=replace(run.imu, accel=accel)), vehicle)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("axes", ["FRD", "UFL"])
def test_gravity_off_the_up_axis_names_the_axes(name: str, axes: str) -> None:
    run, vehicle = pair(shared(name))
    findings = check(with_imu(run, axes=axes), vehicle)
    assert any(f'axes = "{axes}" would fit' in finding for finding in findings)


@pytest.mark.parametrize("name", ["kingston2008", "comma2k19", "sim_tracked", "sim_rlg"])
def test_forward_on_another_axis_is_told(name: str) -> None:
    run, vehicle = pair(shared(name))
    findings = check(with_imu(run, axes="FLU"), vehicle)
    assert any('axes = "FLU" meant' in finding for finding in findings)


@pytest.mark.parametrize("name", ["kingston2008", "sim_mimu", "sim_tracked", "sim_rlg"])
def test_an_odometer_in_km_h_is_told(name: str) -> None:
    run, vehicle = pair(shared(name))
    assert any("km/h" in finding for finding in check(with_way(run, 3.6), vehicle))


def test_gyros_in_degrees_are_seen_at_rest_alone(tmp_path: Path) -> None:
    table = driven(30).assign(odo_speed=0.0, gyro_z=1e-4, accel_x=0.0, accel_y=0.0)
    table["gyro_y"] = np.rad2deg(1e-4)
    navigation = VEHICLE.replace("tactical", "navigation")
    with pytest.raises(InputError, match="at rest the gyros read"):
        check(*pair(saved(table, tmp_path, navigation)))


def test_jolts_of_one_sample_are_no_fault(tmp_path: Path) -> None:
    table = driven()
    table.loc[[700, 1400, 2100], "accel_y"] = [300.0, -300.0, 250.0]
    assert check(*pair(saved(table, tmp_path))) == []


def test_gaps_are_told_with_their_time(tmp_path: Path) -> None:
    run, vehicle = pair(saved(driven().drop(index=range(100, 150)), tmp_path))
    findings = check(measured(run), vehicle)
    assert any("lost 50 of 3000" in f and "1 s before 3.020" in f for f in findings), findings


def test_a_silent_odometer_is_told(tmp_path: Path) -> None:
    table = driven()
    table.loc[1000:1499, "odo_speed"] = np.nan  # 20 s to 30 s
    (finding,) = check(*pair(saved(table, tmp_path)))
    assert "odometer is silent once" in finding
    assert "19.820 to 30.020" in finding


def test_a_dead_odometer_is_told(tmp_path: Path) -> None:
    findings = check(*pair(saved(driven().assign(odo_speed=0.0), tmp_path)))
    assert any("never moves" in finding for finding in findings)


def test_a_dead_odometer_that_fixes_contradict_stops_the_run(tmp_path: Path) -> None:
    table = driven().assign(odo_speed=0.0)
    north = np.linspace(0.0, 300.0, len(table)) / 111e3
    fixes = table.assign(gnss_lat=45.0 + north, gnss_lon=10.0, gnss_height=1.0)
    run, vehicle = pair(saved(fixes, tmp_path))
    with pytest.raises(InputError, match=r"odometer never moves while the fixes travel 24\d m"):
        check(run, vehicle)
    assert any("never moves" in finding for finding in check(run, vehicle, use_gnss=False))


def test_wild_fixes_and_the_date_line_are_no_journey(tmp_path: Path) -> None:
    table = driven().assign(odo_speed=0.0, gnss_lat=60.0, gnss_lon=180.0, gnss_height=1.0)
    table.loc[::2, "gnss_lon"] = -179.99999
    table.loc[100, "gnss_lat"] = 60.1
    assert any(
        "never moves" in finding for finding in check(*pair(saved(table, tmp_path, WITHOUT_START)))
    )


def test_a_clock_in_milliseconds_is_told(tmp_path: Path) -> None:
    table = driven()
    with pytest.raises(InputError, match=r"is its clock in ms"):
        pair(saved(table.assign(time=table["time"] * 1000), tmp_path))


def test_fixes_in_radians_are_told(tmp_path: Path) -> None:
    lat, lon = np.deg2rad([45.0, 10.0])
    table = driven().assign(gnss_lat=lat, gnss_lon=lon, gnss_height=1.0)
    run, vehicle = pair(saved(table, tmp_path))
    with pytest.raises(InputError, match=r"seem to be in radians"):
        check(run, vehicle)


def test_nothing_says_where_the_run_began(tmp_path: Path) -> None:
    run, vehicle = pair(saved(driven(), tmp_path, WITHOUT_START))
    with pytest.raises(InputError, match=r"no GNSS fix.*\[start\] lat, lon"):
        check(run, vehicle)


def test_fixes_that_may_not_be_used_are_no_start(tmp_path: Path) -> None:
    table = driven().assign(gnss_lat=45.0, gnss_lon=10.0, gnss_height=1.0)
    run, vehicle = pair(saved(table, tmp_path, WITHOUT_START))
    assert check(run, vehicle)
    with pytest.raises(InputError, match="GNSS is not used"):
        check(run, vehicle, use_gnss=False)


def test_assumptions_are_told(tmp_path: Path) -> None:
    run, _ = pair(saved(driven(), tmp_path))
    start = {"lat": 45.0, "lon": 10.0}
    findings = check(run, parse_vehicle({"vehicle": {"kind": "tracked"}, "start": start}))
    assert any("gyro_bias_deg_h 200" in finding for finding in findings)
    assert any("track_gauge 2.8 m, contact_length 3.84 m" in finding for finding in findings)


def test_no_odometer_is_told(tmp_path: Path) -> None:
    (finding,) = check(*pair(saved(driven().drop(columns="odo_speed"), tmp_path)))
    assert "no odometer" in finding


def test_too_short(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing to smooth"):
        check(*pair(saved(driven(1.5), tmp_path)))
