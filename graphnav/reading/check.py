"""A run before anything is estimated: faults that stop it, findings worth telling."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.common.run import Imu, Odometer, Run
from graphnav.reading import plausibility
from graphnav.reading.vehicle import Vehicle

Array = NDArray[np.float64]
SLOW_IMU_HZ = 40.0
SHORT_S, TOO_SHORT_S = 30.0, 2.0
SILENT_S = 3.0  # an odometer quiet for longer is told


def check(run: Run, vehicle: Vehicle, use_gnss: bool = True) -> list[str]:
    """Findings on `run`, one line each, in the order worth reading.

    Raises `InputError` when the sensors contradict gravity, their units or the vehicle file, or
    when nothing says where the run began. `use_gnss` false: fixes may not serve as a start.
    """
    _fatal(run, vehicle, use_gnss)
    findings = [*run.notes, *_assumed(vehicle, run.sides is not None)]
    if run.imu is not None:
        plausibility.check_gravity(run)
        plausibility.check_rates(run, vehicle)
        findings += plausibility.check_up(run, vehicle)
        findings += _imu_findings(run, run.imu)
        findings += plausibility.driving_findings(run, vehicle)
    if run.odometer is not None:
        plausibility.check_odometer(run, use_gnss)
        findings += _odometer_findings(run, run.odometer)
    if run.gnss is not None and use_gnss:
        findings += plausibility.check_fixes(run, vehicle)
    return findings + _aiding_findings(run, vehicle, use_gnss)


def _fatal(run: Run, vehicle: Vehicle, use_gnss: bool) -> None:
    if run.end < TOO_SHORT_S:
        raise InputError(f"{run.path}: {run.end:.3g} s long; nothing to smooth under 2 s")
    if vehicle.kind == "rover" and run.imu is None and run.rover is None:
        raise InputError(
            f"{run.path}: neither gyros nor wheels: a rover needs gyro_x.. and accel_x.., or "
            "wheel_1..6; map them under [columns] in the vehicle file"
        )
    if not vehicle.start.has_position and (run.gnss is None or not use_gnss):
        why = "the run carries no GNSS fix" if run.gnss is None else "GNSS is not used"
        raise InputError(
            f"{run.path}: nothing says where the run began: {why} and the vehicle file has no "
            "position; add [start] lat, lon [deg], height [m] and heading_deg"
        )


def _assumed(vehicle: Vehicle, two_sided: bool) -> list[str]:
    """What the vehicle file leaves open and a default answers."""
    found = []
    if vehicle.imu.assumed and vehicle.kind != "rover":
        values = ", ".join(f"{name} {getattr(vehicle.imu, name):g}" for name in vehicle.imu.assumed)
        found.append(f"IMU figures not given: assumed {values}; state them or a grade under [imu]")
    body = vehicle.body
    missing = [name for name in ("track_gauge", "contact_length") if not body.given(name)]
    if vehicle.kind == "tracked" and body.low_gear_ratio is None and not two_sided:
        found.append("[vehicle] low_gear_ratio not given: assumed 1.42 (1: no low gear)")
    if vehicle.kind == "tracked" and missing:
        values = ", ".join(f"{name} {getattr(body, name):g} m" for name in missing)
        found.append(f"[vehicle] geometry not given: assumed {values}")
    return found


def _imu_findings(run: Run, imu: Imu) -> list[str]:
    """Sampling rate, length."""
    found = []
    step = float(np.median(imu.dt))
    if step > 1 / SLOW_IMU_HZ:
        found.append(
            f"the IMU comes at {1 / step:.3g} Hz: coning and sculling within a sample are lost"
        )
    if run.end < SHORT_S:
        found.append(f"the run is only {run.end:.1f} s long: calibrations stay near their priors")
    return found


def _odometer_findings(run: Run, odometer: Odometer) -> list[str]:
    """Silence at the ends or in between; a counter that never counts."""
    found = []
    edges = np.concatenate([[0.0], odometer.time, [run.end]])
    silent = [(a, b) for a, b in pairwise(edges[_around(np.diff(edges) > SILENT_S)])
              if b - a > SILENT_S]  # fmt: skip
    if silent:
        start, end = max(silent, key=lambda span: span[1] - span[0])
        times = "once" if len(silent) == 1 else f"{len(silent)} times"
        found.append(
            f"the odometer is silent {times} for over {SILENT_S:g} s, the longest from "
            f"{_clock(run, start)} to {_clock(run, end)}"
        )
    if not np.ptp(odometer.distance) > 0:
        found.append("the odometer never moves: the vehicle stood, or the column is dead")
    return found


def _around(long: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of the edges on either side of the steps in `long`."""
    return np.asarray(np.append(long, False) | np.append(False, long))


def _aiding_findings(run: Run, vehicle: Vehicle, use_gnss: bool) -> list[str]:
    """What is there to hold the inertial drift."""
    gnss = run.gnss if use_gnss else None
    if run.odometer is None and run.rover is None:
        what = "fixes alone hold" if gnss is not None else "nothing but standstill holds"
        return [f"no odometer: {what} the inertial drift"]
    if run.gnss is not None and gnss is None and not vehicle.start.given("heading_deg"):
        return ["GNSS is not used and [start] heading_deg is not given: heading rests on the gyros"]
    return []


def _clock(run: Run, time: float) -> str:
    """A time since start as the file's own clock says it."""
    return f"{run.clock_start + time:.3f}"
