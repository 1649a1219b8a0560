"""How the IMU lies in the vehicle: found, said, and read so."""

from dataclasses import replace

import numpy as np
import pytest
from test_alignment import moving, vehicle

from factors import so3
from graphnav.common.errors import InputError
from graphnav.common.run import Array, Imu, Odometer, Run
from graphnav.inertial.increments import increments
from graphnav.inertial.mounting import lie
from graphnav.inertial.orientation import Oriented, oriented
from graphnav.inertial.pace import pace
from graphnav.reading.axes import axes_matrix, right_handed
from graphnav.reading.vehicle import StartSpec, Vehicle

STATED = StartSpec(lat=45.0, lon=10.0, heading_deg=77.0)


def driven(R: Array, seed: int = 3) -> Run:
    """A 60 s drive with bends, braking and a hilly road; the IMU lies turned by R (3, 3)."""
    run = moving(20.0, fixes=False)
    assert run.imu is not None and run.odometer is not None
    t, dt = run.imu.time, float(run.imu.dt[0])
    speed = 10 + 3 * np.sin(t / 3)
    accel = run.imu.accel.copy()
    accel[:, 0] *= speed / 10
    accel[:, 1] += np.cos(t / 3) + 0.3 * np.sin(t / 9)
    accel += 0.1 * np.random.default_rng(seed).normal(size=accel.shape)
    imu = Imu(t, run.imu.dt, run.imu.gyro @ R.T, accel @ R.T)
    return replace(run, imu=imu, odometer=Odometer(t, np.cumsum(speed) * dt, speed, 0.0))


def found(R: Array, of: Vehicle) -> tuple[Oriented, float]:
    """The oriented run, and how far [deg] its samples still are from the vehicle's axes."""
    run = driven(R)
    assert run.imu is not None
    out = oriented(run, of, increments(run.imu))
    assert out.run.imu is not None
    true = driven(np.eye(3)).imu
    assert true is not None
    U, _, Vt = np.linalg.svd(out.run.imu.accel.T @ true.accel)
    rest = np.linalg.norm(so3.log((U @ Vt)[None]))
    return out, float(np.rad2deg(rest))


@pytest.mark.parametrize("axes", right_handed())
def test_any_axis_order_is_read_exactly(axes: str) -> None:
    out, rest = found(axes_matrix(axes).T, vehicle(STATED, "mems"))
    assert rest < 1e-5
    assert out.vehicle.start.heading_deg == 77.0
    assert [f"point to {axes};" in remark.why for remark in out.remarks] == [True] * (axes != "RFU")


@pytest.mark.parametrize("seed", range(8))
def test_any_rotation_is_found(seed: int) -> None:
    rotation = np.random.default_rng(seed).normal(size=3)
    R = so3.exp(2.5 * rotation / np.linalg.norm(rotation))
    out, rest = found(R, vehicle(STATED, "mems"))
    assert rest < 4.0
    assert out.vehicle.start.heading_of == "vehicle"


@pytest.mark.parametrize("yaw", [45.0, -20.0])
def test_a_yaw_leaves_the_stated_heading_to_its_owner(yaw: float) -> None:
    R = so3.exp(np.array([0, 0, np.deg2rad(yaw)]))  # the front of the IMU lies to the right
    out, rest = found(R, vehicle(STATED, "mems"))
    assert rest < 4.0
    assert out.vehicle.start.heading_deg == pytest.approx(77.0 - yaw, abs=3.0)
    assert 'heading_of = "vehicle"' in out.remarks[0].remedy
    assert out.remarks[0].level == 2
    mine = STATED.model_copy(update={"heading_of": "vehicle"})
    said = StartSpec.model_validate(mine.model_dump(exclude_none=True))
    out, _ = found(R, vehicle(said, "mems"))
    assert out.vehicle.start.heading_deg == 77.0
    assert not any("heading_of" in remark.remedy for remark in out.remarks)


def test_a_small_turn_is_left_to_the_graph() -> None:
    out, rest = found(so3.exp(np.array([0.02, -0.01, 0.03])), vehicle(STATED, "mems"))
    assert rest == pytest.approx(np.rad2deg(np.sqrt(0.0014)), abs=0.01)
    assert not out.remarks


@pytest.mark.parametrize(("turn", "axes"), [("swap", "FRU"), ("x", "LFU"), ("z", "RFD")])
def test_mirrored_axes_are_refused_with_the_exchange_that_cures(turn: str, axes: str) -> None:
    M = {"swap": np.eye(3)[[1, 0, 2]], "x": np.diag([-1.0, 1, 1]), "z": np.diag([1.0, 1, -1])}
    cure = f'axes = "{axes[1]}{axes[0]}{axes[2]}"'
    with pytest.raises(InputError, match=rf"mirrored, x, y, z pointing to {axes}: .*{cure}"):
        found(M[turn], vehicle(STATED, "mems"))


def test_fixes_tell_mirrored_axes_from_a_gyro_that_turns_the_wrong_way() -> None:
    run, fixes = driven(np.eye(3)), moving(20.0).gnss
    assert run.imu is not None
    imu = run.imu
    back = replace(imu, gyro=imu.gyro * [1, 1, -1])
    x = np.diag([-1.0, 1, 1])
    mirrored = replace(imu, gyro=imu.gyro @ x, accel=imu.accel @ x)
    for wrong, said in ((back, "gyro_z counts the other way"), (mirrored, "axes are mirrored")):
        with pytest.raises(InputError, match=said) as error:
            changed = replace(run, imu=wrong, gnss=fixes)
            oriented(changed, vehicle(STATED, "mems"), increments(wrong))
        assert "; or gyro_z" not in str(error.value)
        with pytest.raises(InputError, match="; or gyro_z counts the wrong way"):
            oriented(replace(run, imu=wrong), vehicle(STATED, "mems"), increments(wrong))


def test_without_speed_only_gravity_tells() -> None:
    run = replace(driven(axes_matrix("FRD").T), odometer=None)
    assert run.imu is not None
    inc = increments(run.imu)
    assert pace(run, inc.edge) is None and not np.isfinite(lie(inc, None).front_sd)
    with pytest.raises(InputError, match=r"gravity lies on -z, not up .*FRD.* would fit"):
        oriented(run, vehicle(STATED, "mems"), inc)
