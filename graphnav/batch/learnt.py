"""Calibrations as they are told: in the field's units, with what the run could not determine."""

from dataclasses import dataclass

import numpy as np

from factors.calibration import (
    ACCEL_BIAS,
    ACCEL_SCALE,
    ANTENNA,
    CORNERING,
    DELAY,
    GNSS_DELAY,
    GNSS_OFFSET,
    GYRO_BIAS,
    GYRO_SCALE,
    LEVER,
    MOUNTING,
    SCALE,
    SLOPE_DRIFT,
    TRACK_WIDTH,
    forward_of,
    lateral_of,
)
from graphnav.batch.smoother import Smoothed
from graphnav.common.run import Array
from graphnav.graph.calibrations import COMMON_SHARE, DEG_H, MG, PPM
from graphnav.result.solved import Calibrated

XYZ = ("x", "y", "z")
DEG = np.deg2rad(1.0)
ASTRAY = 3.0  # deviations, of fixes and of what is known of their common error
LATE_S = 0.05  # of fixes, that is worth telling
EARLY_S = 0.02  # of fixes, that an IMU is late by
WAITS_S = 0.5  # of an IMU that filters or waits, at most: what is more is a clock set wrong


@dataclass(frozen=True)
class _Entry:
    """Columns of the calibration vector as they are told together."""

    name: str
    unit: str
    parts: tuple[str, ...]
    columns: list[int]
    per: float = 1.0  # of the column's unit, one of `unit`


def calibrated(smoothed: Smoothed) -> list[Calibrated]:
    """Every calibration of a run with its standard deviation and prior."""
    sd = np.sqrt(np.einsum("kii->ki", smoothed.covariances.calibration))
    entries = [*_of_sensors(smoothed), *_of_ground(smoothed)]
    return [_calibrated(smoothed, sd, entry) for entry in entries]


def _calibrated(smoothed: Smoothed, sd: Array, entry: _Entry) -> Calibrated:
    """`sd` (K, dim) of all segments and columns."""
    layout, columns, per = smoothed.prep.setup.layout, entry.columns, entry.per
    prior_sd = layout.prior_sd[columns]
    constant = bool(np.all(layout.walk[columns] <= 1e-5 * prior_sd))
    rows = slice(-1, None) if constant else slice(None)
    one = 1.0 if entry.name == "odometer_scale" else 0.0
    return Calibrated(
        name=entry.name,
        unit=entry.unit,
        components=entry.parts,
        constant=constant,
        time=smoothed.problem.nodes.segment_time[rows],
        value=one + smoothed.estimate.calibration[rows][:, columns] / per,
        sd=sd[rows][:, columns] / per,
        prior=one + layout.prior[columns] / per,
        prior_sd=prior_sd / per,
    )


def _of_sensors(smoothed: Smoothed) -> list[_Entry]:
    """Biases, odometer, antenna: those that the run's layout has."""
    layout = smoothed.prep.setup.layout
    counted = smoothed.prep.sensed.run.odometer is not None
    entries = [
        (GYRO_BIAS, "gyro_bias_deg_h", "deg/h", XYZ, DEG_H),
        (ACCEL_BIAS, "accel_bias_mg", "mg", XYZ, MG),
        (GYRO_SCALE, "gyro_scale_ppm", "ppm", XYZ, PPM),
        (ACCEL_SCALE, "accel_scale_ppm", "ppm", XYZ, PPM),
        (SCALE if counted else "", "odometer_scale", "1", ("scale",), 1.0),
        (MOUNTING, "mounting_deg", "deg", ("pitch", "heading"), DEG),
        (LEVER, "lever_arm_m", "m", XYZ, 1.0),
        (DELAY if counted else "", "time_offset_s", "s", ("odometer",), 1.0),
        (CORNERING, "cornering_slip_s", "s", ("tyres",), 1.0),
        (SLOPE_DRIFT, "slope_drift", "1", ("downhill",), 1.0),
        (ANTENNA, "antenna_lever_arm_m", "m", XYZ, 1.0),
        (GNSS_OFFSET, "gnss_offset_m", "m", ("east", "north", "up"), 1.0),
        (GNSS_DELAY, "gnss_time_offset_s", "s", ("fixes",), 1.0),
        (TRACK_WIDTH, "effective_track_width_m", "m", ("width",), 1.0),
    ]
    every = np.arange(layout.dim)
    return [
        _Entry(name, unit, parts, every[layout.slices[component]].tolist(), per)
        for component, name, unit, parts, per in entries
        if component in layout.slices
    ]


def _of_ground(smoothed: Smoothed) -> list[_Entry]:
    """What the odometer means in the motion states that the run went through."""
    setup, driven = smoothed.prep.setup, set(smoothed.problem.state)
    length = setup.vehicle.body.contact_length
    out = []
    for of_state, name, unit, per in (
        (forward_of, "forward_factor", "1", 1.0),
        (lateral_of, "lateral_offset_m", "m", 1.0),
        (lateral_of, "kappa", "1", length),
    ):
        states = [s for s in setup.table if of_state(s) in setup.layout.slices and s in driven]
        if states:
            columns = [setup.layout.column(of_state(s)) for s in states]
            out.append(_Entry(name, unit, tuple(states), columns, per))
    return out


def verdicts(found: list[Calibrated]) -> list[str]:
    """What was learnt and what was not, in sentences."""
    said = []
    for c in found:
        if c.name == "odometer_scale":
            drift = 1e3 * float(np.ptp(c.value[:, 0]))
            mean, sd = float(c.value.mean()), float(np.median(c.sd))
            said.append(f"odometer scale {mean:.4f} +- {sd:.4f}, drifted {drift:.1f} permille")
        late = c.name == "time_offset_s" and abs(c.value[0, 0]) > max(0.002, 2 * c.sd[0, 0])
        if late and c.observable[0]:
            said.append(
                f"odometer clock off by {1e3 * c.value[0, 0]:.0f} +- {1e3 * c.sd[0, 0]:.0f} ms"
            )
        if c.name == "gnss_time_offset_s":
            said += _late(c)
        if c.name == "gnss_offset_m":
            said += _astray(c)
        hidden = [p for p, seen in zip(c.components, c.observable, strict=True) if not seen]
        if hidden and c.name in ("mounting_deg", "lever_arm_m", "forward_factor", "time_offset_s"):
            name = c.name.rsplit("_", 1)[0].replace("_", " ")
            said.append(f"{name} {', '.join(hidden)}: not observable in this run")
    return said


def imu_late(found: list[Calibrated]) -> float:
    """By how much the IMU's stamps are late, s: no receiver stamps a fix before it is taken, so
    fixes that come early tell of an IMU that filters or waits; the path is told on their clock.
    Earlier than any IMU waits, it is the fixes that are stamped by another clock than the rest.
    """
    for c in found:
        if c.name == "gnss_time_offset_s":
            early, sd = -float(c.value[0, 0]), float(c.sd[0, 0])
            return early if max(EARLY_S, 3 * sd) < early < WAITS_S else 0.0
    return 0.0


def _late(c: Calibrated) -> list[str]:
    """Whose clock is late."""
    late, sd = float(c.value[0, 0]), float(c.sd[0, 0])
    if late > max(LATE_S, 3 * sd):
        return [f"fixes come {late:.2f} +- {sd:.2f} s late"]
    if late < -WAITS_S:
        return [f"fixes come {-late:.2f} +- {sd:.2f} s early: told on the clock of the IMU"]
    if imu_late([c]):
        return [
            f"the fixes come {-late:.2f} +- {sd:.2f} s early, the IMU's stamps late by as much: "
            "told on the fixes' clock"
        ]
    return []


def _astray(c: Calibrated) -> list[str]:
    """Errors of the fixes that are far larger than stated and last for minutes."""
    usual = c.prior_sd / COMMON_SHARE
    off = np.where(np.abs(c.value) > ASTRAY * c.sd, np.abs(c.value), 0.0)
    k, axis = np.unravel_index(int((off / usual).argmax()), off.shape)
    if off[k, axis] < ASTRAY * usual[axis]:
        return []
    return [
        f"fixes stray together, by up to {off[k, axis]:.1f} m {c.components[axis]} (+- "
        f"{c.sd[k, axis]:.1f} m): odometer and gyro do not follow them"
    ]
