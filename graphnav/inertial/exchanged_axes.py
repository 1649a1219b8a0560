"""Axes exchanged in mid-run: gravity tells which way is up, and a vehicle turns about that way.

What a gyro turns about a level axis is a tilt, and the accelerometer feels a tilt; what it turns
about the vertical at a speed v pushes to the side with v w (A4). If the gyro's turns agree with
what is felt as the axes stand, and later with two of them exchanged, they were exchanged meanwhile.
If the way down goes from one axis to another and the gyro felt no such fall, or forward becomes
sideways, the accelerometer's were.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array, Imu, Odometer
from graphnav.inertial.gaps import Mask
from graphnav.inertial.odometer_steps import speed_at

SLOT_S = 2.0  # over which turns and gravity are averaged
FEWEST = 16  # slots
TILT = 0.2  # rad, one sigma of what brakes and hills make a slot's tilt look like
PUSH = 0.3  # m/s^2, one sigma of what bumps and banks add to a slot's sideways or forward force
FAST = 3.0  # m/s: a bias of 1 deg/s pushes by 0.05 m/s^2
MOST = 25.0  # of evidence, from one slot
DECIDES, EARLIER = 50.0, 10.0  # evidence against the axes as they stand, and before that for them
FELL = 1.0  # rad: gravity never goes so far between neighbouring slots, unless the vehicle falls
NEAR, MOSTLY = 0.5, 0.9  # rad: the same way down; share of the slots that have another
AS_THEY_STAND = [0, 1, 2]
LEVEL = "x and y"
ORDERS = {LEVEL: [1, 0, 2], "x and z": [2, 1, 0], "y and z": [0, 2, 1]}


@dataclass(frozen=True)
class Exchange:
    """Samples of one sensor with two axes standing for each other."""

    sensor: int  # 0 gyro, 1 accelerometer
    axes: str
    mask: Mask  # (N,) certainly exchanged
    open: Mask  # (N,) about where it began or ended: one or the other


def exchanges(imu: Imu, odometer: Odometer | None, seen: NDArray[np.bool_]) -> list[Exchange]:
    """Stretches of gyro or accelerometer with two axes exchanged, from samples `seen` (N, 2)."""
    slots = _Slots.of(imu, odometer, seen)
    if slots is None:
        return []
    level = {LEVEL: slots.forces_contradict(ORDERS[LEVEL])}
    stands = slots.forces_contradict(AS_THEY_STAND)
    force = _fallen(slots) or _exchange(1, slots, stands, level, slots.none)
    dark = slots.none if force is None else slots.touched(force)
    turns = {axes: slots.turns_contradict(order) for axes, order in ORDERS.items()}
    gyro = _exchange(0, slots, slots.turns_contradict(AS_THEY_STAND), turns, dark)
    return [found for found in (gyro, force) if found is not None]


def put_back(imu: Imu, exchange: Exchange) -> Imu:
    """The samples with the axes where they belong."""
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    values = (gyro, accel)[exchange.sensor]
    values[exchange.mask] = values[exchange.mask][:, ORDERS[exchange.axes]]
    return replace(imu, gyro=gyro, accel=accel)


def _exchange(
    sensor: int, slots: "_Slots", stands: Array, exchanged: dict[str, Array], dark: Mask
) -> Exchange | None:
    """The exchange that contradicts what is felt far less, (K,) chi-square, from somewhere on."""
    best: Exchange | None = None
    most = DECIDES
    for axes, other in exchanged.items():
        gain = np.where(dark, 0.0, stands - other)
        first, end = _span(gain)
        total = float(gain[first:end].sum())
        tells = gain > min(1.0, float(gain.max()) / 2)
        if total > most and -float(gain[:first].sum()) > EARLIER:
            best, most = slots.exchange(sensor, axes, gain < -1, tells, (first, end)), total
    return best


def _fallen(slots: "_Slots") -> Exchange | None:
    """The accelerometer where gravity lies on another axis, and the gyro felt no fall."""
    fell = _angle(slots.up[2:], slots.up[:-2])
    turned = slots.turned[2:] + slots.turned[1:-1] + slots.turned[:-2]
    tilted = np.linalg.norm(_across(turned, slots.up[:-2]), axis=1)
    jumps = np.flatnonzero((fell > FELL) & (tilted < FELL / 2))
    if not len(jumps):
        return None
    usual = np.median(slots.up[: jumps[0] + 1], axis=0)[None]
    stands = _angle(slots.up, usual) < NEAR
    for axes, order in ORDERS.items():
        other = ~stands & (_angle(slots.up[:, order], usual) < NEAR)
        if other.sum() >= 2 and other.sum() > MOSTLY * (~stands).sum():
            at = np.flatnonzero(other)
            return slots.exchange(1, axes, stands, other, (int(at[0]), int(at[-1]) + 1))
    return None


@dataclass(frozen=True)
class _Slots:
    """Turns and forces in slots of some seconds."""

    slot: NDArray[np.intp]  # (N,) slot of every sample
    turned: Array  # (K, 3) rad, the gyro's integral over each
    force: Array  # (K, 3) m/s^2, mean
    up: Array  # (K, 3) unit vectors, along the mean force
    speed: Array  # (K,) m/s, of the odometer; 0 where there is none
    gained: Array  # (K,) m/s^2, its derivative

    @classmethod
    def of(cls, imu: Imu, odometer: Odometer | None, seen: NDArray[np.bool_]) -> "_Slots | None":
        """Slots of a run, None where it is too short for any evidence."""
        slot = ((imu.time - imu.time[0]) // SLOT_S).astype(np.intp)
        slot = np.unique(slot, return_inverse=True)[1]
        count = int(slot[-1]) + 1
        if count < FEWEST:
            return None
        rate, force = (
            np.stack([np.bincount(slot, np.where(on, x, 0.0), count) for x in values.T], -1)
            / np.maximum(np.bincount(slot, on, count), 1)[:, None]
            for values, on in zip((imu.gyro, imu.accel), seen.T, strict=True)
        )
        size = np.linalg.norm(force, axis=1, keepdims=True)
        speed = gained = np.zeros(count)
        if odometer is not None:
            middle = np.bincount(slot, imu.time, count) / np.bincount(slot)
            speed = speed_at(odometer, middle, SLOT_S / 2)
            later, earlier = (speed_at(odometer, middle + d * SLOT_S / 2) for d in (1, -1))
            gained = (later - earlier) / SLOT_S
        up = force / np.where(size > 0, size, 1.0)
        rate[:, 2] -= _offset(rate[:, 2], force[:, 0], speed)
        return cls(slot, rate * SLOT_S, force, up, speed, gained)

    def turns_contradict(self, order: list[int]) -> Array:
        """How far turns with axes in this order are from what is felt, chi-square (K,)."""
        turned = self.turned[:, order]
        level = _across(turned, self.up)
        after = np.concatenate([self.up[1:], self.up[-1:]])
        before = np.concatenate([self.up[:1], self.up[:-1]])
        beyond = np.linalg.norm(level, axis=1) - _angle(after, before)
        tilts = np.minimum((np.maximum(beyond, 0.0) / TILT) ** 2, MOST)
        pushed = self.force[:, 0] + self.speed * turned[:, 2] / SLOT_S
        return np.asarray(tilts + np.minimum((pushed / PUSH) ** 2, MOST))

    def forces_contradict(self, order: list[int]) -> Array:
        """How far level forces with axes in this order are from what driving does, (K,)."""
        sideways = -self.speed * self.turned[:, 2] / SLOT_S
        felt = self.force[:, order]
        away = (felt[:, 0] - sideways) ** 2 + (felt[:, 1] - self.gained) ** 2
        return np.asarray(np.minimum(away / PUSH**2, MOST))

    @property
    def none(self) -> Mask:
        """No slot (K,)."""
        return np.zeros(len(self.speed), bool)

    def touched(self, exchange: Exchange) -> Mask:
        """Slots (K,) that hold any of an exchange's samples."""
        on = self.slot[exchange.mask | exchange.open]
        return np.asarray(np.bincount(on, minlength=len(self.speed)) > 0)

    def exchange(
        self, sensor: int, axes: str, stands: Mask, other: Mask, span: tuple[int, int]
    ) -> Exchange:
        """Samples in the slots of a span, and what lies open about its ends.

        `stands`, `other` (K,): slots that tell that the axes stand, or not.
        """
        first, end = span
        sure_slots = first + np.flatnonzero(other[first:end])
        before, after = np.flatnonzero(stands[:first]), np.flatnonzero(stands[end:])
        # they may have been exchanged in the midst of a slot
        low = int(before[-1]) if len(before) else 0
        high = end + int(after[0]) if len(after) else len(stands)
        sure = (self.slot > sure_slots[0]) & (self.slot < (sure_slots[-1] if len(after) else high))
        return Exchange(sensor, axes, sure, ~sure & (self.slot >= low) & (self.slot <= high))


def _offset(yaw_rate: Array, sideways: Array, speed: Array) -> float:
    """Rate (rad/s) by which the turns (K,) differ from what pushes to the side nearly all along:
    the gyro's bias, however large, and what the road falls to one side.
    """
    fast = np.abs(speed) > FAST
    if fast.sum() < FEWEST:
        return 0.0
    return float(np.median(yaw_rate[fast] + sideways[fast] / speed[fast]))


def _span(gain: Array) -> tuple[int, int]:
    """First and one past the last of the consecutive elements (K,) with the largest sum."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    lowest = np.minimum.accumulate(total)
    end = int((total - lowest).argmax())
    return int(total[: end + 1].argmin()), end


def _across(a: Array, up: Array) -> Array:
    """What of vectors (K, 3) is square to unit vectors (K, 3)."""
    return np.asarray(a - (a * up).sum(axis=1, keepdims=True) * up)


def _angle(a: Array, b: Array) -> Array:
    """Angle between unit vectors (K, 3), rad (K,)."""
    size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=1) / np.maximum(size, 1e-12), -1, 1)))
