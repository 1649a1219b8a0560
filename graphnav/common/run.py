"""One recorded run in memory: every sensor on its own clock, SI units, right-forward-up axes.

Times are seconds from the run's start, `clock - Run.clock_start`. Arrays are float64 and read-only
by convention; a sensor the file does not carry is None.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EVERY_AXIS = (True,) * 6


@dataclass(frozen=True)
class Imu:
    """Inertial samples: means over the interval `(time - dt, time]`."""

    time: Array  # (N,) s, end of the interval
    dt: Array  # (N,) s
    gyro: Array  # (N, 3) rad/s, b frame
    accel: Array  # (N, 3) m/s^2, specific force, b frame
    doubt: Array | None = None  # (N, 2) rad, m/s: 1 sigma missed where a sample is a bridge only


@dataclass(frozen=True)
class Accelerometer:
    """Specific force of a gyro-free rover: means over the interval that ends at `time`."""

    time: Array  # (N,) s
    accel: Array  # (N, 3) m/s^2, b frame


@dataclass(frozen=True)
class Odometer:
    """Distance counted by the odometer, in nominal metres (scale factor not applied)."""

    time: Array  # (M,) s
    distance: Array  # (M,) m, cumulative, starts at 0; signed speeds are integrated (trapezoid)
    speed: Array  # (M,) m/s, as recorded, or pulses differenced
    pulse: float  # m per count; 0 when the column is a speed


@dataclass(frozen=True)
class SideSpeeds:
    """Speeds of the left and right running gear (skid steer, tracks)."""

    time: Array  # (M,) s
    left: Array  # (M,) m/s
    right: Array  # (M,) m/s


@dataclass(frozen=True)
class Gnss:
    """Satellite fixes with their own standard deviations."""

    time: Array  # (K,) s
    lat_deg: Array  # (K,)
    lon_deg: Array  # (K,)
    height: Array  # (K,) m, as given
    sd_enu: Array  # (K, 3) m


@dataclass(frozen=True)
class ExternalHeading:
    """Heading from a sun or star sensor or a dual antenna, clockwise from north."""

    time: Array  # (K,) s
    heading: Array  # (K,) rad


@dataclass(frozen=True)
class RoverGear:
    """Rocker-bogie running gear (methods C): six wheels, steering and linkage angles."""

    time: Array  # (K,) s
    wheel: Array  # (K, 6) rad/s
    steer: Array  # (K, 6) rad, right positive
    rocker: Array  # (K,) rad
    bogie_left: Array  # (K,) rad
    bogie_right: Array  # (K,) rad


@dataclass(frozen=True)
class Run:
    """A run file read, mapped to SI and RFU axes, checked for order; nothing estimated yet."""

    path: Path
    clock_start: float  # the file's own clock at time 0
    end: float  # s, last row
    imu: Imu | None  # None only for a gyro-free rover
    odometer: Odometer | None
    sides: SideSpeeds | None
    gnss: Gnss | None
    heading: ExternalHeading | None
    rover: RoverGear | None
    accelerometer: Accelerometer | None = None  # only where accel columns come without gyro columns
    logged: Imu | None = None  # the IMU's samples as they came, where `imu` is not just these
    sensed: tuple[bool, ...] = EVERY_AXIS  # of gyro and accelerometer, b frame; else a stand-in
    notes: tuple[str, ...] = ()  # what the reading assumed or left out, one line each

    @property
    def felt(self) -> bool:
        """Whether all three accelerometers were recorded."""
        return all(self.sensed[3:])
