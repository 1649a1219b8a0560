"""What a solution founders on that does not settle or is undetermined: sensor, span and cure."""

from collections.abc import Sequence

import numpy as np

from factors import kinds
from factors.block import Block
from graphnav.common.run import Array, Run

LARGE = 5.0  # sigma: residuals as large belong to the trouble
UNUSUAL = 10.0  # times the scatter: samples so far away are named
TOGETHER_S = 20.0  # between two of them that are one trouble

GYROS = "leave out the IMU's samples there (blank their cells), or state larger noise under [imu]"
ODOMETER = "blank the odometer's cells there, or state a larger [odometer] scale_sd"
CURES: dict[str, tuple[str, str]] = {  # kind -> what it comes from, what to leave out
    kinds.INERTIAL: ("the IMU", GYROS),
    kinds.STANDSTILL: ("the IMU at rest", GYROS),
    kinds.DISPLACEMENT: ("the odometer", ODOMETER),
    kinds.VELOCITY: ("the odometer", ODOMETER),
    kinds.PHASE: ("the pulse counter", ODOMETER),
    kinds.TRACK_WIDTH: ("the side speeds", "blank odo_left and odo_right there"),
    kinds.GNSS: ("the fixes", "withhold them with --outage START:END, or all with --no-gnss"),
    kinds.HEADING: ("the heading sensor", "blank heading_deg there"),
    kinds.START_HEADING: ("[start]", "leave out [start] heading_deg"),
    kinds.START: ("[start]", "state larger position_sd_m and heading_sd_deg under [start]"),
}
WHEELS = ("the wheels", "blank their cells there")
CALIBRATION = ("the calibrations", "check units, axes and figures in the vehicle file")


def worst(blocks: Sequence[Block], weights: Sequence[Array]) -> str:
    """The sensor that costs most, the span in which it does, and what to leave out, in words."""
    costs = [w * b.residual**2 for b, w in zip(blocks, weights, strict=True)]
    k = int(np.argmax([cost.sum() if cost.size else 0.0 for cost in costs]))
    block, cost = blocks[k], costs[k]
    rows = cost.sum(axis=1)
    at = int(rows.argmax())
    axis = block.axes[int(cost[at].argmax())]
    start, end = _span(block.time, np.sqrt(rows), at)
    sensor, cure = _of(block.kind)
    return (
        f"{sensor} ({block.kind}, {axis}): largest disagreement from {start:.1f} to {end:.1f} s of "
        f"the run, at worst by {np.sqrt(rows[at]):.2g} sigma; {cure}"
    )


def most_unusual(run: Run) -> str:
    """The sensor whose samples stray furthest from its usual ones, when, and what to leave out.

    For what has no residuals yet: a system that could not even be set up or solved.
    """
    found = [(*_strays(values), time, kind) for kind, time, values in _recorded(run)]
    nothing = (0.0, np.zeros(0), np.zeros(0), "")
    far, size, time, kind = max(found, key=lambda each: each[0], default=nothing)
    if far < UNUSUAL:
        return "no sensor strays from its usual: check the figures in the vehicle file"
    sensor, cure = _of(kind)
    at = int(size.argmax())
    start, end = _span(time, LARGE * size / (0.5 * size[at] or 1.0), at)
    return (
        f"{sensor} strays furthest from its usual, by {far:.2g} times its scatter, from "
        f"{start + run.clock_start:.3f} to {end + run.clock_start:.3f}: {cure}, or check units and "
        "figures in the vehicle file"
    )


def _recorded(run: Run) -> list[tuple[str, Array, Array]]:
    """Kind of factor, times (N,) and samples (N, d) of what a run recorded."""
    there: list[tuple[str, Array, Array]] = []
    if run.imu is not None:
        there += [(kinds.INERTIAL, run.imu.time, each) for each in (run.imu.gyro, run.imu.accel)]
    if run.odometer is not None:
        there.append((kinds.DISPLACEMENT, run.odometer.time, run.odometer.speed[:, None]))
    if run.gnss is not None:
        places = np.stack([run.gnss.lat_deg, run.gnss.lon_deg, run.gnss.height], -1)
        there.append((kinds.GNSS, run.gnss.time, places))
    if run.rover is not None:
        there.append((WHEELS[0], run.rover.time, np.nan_to_num(run.rover.wheel)))
    return there


def _strays(values: Array) -> tuple[float, Array]:
    """Largest distance of samples (N, d) from their medians in median distances, and of each."""
    apart = np.abs(values - np.median(values, axis=0)).max(axis=1)
    usual = max(float(np.median(apart)), float(np.finfo(float).tiny))
    return float(apart.max() / usual), apart


def moment(blocks: Sequence[Block], family: str, index: int) -> float | None:
    """When a variable acts, s of the run; None when no factor acts on it."""
    for block in blocks:
        for term in block.terms:
            if term.family == family and (on := np.flatnonzero(term.index == index)).size:
                return float(block.time[on[0]])
    return None


def _of(kind: str) -> tuple[str, str]:
    if kind in CURES:
        return CURES[kind]
    return WHEELS if "wheel" in kind else CALIBRATION


def _span(time: Array, size: Array, at: int) -> tuple[float, float]:
    """First and last large residual around the largest, without long pauses between."""
    large = np.flatnonzero((size > LARGE) | (np.arange(len(size)) == at))
    apart = np.flatnonzero(np.diff(time[large]) > TOGETHER_S)
    i = int(np.searchsorted(large, at))
    first = apart[apart < i].max(initial=-1) + 1
    last = apart[apart >= i].min(initial=len(large) - 1)
    return float(time[large[first]]), float(time[large[last]])
