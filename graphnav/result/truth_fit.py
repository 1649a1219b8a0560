"""Whether a reference can be held against a result at all, and if not, what it seems to be."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graphnav.common.angles import wrapped
from graphnav.common.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]
LEAST_SHARE = 0.1  # of the shorter of the two that both must cover
NEAR_DEG = 1.0
DEGREE_M = 111e3  # along a meridian
FAR_M = 10e3  # between the areas of both, beside their sizes: more is no error of a solution
SLOW_S = 5.0  # between reference rows: slower may be another unit
DAY_S = 86400.0
UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}


def check_fit(trajectory: "DataFrame", truth: "DataFrame") -> None:
    """InputError when truth shares too little time with the trajectory, or is not in degrees."""
    own, time = (frame["time"].to_numpy(dtype=np.float64) for frame in (trajectory, truth))
    shared = _shared(own, time)
    if shared < LEAST_SHARE or (np.median(np.diff(time)) > SLOW_S and _unit(own, time)):
        spans = f"truth ({_at(time[0])} to {_at(time[-1])}) and result ({_at(own[0])} to "
        share = f"share {shared:.2%} of their time" if shared > 0 else "share no time"
        raise InputError(
            f"{spans}{_at(own[-1])}) {share}: {_why(own, time)}; both must be on the run file's "
            "clock"
        )
    here = _middle(trajectory)
    there = _middle(truth)
    if _apart(np.rad2deg(there), here) < NEAR_DEG < _apart(there, here):
        raise InputError(
            f"truth's lat, lon ({there[0]:.6f}, {there[1]:.6f}) are in radians: give degrees"
        )
    _check_place(trajectory, truth)


def _check_place(trajectory: "DataFrame", truth: "DataFrame") -> None:
    """InputError when truth lies where no error of the result can have put it."""
    here, there = _middle(trajectory), _middle(truth)
    scale = DEGREE_M * np.array([1.0, np.cos(np.deg2rad(here[0]))])
    away = there - here
    away[1] = wrapped(away[1], 360.0)
    apart = float(np.linalg.norm(scale * away))
    sizes = [np.linalg.norm(scale * np.ptp(_places(x), axis=0)) for x in (trajectory, truth)]
    if apart > FAR_M + float(sum(sizes)):
        raise InputError(
            f"truth lies {apart / 1e3:.0f} km from the result ({there[0]:.4f}, {there[1]:.4f} to "
            f"{here[0]:.4f}, {here[1]:.4f}): it is another run's, or the start is another place's"
        )


def _at(time: float) -> str:
    return f"{round(time, 3):.15g}"


def _shared(own: Array, time: Array) -> float:
    """Of the shorter span, the share that both cover; one reference row counts as covered."""
    overlap = min(own[-1], time[-1]) - max(own[0], time[0])
    if overlap < 0 or not ((time >= own[0]) & (time <= own[-1])).any():
        return 0.0
    shorter = min(np.ptp(own), np.ptp(time))
    return float(overlap / shorter) if shorter > 0 else 1.0


def _why(own: Array, time: Array) -> str:
    """What would make the two clocks meet."""
    unit = _unit(own, time)
    if unit is not None:
        return f"truth's time seems to be in {unit}, not s"
    if _shared(own, time) > 0:
        return "they hardly meet"
    days = np.round((own[0] - time[0]) / DAY_S)
    if days and _shared(own, time + days * DAY_S) > 0.5:
        return f"they would on another day ({days:+.0f} d)"
    if _shared(own - own[0], time - time[0]) > 0.5:
        return "their clocks begin at different times, or it is another run's"
    return "it is another run's, or the clocks differ"


def _unit(own: Array, time: Array) -> str | None:
    """The unit in which truth would span what the result does, and when."""
    for unit, factor in UNITS_S.items():
        alike = 0.7 < np.ptp(time) * factor / max(float(np.ptp(own)), 1e-9) < 1.4
        if alike and _shared(own, time * factor) > 0.5:
            return unit
    return None


def _middle(frame: "DataFrame") -> Array:
    return np.asarray(np.median(_places(frame), axis=0))


def _places(frame: "DataFrame") -> Array:
    return np.asarray(frame[["lat", "lon"]].to_numpy(dtype=np.float64))


def _apart(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max())
