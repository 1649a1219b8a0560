"""Mistakes a user may have made, as changes of run and vehicle file that would undo them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from graphnav.batch.fix_hypotheses import of_antenna, of_fixes, of_start
from graphnav.batch.hypothesis import Hypothesis, Undone, said
from graphnav.common.run import Array, Imu, Run
from graphnav.reading.axes import axes_name
from graphnav.reading.plausibility import seconds
from graphnav.reading.units import DEG
from graphnav.reading.vehicle import Vehicle

SNAP_DEG = 8.0  # an IMU turned so close to a right angle has other axes
RIGHT_ANGLES = (
    (90.0, False),
    (180.0, False),
    (-90.0, False),
    (0.0, True),
    (180.0, True),
    (90.0, True),
)
BENDS = 20  # seconds of pull that show how an IMU lies
PULL = 0.3  # m/s^2
MISCOUNTED = (0.02, 0.5)  # off 1, of a gyro's scale
TURNED_DEG = 5.0


def hypotheses(run: Run, vehicle: Vehicle) -> list[Hypothesis]:
    """Everything worth trying, the likeliest first; `run` with the fixes in use only."""
    found = [*_lying(run, vehicle), *_gyros(run)]
    if run.imu is not None and run.odometer is not None:
        found += _gyro_scale(run)
    if run.gnss is not None:
        elsewhere, others = of_fixes(run, vehicle)
        found = [*elsewhere, *of_start(vehicle), *found, *others, *of_antenna(vehicle)]
    return found + _odometer(run, vehicle)


def _lying(run: Run, vehicle: Vehicle) -> list[Hypothesis]:
    """How the IMU lies: the turn about up, and the mirroring, that lay its horizontal force on what
    odometer and gyro say of it; where too little is felt, all right angles."""
    if run.imu is None or not run.felt:
        return []
    now = seconds(run)
    felt = now.force[:, 0] + 1j * now.force[:, 1]
    due = -now.speed * now.rate[:, 2] + 1j * now.gain
    on = np.isfinite(due) & (np.abs(due) > PULL)
    if on.sum() < BENDS:
        return [_turned(vehicle, deg, mirrored) for deg, mirrored in RIGHT_ANGLES]
    felt, due = felt[on] - felt[on].mean(), due[on] - due[on].mean()
    fits = [(abs(np.vdot(f, due)), np.angle(np.vdot(f, due)), f is not felt)
            for f in (felt, np.conj(felt))]  # fmt: skip
    found = []
    for _, angle, mirrored in sorted(fits, reverse=True):
        deg = float(np.rad2deg(angle))
        right = round(deg / 90) * 90
        deg = right if abs(deg - right) < SNAP_DEG else deg
        if mirrored or abs(deg) > TURNED_DEG:
            found.append(_turned(vehicle, deg, mirrored))
    return found


def _turned(vehicle: Vehicle, deg: float, mirrored: bool) -> Hypothesis:
    """The IMU's axes turned about up, `mirrored` with y against before, from what they are taken
    for."""
    turn = _about_up(deg) @ np.diag([1.0, -1.0 if mirrored else 1.0, 1.0])

    def undo(run: Run, vehicle: Vehicle) -> Undone:
        assert run.imu is not None
        gyro, accel = run.imu.gyro @ turn.T, run.imu.accel @ turn.T
        return replace(run, imu=replace(run.imu, gyro=gyro, accel=accel)), vehicle

    if mirrored:
        swapped = abs(turn[0, 0]) < 0.5
        axis = (
            "x and y are exchanged" if swapped else f"{'x' if turn[0, 0] < 0 else 'y'} is mirrored"
        )
        why = f"the IMU's axes are left-handed: {axis}"
        cure = "change the columns (or their sign) of gyro and accelerometer in the run file"
    elif deg % 90 == 0:
        name = axes_name(np.round(turn @ vehicle.imu.axes_matrix))
        why = f"the IMU lies turned by {abs(deg):.0f} deg about its up axis"
        cure = f'[imu] axes = "{name}" would fit: try it'
    else:
        why = f"the IMU lies turned by {deg:.0f} deg about its up axis in the vehicle"
        cure = f"state [odometer] mount_deg = [0, 0, {-deg:.0f}] and the heading of the IMU's axis"
    return Hypothesis(undo, said(why), said(cure))


def _about_up(deg: float) -> Array:
    c, s = np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _gyros(run: Run) -> list[Hypothesis]:
    """Signs, order and units of the gyros."""
    if run.imu is None:
        return []

    def with_gyro(change: Callable[[Imu], Array]) -> Callable[[Run, Vehicle], Undone]:
        def undo(run: Run, vehicle: Vehicle) -> Undone:
            assert run.imu is not None
            return replace(run, imu=replace(run.imu, gyro=change(run.imu))), vehicle

        return undo

    def scaled(by: float) -> Callable[[Run, Vehicle], Undone]:
        return with_gyro(lambda imu: imu.gyro * by)

    unit = "set the unit of [columns] gyro to the one the file has"
    sign = "change the sign of gyro_z in the run file, or [imu] axes"
    order = "exchange the columns gyro_x and gyro_y"
    return [
        Hypothesis(with_gyro(lambda imu: imu.gyro * [1, 1, -1]),
                   said("gyro_z counts the other way round than the accelerometers' axes"),
                   said(sign)),
        Hypothesis(with_gyro(lambda imu: imu.gyro[:, [1, 0, 2]]),
                   said("gyro_x and gyro_y are exchanged"), said(order)),
        Hypothesis(scaled(1 / DEG), said("the gyros are in rad/s, not in deg/s"), said(unit)),
        Hypothesis(scaled(DEG), said("the gyros are in deg/s, not in rad/s"), said(unit)),
    ]  # fmt: skip


def _gyro_scale(run: Run) -> list[Hypothesis]:
    """Gyros that read a few per cent too much or too little, as the pull in bends says."""
    now = seconds(run)
    pull = -now.speed * now.rate[:, 2]
    on = np.isfinite(pull) & (np.abs(pull) > PULL)
    if on.sum() < BENDS:
        return []
    by = float(np.polyfit(pull[on], now.force[on, 0], 1)[0])
    if not MISCOUNTED[0] < abs(by - 1) < MISCOUNTED[1]:
        return []

    def undo(run: Run, vehicle: Vehicle) -> Undone:
        assert run.imu is not None
        return replace(run, imu=replace(run.imu, gyro=run.imu.gyro * by)), vehicle

    why = f"the gyros read {100 * (1 / by - 1):+.0f} % of what turns: their scale is wrong"
    return [Hypothesis(undo, said(why), said("check the gyros' scale factor and unit"))]


def _odometer(run: Run, vehicle: Vehicle) -> list[Hypothesis]:
    """Direction, unit and place of the odometer."""
    if run.odometer is None:
        return []

    def scaled(by: float) -> Callable[[Run, Vehicle], Undone]:
        def undo(run: Run, vehicle: Vehicle) -> Undone:
            o = run.odometer
            assert o is not None
            way, speed = by * o.distance, by * o.speed
            return replace(run, odometer=replace(o, distance=way, speed=speed)), vehicle

        return undo

    def centimetres(run: Run, vehicle: Vehicle) -> Undone:
        lever = tuple(0.01 * x for x in vehicle.odometer.lever_arm or ())
        spec = vehicle.odometer.model_copy(update={"lever_arm": lever})
        return run, vehicle.model_copy(update={"odometer": spec})

    unit = said("set the unit of [columns] odo_speed, or metres_per_pulse, as it is")
    found = [
        Hypothesis(scaled(-1.0), said("the odometer counts forward as backward: its direction"),
                   said("change the sign of the odometer (metres_per_pulse or the column)")),
        Hypothesis(scaled(1 / 3.6), said("the odometer is in km/h, not in m/s"), unit),
    ]  # fmt: skip
    lever = vehicle.odometer.lever_arm
    if lever is not None and any(abs(x) > 10 for x in lever):
        why = said("the odometer's lever arm is 100 times too long")
        cure = said("[odometer] lever_arm is in metres, not in centimetres")
        found.append(Hypothesis(centimetres, why, cure))
    return found
