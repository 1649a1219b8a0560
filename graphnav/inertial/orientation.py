"""Samples turned into the vehicle's axes where the IMU lies otherwise than is stated.

A stated axis order and mounting are a prior that gravity and driving may overrule, with a word.
Small differences stay as they are: the mounting is a calibration of the graph.
"""

from dataclasses import dataclass, replace

import numpy as np

from factors import so3
from factors.preintegration import Increments
from graphnav.common.errors import InputError
from graphnav.common.remark import Remark
from graphnav.common.run import Array, Run
from graphnav.inertial.heading_sources import Turning, reckoned_on_fixes
from graphnav.inertial.mounting import Lie, lie, upright
from graphnav.inertial.pace import pace
from graphnav.reading.axes import axes_matrix, axes_name, right_handed
from graphnav.reading.vehicle import StartSpec, Vehicle

UPRIGHT = np.cos(np.deg2rad(37.0))  # of the up axis; further no vehicle tilts on the whole
TILTED = np.deg2rad(3.0)  # of a whole run's ground, one sigma
SIGMAS_FRONT, SIGMAS_STATED = 4.0, 3.0
OVERRULED = np.deg2rad(50.0)  # a turn that makes another axis order likelier than a mounting
CLEARLY = 0.1  # of the slots' agreement by which the fixes tell the sense of turning
FAR_OFF = np.deg2rad(10.0)  # of a stated heading, beyond which a result is of no use


@dataclass(frozen=True)
class Oriented:
    """A run in axes that are the vehicle's but for the stated mounting."""

    run: Run
    vehicle: Vehicle
    inc: Increments
    remarks: tuple[Remark, ...] = ()


def oriented(run: Run, vehicle: Vehicle, inc: Increments) -> Oriented:
    """The run as it is to be smoothed.

    Raises InputError where the axes are mirrored, or gravity is off the up axis and driving does
    not tell where the front is.
    """
    if not run.felt:  # a stand-in lies as is stated
        return Oriented(run, vehicle, inc)
    found = lie(inc, pace(run, inc.edge), skids=vehicle.kind == "tracked")
    if found.mirrored:
        raise InputError(_mirrored(run, vehicle, inc, found))
    # from the axes as read to those in which the stated mounting holds
    R_new = so3.exp(vehicle.odometer.mount_b) @ found.R_mb
    mount_sd = np.deg2rad(vehicle.odometer.mount_sd_deg)
    front = _front(R_new)
    slack = max(SIGMAS_STATED * mount_sd, SIGMAS_FRONT * found.front_sd)
    tilt = float(np.arccos(np.clip(R_new[2, 2], -1, 1)))
    if not np.isfinite(found.front_sd):
        if R_new[2, 2] < UPRIGHT:
            raise InputError(_lying(run, vehicle, inc))
        return Oriented(run, vehicle, inc)
    if abs(front) < slack and tilt < SIGMAS_STATED * np.hypot(mount_sd, TILTED):
        said = _heading_doubted(run, vehicle, front, found.front_sd, mount_sd)
        return Oriented(run, vehicle, inc, said)
    exact = axes_matrix(_nearest(R_new))
    if _angle(R_new @ exact.T) < np.hypot(2 * found.front_sd, TILTED):
        return _turned(run, vehicle, inc, exact, 0.0)
    return _turned(run, vehicle, inc, R_new, found.front_sd)


def _turned(run: Run, vehicle: Vehicle, inc: Increments, R_new: Array, sd: float) -> Oriented:
    """Everything in new axes, with a word; `sd` rad of where the front is, 0 when exact."""
    overruled = _angle(R_new) > OVERRULED
    front = 0.0 if overruled else _front(R_new)
    said = _axes_overruled(vehicle, R_new) if overruled else _mounted(R_new, front)
    remarks = (*_heading_doubted(run, vehicle, front, sd, 0.0), said)
    mount_sd = float(np.hypot(vehicle.odometer.mount_sd_deg, np.rad2deg(sd)))
    # axes that are not there had no forward one: headings were the vehicle's
    whose = {"heading_of": "vehicle"} if overruled and sd > 0 else {}
    turned = vehicle.model_copy(
        update={
            "odometer": vehicle.odometer.model_copy(update={"mount_sd_deg": mount_sd}),
            "start": _restated(vehicle, front, sd).model_copy(update=whose),
            "heading": vehicle.heading.model_copy(update=whose),
        }
    )
    assert run.imu is not None
    imu = replace(run.imu, gyro=run.imu.gyro @ R_new.T, accel=run.imu.accel @ R_new.T)
    heading = run.heading
    if heading is not None and vehicle.heading.heading_of == "imu":
        heading = replace(heading, heading=heading.heading - front)
    names = ("rotation", "velocity", "position")
    new = replace(inc, **{name: getattr(inc, name) @ R_new.T for name in names})
    return Oriented(replace(run, imu=imu, heading=heading), turned, new, remarks)


def _axes_overruled(vehicle: Vehicle, R_new: Array) -> Remark:
    """Another axis order than the stated one."""
    recorded = R_new @ vehicle.imu.axes_matrix
    order = _nearest(recorded)
    left = _angle(recorded @ axes_matrix(order).T)
    besides = f" but for {np.rad2deg(left):.0f} deg" if left > 1e-6 else ""
    return Remark(
        f'[imu] axes = "{vehicle.imu.axes}" does not hold: by gravity and driving x, y, z point to '
        f"{order}{besides}; read so, headings as the vehicle's",
        f'state [imu] axes = "{order}"',
    )


def _mounted(R_new: Array, front: float) -> Remark:
    """Another mounting than the stated one."""
    return Remark(
        f"the IMU lies {np.rad2deg(_angle(R_new)):.1f} deg from its stated mounting, its front "
        f"{_side(front)} of the vehicle's: attitude is told of the vehicle's axes"
    )


def _nearest(R: Array) -> str:
    """The axis order next to a rotation (3, 3)."""
    return max(right_handed(), key=lambda axes: float(np.trace(R.T @ axes_matrix(axes))))


def _restated(vehicle: Vehicle, front: float, sd: float) -> StartSpec:
    """[start] with the heading of the new forward axis in place of the old one's."""
    start = vehicle.start
    if start.heading_deg is None or start.heading_of == "vehicle" or front == 0:
        return start
    off = np.rad2deg([front, sd])
    sigma = float(np.hypot(start.heading_sd_deg, off[1]))
    heading = float(start.heading_deg - off[0])
    return start.model_copy(update={"heading_deg": heading, "heading_sd_deg": sigma})


def _heading_doubted(
    run: Run, vehicle: Vehicle, front: float, sd: float, mount_sd: float
) -> tuple[Remark, ...]:
    """A stated heading may have been meant as the vehicle's, which no fix decides."""
    start = vehicle.start
    likely = abs(front) > max(2 * mount_sd, SIGMAS_FRONT * sd)
    if not likely or start.heading_deg is None or start.given("heading_of") or run.gnss is not None:
        return ()
    return (
        Remark(
            f"the IMU's front points {_side(front)} of the vehicle's (+- {np.rad2deg(sd):.1f} deg) "
            "and [start] heading_deg is read as the IMU's",
            'if the vehicle\'s heading was meant: [start] heading_of = "vehicle" (else "imu")',
            2 if abs(front) > FAR_OFF else 1,
        ),
    )


def _side(front: float) -> str:
    return f"{abs(np.rad2deg(front)):.1f} deg {'right' if front > 0 else 'left'}"


def _front(R_new: Array) -> float:
    """How far the old forward axis points to the right of the new one, rad."""
    return float(np.arctan2(R_new[0, 1], R_new[1, 1]))


def _angle(R: Array) -> float:
    """Angle of a rotation (3, 3), rad."""
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))


def _lying(run: Run, vehicle: Vehicle, inc: Increments) -> str:
    """Gravity elsewhere than up, and nothing that tells the front."""
    mean = inc.velocity.sum(0)
    k = int(np.abs(mean).argmax())
    up = np.zeros(3)
    up[k] = np.sign(mean[k])
    fit = [
        axes
        for axes in right_handed()
        if (axes_matrix(axes) @ vehicle.imu.axes_matrix.T)[2] @ up > 0.5
    ]
    return (
        f"{run.path}: gravity lies on {'+' if up[k] > 0 else '-'}{'xyz'[k]}, not up (+z after "
        f'[imu] axes = "{vehicle.imu.axes}"); axes = "{fit[0]}" would fit, or '
        f"{', '.join(fit[1:])}: driving does not tell where the front is"
    )


def _mirrored(run: Run, vehicle: Vehicle, inc: Increments, found: Lie) -> str:
    """In bends the force pulls to the wrong side: left-handed axes, or a gyro that turns the wrong
    way; fixes tell which.
    """
    # R_mb leads to the vehicle's axes with right and left exchanged
    true = np.diag([-1.0, 1.0, 1.0]) @ found.R_mb @ vehicle.imu.axes_matrix
    letters = axes_name(np.round(true)) if np.abs(true - np.round(true)).max() < 0.3 else ""
    cure = f' and set [imu] axes = "{letters[1]}{letters[0]}{letters[2]}"' if letters else ""
    pointing = f", x, y, z pointing to {letters}" if letters else ""
    backward = _turns_backward(run, vehicle, inc)
    exchange = (
        'exchange x and y under [columns] (gyro_x = "gyro_y", gyro_y = "gyro_x", accel_x = '
        f'"accel_y", accel_y = "accel_x"){cure}'
    )
    if backward:
        return (
            f"{run.path}: gyro_z counts the other way round than the fixes turn and the "
            "accelerometers' axes say: change its sign in the run file"
        )
    other = "" if backward is not None else "; or gyro_z counts the wrong way: change its sign"
    return (
        f"{run.path}: the IMU's axes are mirrored{pointing}: in bends the force pulls to the wrong "
        f"side; {exchange}{other}"
    )


def _turns_backward(run: Run, vehicle: Vehicle, inc: Increments) -> bool | None:
    """Whether the fixes turn against the gyro; None where they do not tell."""
    bias_sd = float(np.deg2rad(vehicle.imu.gyro_bias_deg_h) / 3600)
    up = upright(inc)[2]
    both = [reckoned_on_fixes(run, Turning(inc, way * up, np.zeros(3), bias_sd)) for way in (1, -1)]
    if both[0] is None or both[1] is None:
        return None
    gained = both[1].agreement - both[0].agreement
    return None if abs(gained) < CLEARLY else gained > 0
