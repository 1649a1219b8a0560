"""Calibration over time: every component a line with its 3-sigma band, and a table in words."""

import numpy as np
from numpy.typing import NDArray

from graphnav.result import palette
from graphnav.result.result_directory import Curve, Results
from graphnav.views.recording.entry import Entry, part
from graphnav.views.recording.scalars import band

Array = NDArray[np.float64]

TITLE = {
    "odometer_scale": "Odometer scale",
    "gyro_bias_deg_h": "Gyro bias",
    "accel_bias_mg": "Accelerometer bias",
    "mounting_deg": "Mounting",
    "lever_arm_m": "Lever arm",
    "time_offset_s": "Time offset",
    "forward_factor": "Forward factor",
    "lateral_offset_m": "Lateral offset",
    "kappa": "Lateral factor",
    "effective_track_width_m": "Effective track width",
    "slip_coefficient": "Slip coefficient",
}


def title(name: str) -> str:
    """A calibration quantity in words."""
    return TITLE.get(name, name.replace("_", " ").capitalize())


def label(component: str) -> str:
    """A component in words: an axis, or a motion state."""
    return palette.motion_label(component) if component in palette.MOTION else component


def entries(results: Results) -> list[Entry]:
    """Everything below `/calibration`."""
    return [e for curve in results.calibration.values() for e in _components(results, curve)]


def _components(results: Results, curve: Curve) -> list[Entry]:
    out: list[Entry] = []
    ends = results.time[[0, -1]]
    time = np.unique(ends if curve.constant else np.concatenate([ends, curve.time]))
    value, sd = curve.at(time)
    unit = "" if curve.unit in ("1", "") else f" [{curve.unit}]"
    for k, component in enumerate(curve.components):
        name = f"{label(component)}{unit}, ±3σ"
        if curve.constant:
            name = f"{label(component)} {value[0, k]:.4g} ± {3 * sd[0, k]:.2g}{unit}"
        name += "" if curve.observable[k] else " (not observable)"
        entity = f"/calibration/{part(curve.name)}/{part(component)}"
        colour = palette.MOTION.get(component, palette.AXES[k % 3])
        at = time - results.clock_start
        out += band(entity, at, value[:, k], sd[:, k], name, colour)
    return out
