"""Units and axes against physics: gravity, the Earth's turn, and how vehicles drive.

Averages over one second decide, never single samples: a genuine jolt of 300 m/s^2 is no fault.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graphnav.common.earth import G_STANDARD, RATE, Origin
from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.reading.axes import COMMON, axes_matrix, axes_name, right_handed
from graphnav.reading.units import DEG
from graphnav.reading.vehicle import Vehicle

Array = NDArray[np.float64]

FASTEST_TURN = 6.0  # rad/s kept up for a second: no land vehicle turns a revolution that fast
STANDSTILL_FORCE = 0.02  # m/s^2, change of the mean force from one second to the next, at rest
UP_SHARE = 0.8  # of gravity that must lie on the up axis (37 deg of slope)
FEW_STANDSTILL, COMMON_SHARE = 5, 0.9  # seconds at rest; share of them that show one rate
FAR_M = 300e3  # from the start, of the middle of the fixes
TRAVELLED_M = 100.0  # between fixes; less may be their scatter
DEG_CURE = 'set [columns] gyro = { unit = "deg/s" } in the vehicle file'


@dataclass(frozen=True)
class Seconds:
    """One-second means of a run (S,): force, rate, and the odometer's speed at both ends."""

    force: Array  # (S, 3) m/s^2
    rate: Array  # (S, 3) rad/s
    speed: Array  # (S,) m/s, NaN without odometer
    gain: Array  # (S,) m/s^2, change of speed over the second


def seconds(run: Run) -> Seconds:
    """Means over whole seconds that hold samples. Needs an IMU."""
    assert run.imu is not None
    slot = np.floor(run.imu.time).astype(np.intp)
    starts = np.flatnonzero(np.diff(slot, prepend=slot[0] - 1))
    count = np.diff(np.append(starts, len(slot)))[:, None]
    force = np.add.reduceat(run.imu.accel, starts, axis=0) / count
    rate = np.add.reduceat(run.imu.gyro, starts, axis=0) / count
    mid = slot[starts] + 0.5
    speed, gain = np.full((2, len(mid)), np.nan)
    if run.odometer is not None:
        way = np.interp(mid[:, None] + [-1, 0, 1], run.odometer.time, run.odometer.distance)
        speed, gain = (way[:, 2] - way[:, 0]) / 2, way[:, 2] - 2 * way[:, 1] + way[:, 0]
    return Seconds(force, rate, speed, gain)


def check_gravity(run: Run) -> None:
    """InputError when the accelerometers do not read gravity in m/s^2."""
    now = seconds(run)
    size = float(np.median(np.linalg.norm(now.force, axis=1)))
    for unit, g in (("g", 1.0), ("mg", 1000.0)):
        if abs(size / g - 1) < 0.15:
            raise InputError(
                f"{run.path}: the accelerometers read {size:.3g} on the whole, which is gravity in "
                f'{unit}; set [columns] accel = {{ unit = "{unit}" }} in the vehicle file'
            )
    if abs(size / G_STANDARD - 1) > 0.2:
        raise InputError(
            f"{run.path}: the accelerometers read {size:.3g} m/s^2 on the whole where gravity "
            "makes 9.8; set their unit under [columns] in the vehicle file (leave gravity in)"
        )


def check_up(run: Run, vehicle: Vehicle) -> list[str]:
    """A finding when gravity is not on the up axis; InputError on a rover, whose driving does not
    tell how the IMU lies.
    """
    now = seconds(run)
    mean = np.median(now.force, axis=0)
    if mean[2] >= UP_SHARE * G_STANDARD:
        return []
    said = (
        f"gravity lies on {_along(mean)}, not up (+z after [imu] axes = "
        f'"{vehicle.imu.axes}"); axes = "{_likely_axes(now, mean, vehicle)}" would fit'
    )
    if vehicle.kind == "rover":
        raise InputError(f"{run.path}: {said}")
    return [said]


def check_rates(run: Run, vehicle: Vehicle) -> None:
    """InputError when the gyros turn as no vehicle does, or at rest faster than Earth and bias."""
    now = seconds(run)
    turn = np.linalg.norm(now.rate, axis=1)
    if (turn > FASTEST_TURN).any():
        raise InputError(
            f"{run.path}: the gyros turn at {turn.max():.3g} rad/s for a whole second near "
            f"{run.clock_start + float(turn.argmax()):.1f}; if they are in deg/s {DEG_CURE}"
        )
    bias = np.deg2rad(vehicle.imu.gyro_bias_deg_h) / 3600
    noise = np.deg2rad(vehicle.imu.gyro_noise_deg_sqrt_h) / 60
    idle, limit = _idle(now), 10 * (RATE + 3 * bias + 3 * noise)
    if idle > limit and not 0.5 < abs(_centripetal(now) or 0.0) < 2:
        raise InputError(
            f"{run.path}: at rest the gyros read {idle:.3g} rad/s, over {limit:.3g}, ten times "
            f"Earth rate, bias and noise together; if they are in deg/s {DEG_CURE}"
        )


def _idle(now: Seconds) -> float:
    """The rate common to all standstills, rad/s; 0 where there is none.

    A steady turn on the spot looks like a standstill, but it ends, and is not there on the move.
    """
    at_standstill = _at_standstill(now)
    if at_standstill.sum() < FEW_STANDSTILL:
        return 0.0
    usual = np.median(now.rate[at_standstill], axis=0)
    idle = float(np.linalg.norm(usual))
    apart = np.linalg.norm(now.rate[at_standstill] - usual, axis=1)
    if np.mean(apart < 0.5 * idle) < COMMON_SHARE:
        return 0.0
    moving = np.abs(now.speed) > 0.5
    on_the_move = np.median(np.linalg.norm(now.rate[moving], axis=1)) if moving.any() else idle
    return idle if on_the_move > 0.5 * idle else 0.0


def driving_findings(run: Run, vehicle: Vehicle) -> list[str]:
    """Findings where driving contradicts axes or units; needs an odometer and some bends.

    Raises `InputError` when it can only be gyros in deg/s.
    """
    now = seconds(run)
    if not np.isfinite(now.speed).any():
        return []
    return _forward_finding(now, vehicle) + _centripetal_finding(run, now)


def _forward_finding(now: Seconds, vehicle: Vehicle) -> list[str]:
    """Speed gained must be felt on the forward axis."""
    moving = np.abs(now.gain) > 0.2
    if moving.sum() < 20:
        return []
    felt = [_correlation(now.force[moving, k], now.gain[moving]) for k in (0, 1)]
    fits = {"R": felt[0], "L": -felt[0], "F": felt[1], "B": -felt[1]}
    best = max(fits, key=lambda letter: fits[letter])
    if best == "F" or fits[best] < 0.7 or fits["F"] > 0.4:
        return []
    turned = {"R": "FLU", "L": "BRU", "B": "LBU"}[best]
    axes = axes_name(axes_matrix(turned) @ vehicle.imu.axes_matrix)
    return [
        f"speeding up is felt on the {best} axis, not forward (correlation {fits[best]:.2f}): "
        f'is [imu] axes = "{axes}" meant?'
    ]


def _centripetal_finding(run: Run, now: Seconds) -> list[str]:
    """Lateral force must be minus speed times yaw rate; InputError when it is 1/57 of it."""
    slope = _centripetal(now)
    if slope is None or 0.5 < slope < 2:
        return []
    if 0 < slope < 2 * DEG:
        raise InputError(
            f"{run.path}: in bends the lateral force is {slope:.3f} times speed times yaw rate; "
            f"the gyros seem to be in deg/s: {DEG_CURE}"
        )
    return [
        f"in bends the lateral force is {slope:.2f} times speed times yaw rate, and should be 1: "
        "check the units of the odometer (km/h is 0.28) and gyros (deg/s is 0.017) and [imu] axes"
    ]


def _centripetal(now: Seconds) -> float | None:
    """Lateral force per minus speed times yaw rate; None without bends that show it."""
    pull = -now.speed * now.rate[:, 2]
    bend = (np.abs(pull) > 0.3) & (now.speed > 2)
    if bend.sum() < 20 or abs(_correlation(pull[bend], now.force[bend, 0])) < 0.7:
        return None
    return float(np.polyfit(pull[bend], now.force[bend, 0], 1)[0])


def check_fixes(run: Run, vehicle: Vehicle) -> list[str]:
    """InputError when the fixes are in radians; a finding when they lie far from [start]."""
    if run.gnss is None:
        return []
    lat, lon = np.median([run.gnss.lat_deg, run.gnss.lon_deg], axis=1)
    if abs(lat) < np.pi / 2 and abs(lon) < np.pi:  # in degrees that is open sea off Guinea
        raise InputError(
            f"{run.path}: the fixes ({lat:.4f}, {lon:.4f}) seem to be in radians: set "
            '[columns] gnss_lat = { unit = "rad" }, gnss_lon = { unit = "rad" } in the vehicle file'
        )
    at = vehicle.start
    if at.lat is None or at.lon is None:
        return []
    away = away_m(at.lat, at.lon, lat, lon)
    if away < FAR_M:
        return []
    return [f"the fixes lie {away / 1000:.0f} km from [start]: is that another run's?"]


def away_m(lat_0: float, lon_0: float, lat: float, lon: float) -> float:
    """Distance [m] of one place, in degrees, from another."""
    return float(np.linalg.norm(_from(lat_0, lon_0, lat, lon)))


def check_odometer(run: Run, use_gnss: bool) -> None:
    """InputError when the odometer never counts while the fixes go somewhere."""
    if run.odometer is None or run.gnss is None or not use_gnss:
        return
    lat, lon = run.gnss.lat_deg, run.gnss.lon_deg
    fixes = _from(lat[0], lon[0], lat, lon)[:, :2]
    # a wild fix is no journey
    way = float(np.linalg.norm(np.ptp(np.percentile(fixes, (10, 90), axis=0), axis=0)))
    if way > TRAVELLED_M and not np.ptp(run.odometer.distance) > 0:
        raise InputError(
            f"{run.path}: the odometer never moves while the fixes travel {way:.0f} m: the column "
            "is dead or another one is meant; name it under [columns] or take it out of the file"
        )


def _from(lat_0: float, lon_0: float, lat: ArrayLike, lon: ArrayLike) -> Array:
    """East, north, up [m] of places from another, all in degrees, (..., 3)."""
    origin = Origin(np.deg2rad(lat_0), np.deg2rad(lon_0), 0.0)
    return origin.local(np.deg2rad(lat), np.deg2rad(lon), np.zeros_like(lat))


def _at_standstill(now: Seconds) -> NDArray[np.bool_]:
    """Seconds in which neither force nor odometer moves, with quiet neighbours."""
    change = np.linalg.norm(np.diff(now.force, axis=0, append=now.force[-1:]), axis=1)
    moving = (np.abs(now.speed) > 0.02) | (np.abs(now.gain) > 0.02)  # False without odometer
    return np.asarray((change < STANDSTILL_FORCE) & ~moving)


def _correlation(x: Array, y: Array) -> float:
    sd = float(np.std(x) * np.std(y))
    return float(np.mean((x - x.mean()) * (y - y.mean()))) / sd if sd > 0 else 0.0


def _along(mean: Array) -> str:
    k = int(np.abs(mean).argmax())
    return f"{'+' if mean[k] > 0 else '-'}{'xyz'[k]}"


def _likely_axes(now: Seconds, mean: Array, vehicle: Vehicle) -> str:
    """The axis order that puts gravity up and, where speed changes tell, the front ahead."""
    fixed = vehicle.imu.axes_matrix
    up = np.zeros(3)
    k = int(np.abs(mean).argmax())
    up[k] = np.sign(mean[k])
    gained = np.nan_to_num(now.gain)
    ahead = np.array([_correlation(f, gained) for f in now.force.T]) * (np.std(gained) > 0.05)

    def fit(axes: str) -> tuple[float, float, int]:
        turn = axes_matrix(axes) @ fixed.T  # from b as it is to b as it would be
        rank = -COMMON.index(axes) if axes in COMMON else -len(COMMON)
        return float(turn[2] @ up), round(float(turn[1] @ ahead), 1), rank

    return max(right_handed(), key=fit)
