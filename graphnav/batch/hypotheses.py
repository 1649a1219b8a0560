"""Mistakes a user may have made, as changes of run and vehicle file that would undo them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from graphnav.common.angles import angles_of_rotation
from graphnav.common.run import Array, Gnss, Imu, Run
from graphnav.reading.axes import axes_name
from graphnav.reading.plausibility import seconds
from graphnav.reading.units import DEG
from graphnav.reading.vehicle import Vehicle
from graphnav.result.solved import Solved

Undone = tuple[Run, Vehicle]
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
TURNED_DEG = 5.0
FORGIVING_DEG = 30.0  # of a mounting that may be anything


@dataclass(frozen=True)
class Hypothesis:
    """A mistake: what undoes it, and words for it once the run agrees."""

    undo: Callable[[Run, Vehicle], Undone]
    why: Callable[[Solved], str]  # of the run solved without the mistake
    remedy: Callable[[Solved], str]


def hypotheses(run: Run, vehicle: Vehicle) -> list[Hypothesis]:
    """Everything worth trying, the likeliest first; `run` with the fixes in use only."""
    found = [*_lying(run, vehicle), *_gyros(run)]
    if run.gnss is not None:
        found = [*_start(vehicle), *found, *_fixes(run), *_antenna(vehicle)]
    return found + _odometer(run, vehicle)


def said(text: str) -> Callable[[Solved], str]:
    """Words that need nothing of the solution."""
    return lambda _: text


def _start(vehicle: Vehicle) -> list[Hypothesis]:
    """The stated heading is wrong."""
    stated = vehicle.start.heading_deg
    if stated is None:
        return []

    def headless(run: Run, vehicle: Vehicle) -> Undone:
        start = vehicle.start.model_copy(update={"heading_deg": None})
        return run, vehicle.model_copy(update={"start": start})

    def off(solved: Solved) -> str:
        wrong = (stated - _heading(solved) + 180) % 360 - 180
        return f"the heading stated in [start] is wrong by {wrong:.0f} deg"

    def cure(solved: Solved) -> str:
        return f"leave out [start] heading_deg, or state {_heading(solved):.1f}"

    return [Hypothesis(headless, off, cure)]


def _heading(solved: Solved) -> float:
    """Heading at the start, deg."""
    return float(np.rad2deg(angles_of_rotation(solved.path.R_nb[0])[2]))


def _lying(run: Run, vehicle: Vehicle) -> list[Hypothesis]:
    """How the IMU lies: the turn about up, and the mirroring, that lay its horizontal force on what
    odometer and gyro say of it; where too little is felt, all right angles."""
    if run.imu is None:
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


def _fixes(run: Run) -> list[Hypothesis]:
    """Signs and order of the fixes' coordinates."""

    def with_fixes(change: Callable[[Gnss], Gnss]) -> Callable[[Run, Vehicle], Undone]:
        def undo(run: Run, vehicle: Vehicle) -> Undone:
            assert run.gnss is not None
            nowhere = {"lat": None, "lon": None}
            start = vehicle.start.model_copy(update=nowhere)
            moved = vehicle.model_copy(update={"start": start})
            return replace(run, gnss=change(run.gnss)), moved

        return undo

    found = [
        Hypothesis(with_fixes(lambda g: replace(g, lon_deg=-g.lon_deg)),
                   said("the longitude of the fixes has lost its sign (west is negative)"),
                   said("longitude without its sign? give gnss_lon its sign")),
        Hypothesis(with_fixes(lambda g: replace(g, lat_deg=-g.lat_deg)),
                   said("the latitude of the fixes has lost its sign (south is negative)"),
                   said("latitude without its sign? give gnss_lat its sign")),
    ]  # fmt: skip
    assert run.gnss is not None
    if np.all(np.abs(run.gnss.lon_deg) < 90):
        swapped = with_fixes(lambda g: replace(g, lat_deg=g.lon_deg, lon_deg=g.lat_deg))
        why = said("latitude and longitude of the fixes are exchanged")
        found.append(
            Hypothesis(swapped, why, said("exchange gnss_lat and gnss_lon under [columns]"))
        )
    return found


def _antenna(vehicle: Vehicle) -> list[Hypothesis]:
    """Sign and unit of the antenna's lever arm."""
    stated = vehicle.gnss.lever_arm
    if stated is None or not any(stated):
        return []

    def with_lever(by: float) -> Callable[[Run, Vehicle], Undone]:
        def undo(run: Run, vehicle: Vehicle) -> Undone:
            lever = tuple(by * x for x in vehicle.gnss.lever_arm or ())
            spec = vehicle.gnss.model_copy(update={"lever_arm": lever})
            return run, vehicle.model_copy(update={"gnss": spec})

        return undo

    return [
        Hypothesis(with_lever(-1.0), said("the antenna's lever arm has the wrong sign"),
                   said("[gnss] lever_arm goes from the IMU to the antenna: right, forward, up")),
        Hypothesis(with_lever(0.01), said("the antenna's lever arm is 100 times too long"),
                   said("[gnss] lever_arm is in metres, not in centimetres")),
    ]  # fmt: skip


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
