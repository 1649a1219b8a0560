"""Calibration over time: every component a line with its 3-sigma band, and a table in words."""

import numpy as np
from numpy.typing import NDArray

from graphnav import palette
from graphnav.recording.entry import Entry, part
from graphnav.recording.scalars import band
from graphnav.results import Curve, Results, columns

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


def by_state(curve: Curve) -> bool:
    """Whether the components are motion states rather than axes."""
    return any(component in palette.MOTION for component in curve.components)


def entries(results: Results) -> list[Entry]:
    """Everything below `/calibration`."""
    out: list[Entry] = []
    for curve in results.calibration.values():
        if by_state(curve):
            out += _in_force(results, curve)
        else:
            out += _components(results, curve)
    return out


def _components(results: Results, curve: Curve) -> list[Entry]:
    out: list[Entry] = []
    ends = results.time[[0, -1]]
    time = np.unique(ends if curve.constant else np.concatenate([ends, curve.time]))
    value, sd = curve.at(time)
    for k, component in enumerate(curve.components):
        unit = "" if curve.unit in ("1", "") else f" [{curve.unit}]"
        name = f"{component}{unit}, ±3σ" + ("" if curve.observable[k] else " (not observable)")
        entity = f"/calibration/{part(curve.name)}/{part(component)}"
        colour = palette.AXES[k % 3]
        known = time - results.clock_start
        out += band(entity, known, value[:, k], sd[:, k], name, colour)
    return out


def _in_force(results: Results, curve: Curve) -> list[Entry]:
    """One series: the factor of the state the vehicle is in, stepping with the states."""
    states = results.states[results.states["state"].isin(curve.components)]
    if states.empty:
        return []
    start, end = columns(states, "start", "end").T
    # first, last and, to break the line before the next state, nothing
    time = np.stack([start, np.maximum(start, end - 2e-3), end - 1e-3], -1).reshape(-1)
    which = np.repeat([curve.components.index(s) for s in states["state"]], 3)
    rows = np.arange(len(time))
    value, sd = (both[rows, which] for both in curve.at(time))
    value[2::3] = np.nan
    name = "factor of the present state, ±3σ"
    entity = f"/calibration/{part(curve.name)}/in_force"
    at = time - results.clock_start
    return band(entity, at, value, sd, name, palette.ODOMETER)
