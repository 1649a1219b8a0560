"""Calibrations as they are told: in the field's units, with what the run could not determine."""

import numpy as np

from factors.calibration import (
    ACCEL_BIAS,
    ANTENNA,
    CORNERING,
    DELAY,
    GNSS_DELAY,
    GNSS_OFFSET,
    GYRO_BIAS,
    LEVER,
    MOUNTING,
    SCALE,
    TRACK_WIDTH,
    forward_of,
    lateral_of,
)
from graphnav.batch.smoother import Smoothed
from graphnav.graph.calibrations import COMMON_SHARE, DEG_H, MG
from graphnav.result.solved import Calibrated

XYZ = ("x", "y", "z")
DEG = np.deg2rad(1.0)
ASTRAY = 3.0  # deviations, of fixes and of what is known of their common error
LATE_S = 0.05  # of fixes, that is worth telling


def calibrated(smoothed: Smoothed) -> list[Calibrated]:
    """Every calibration of a run with its standard deviation and prior."""
    prep, nodes = smoothed.prep, smoothed.problem.nodes
    layout, chain = prep.setup.layout, smoothed.estimate.calibration
    sd = np.sqrt(np.einsum("kii->ki", smoothed.covariances.calibration))
    out: list[Calibrated] = []

    def add(name: str, unit: str, parts: tuple[str, ...], columns: list[int], per: float) -> None:
        walk, prior_sd = layout.walk[columns], layout.prior_sd[columns]
        constant = bool(np.all(walk <= 1e-5 * prior_sd))
        rows = slice(-1, None) if constant else slice(None)
        one = 1.0 if name == "odometer_scale" else 0.0
        out.append(
            Calibrated(
                name=name,
                unit=unit,
                components=parts,
                constant=constant,
                time=nodes.segment_time[rows],
                value=one + chain[rows][:, columns] / per,
                sd=sd[rows][:, columns] / per,
                prior=one + layout.prior[columns] / per,
                prior_sd=prior_sd / per,
            )
        )

    def of(name: str) -> list[int]:
        span = layout.slices[name]
        return list(range(span.start, span.stop))

    add("gyro_bias_deg_h", "deg/h", XYZ, of(GYRO_BIAS), DEG_H)
    add("accel_bias_mg", "mg", XYZ, of(ACCEL_BIAS), MG)
    if prep.sensed.run.odometer is not None:
        add("odometer_scale", "1", ("scale",), of(SCALE), 1.0)
    add("mounting_deg", "deg", ("pitch", "heading"), of(MOUNTING), DEG)
    add("lever_arm_m", "m", XYZ, of(LEVER), 1.0)
    if DELAY in layout.slices and prep.sensed.run.odometer is not None:
        add("time_offset_s", "s", ("odometer",), of(DELAY), 1.0)
    if CORNERING in layout.slices:
        add("cornering_slip_s", "s", ("tyres",), of(CORNERING), 1.0)
    if ANTENNA in layout.slices:
        add("antenna_lever_arm_m", "m", XYZ, of(ANTENNA), 1.0)
        add("gnss_offset_m", "m", ("east", "north", "up"), of(GNSS_OFFSET), 1.0)
    if GNSS_DELAY in layout.slices:
        add("gnss_time_offset_s", "s", ("fixes",), of(GNSS_DELAY), 1.0)
    if TRACK_WIDTH in layout.slices:
        add("effective_track_width_m", "m", ("width",), of(TRACK_WIDTH), 1.0)
    driven = set(smoothed.problem.state)
    for of_state, name, unit in (
        (forward_of, "forward_factor", "1"),
        (lateral_of, "lateral_offset_m", "m"),
    ):
        states = [s for s in prep.setup.table if of_state(s) in layout.slices and s in driven]
        if states:
            add(name, unit, tuple(states), [layout.column(of_state(s)) for s in states], 1.0)
    laterals = [c for c in out if c.name == "lateral_offset_m"]
    if laterals:
        add("kappa", "1", laterals[0].components,
            [layout.column(lateral_of(s)) for s in laterals[0].components],
            prep.setup.vehicle.body.contact_length)  # fmt: skip
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
        if c.name == "gnss_time_offset_s" and abs(c.value[0, 0]) > max(LATE_S, 3 * c.sd[0, 0]):
            late, sd = float(c.value[0, 0]), float(c.sd[0, 0])
            said.append(
                f"fixes come {abs(late):.2f} +- {sd:.2f} s {'late' if late > 0 else 'early'}"
            )
        if c.name == "gnss_offset_m":
            said += _astray(c)
        hidden = [p for p, seen in zip(c.components, c.observable, strict=True) if not seen]
        if hidden and c.name in ("mounting_deg", "lever_arm_m", "forward_factor", "time_offset_s"):
            name = c.name.rsplit("_", 1)[0].replace("_", " ")
            said.append(f"{name} {', '.join(hidden)}: not observable in this run")
    return said


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
