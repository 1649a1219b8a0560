"""A trajectory against truth: accuracy, honesty of its own deviations, states."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graphnav.common.angles import wrapped
from graphnav.common.earth import Origin
from graphnav.result.truth_fit import check_fit

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]
Words = NDArray[np.str_]

ELLIPSE_95 = 5.991  # chi-square, 2 degrees of freedom
LINE_95 = 3.841  # and 1
BOUNDARY_S = 1.0  # a state is not counted this near to a change of the true state


@dataclass(frozen=True)
class Comparison:
    """Errors at truth's own times, result interpolated; None where truth or result is silent.

    NEES is the mean squared error over its own covariance: 2 is ideal for a horizontal position, 1
    for a heading; more says the deviations promise too much. `inside_95` is the share of errors in
    their own 95 % ellipse (interval).
    """

    horizontal_rms_m: float
    horizontal_max_m: float
    horizontal_end_m: float
    permille_of_distance: float | None  # 1000 * horizontal_max_m / distance_m
    distance_m: float  # along the truth
    heading_rms_deg: float | None
    height_rms_m: float
    velocity_rms_m_s: float | None  # norm of the three components
    share_of_truth_matched: float
    nees_horizontal: float | None
    nees_horizontal_inside_95: float | None
    nees_heading: float | None
    nees_heading_inside_95: float | None
    state_accuracy: float | None  # over time further than 1 s from a true change
    state_f1: dict[str, float] | None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for summary.json."""
        return asdict(self)


def compare(trajectory: "DataFrame", truth: "DataFrame") -> Comparison:
    """Compare a trajectory table with a truth table (columns of interface.md).

    Metres are local, in the ENU frame at the first truth point. Raises `InputError` when the two
    cannot be compared (`check_fit`).
    """
    check_fit(trajectory, truth)
    time = _column(truth, "time")
    own = _column(trajectory, "time")
    inside = (time >= own[0]) & (time <= own[-1])
    pair = _Pair(trajectory, truth[inside], own, time[inside])
    error = pair.position_error(_origin(truth))
    horizontal = np.hypot(error[:, 0], error[:, 1])
    distance = _distance(truth[inside], time[inside], _origin(truth))
    heading = pair.heading_error()
    position_nees, heading_nees = pair.position_nees(error), pair.heading_nees(heading)
    accuracy, f1 = pair.states()
    worst = float(horizontal.max())
    return Comparison(
        horizontal_rms_m=_rms(horizontal),
        horizontal_max_m=worst,
        horizontal_end_m=float(horizontal[-1]),
        permille_of_distance=1000 * worst / distance if distance > 0 else None,
        distance_m=distance,
        heading_rms_deg=_rms_or_none(heading),
        height_rms_m=_rms(error[:, 2]),
        velocity_rms_m_s=_rms_or_none(pair.velocity_error()),
        share_of_truth_matched=float(inside.mean()),
        nees_horizontal=_mean(position_nees),
        nees_horizontal_inside_95=_share_below(ELLIPSE_95, position_nees),
        nees_heading=_mean(heading_nees),
        nees_heading_inside_95=_share_below(LINE_95, heading_nees),
        state_accuracy=accuracy,
        state_f1=f1,
    )


@dataclass(frozen=True)
class _Pair:
    """A trajectory and the truth rows inside it."""

    trajectory: "DataFrame"
    truth: "DataFrame"
    own: Array  # (N,) s, trajectory
    time: Array  # (K,) s, truth

    def at_truth(self, values: Array) -> Array:
        """Trajectory values (N,) at the truth's times (K,)."""
        return np.interp(self.time, self.own, values)

    def known(self, *names: str) -> bool:
        """Whether truth knows these columns."""
        return all(name in self.truth and bool(self.truth[name].notna().any()) for name in names)

    def position_error(self, origin: Origin) -> Array:
        """Result minus truth, local east, north, up (K, 3) m."""
        p_n = _local(self.trajectory, origin)
        return np.stack([self.at_truth(column) for column in p_n.T], -1) - _local(
            self.truth, origin
        )

    def velocity_error(self) -> Array | None:
        """Norm of the velocity error (K,) m/s."""
        names = ("v_e", "v_n", "v_u")
        if not self.known(*names):
            return None
        each = [self.at_truth(_column(self.trajectory, v)) - _column(self.truth, v) for v in names]
        return np.asarray(np.linalg.norm(each, axis=0))

    def heading_error(self) -> Array | None:
        """Result minus truth (K,) deg, within half a turn."""
        if not self.known("heading_deg"):
            return None
        turned = np.unwrap(_column(self.trajectory, "heading_deg"), period=360.0)
        error = self.at_truth(turned) - _column(self.truth, "heading_deg")
        return wrapped(error, 360.0)

    def position_nees(self, error: Array) -> Array | None:
        """Squared horizontal error over its covariance (K,), 2 in the mean when honest."""
        if not {"sd_e", "sd_n"} <= set(self.trajectory):
            return None
        sd_e, sd_n = (self.at_truth(_column(self.trajectory, name)) for name in ("sd_e", "sd_n"))
        has = "corr_en" in self.trajectory
        r = self.at_truth(_column(self.trajectory, "corr_en")) if has else np.zeros_like(sd_e)
        e, n = error[:, 0] / sd_e, error[:, 1] / sd_n
        return np.asarray((e * e - 2 * r * e * n + n * n) / np.maximum(1 - r * r, 1e-9))

    def heading_nees(self, error: Array | None) -> Array | None:
        """Squared heading error over its variance (K,), 1 in the mean when honest."""
        if error is None or "sd_heading_deg" not in self.trajectory:
            return None
        return (error / self.at_truth(_column(self.trajectory, "sd_heading_deg"))) ** 2

    def states(self) -> tuple[float | None, dict[str, float] | None]:
        """Accuracy and F1 by state over truth rows away from a change."""
        if "state" not in self.truth or "state" not in self.trajectory:
            return None, None
        true: Words = self.truth["state"].to_numpy(dtype=str)
        row = np.clip(np.searchsorted(self.own, self.time), 1, len(self.own) - 1)
        row -= self.time - self.own[row - 1] < self.own[row] - self.time
        said: Words = self.trajectory["state"].to_numpy(dtype=str)[row]
        count = (true != "") & ~_near_change(true, self.time)
        if not count.any():
            return None, None
        true, said = true[count], said[count]
        names = sorted({*true, *said})
        return float((true == said).mean()), {str(name): _f1(true, said, name) for name in names}


def _near_change(state: Words, time: Array) -> NDArray[np.bool_]:
    change = np.flatnonzero(state[1:] != state[:-1])
    if not len(change):
        return np.zeros(len(time), bool)
    at = (time[change] + time[change + 1]) / 2
    next_ = np.clip(np.searchsorted(at, time), 0, len(at) - 1)
    gap = np.minimum(np.abs(time - at[next_]), np.abs(time - at[np.maximum(next_ - 1, 0)]))
    return np.asarray(gap < BOUNDARY_S)


def _f1(true: Words, said: Words, name: str) -> float:
    hit = int(((true == name) & (said == name)).sum())
    return 2 * hit / int((true == name).sum() + (said == name).sum())


def _column(table: "DataFrame", name: str) -> Array:
    return np.asarray(table[name].to_numpy(dtype=np.float64))


def _origin(truth: "DataFrame") -> Origin:
    lat, lon, height = (float(_column(truth, name)[0]) for name in ("lat", "lon", "height"))
    return Origin(np.deg2rad(lat), np.deg2rad(lon), height)


def _local(table: "DataFrame", origin: Origin) -> Array:
    lat, lon = np.deg2rad(_column(table, "lat")), np.deg2rad(_column(table, "lon"))
    return origin.local(lat, lon, _column(table, "height"))


def _distance(truth: "DataFrame", time: Array, origin: Origin) -> float:
    """Length of the truth in steps of a second, so that its noise at rest adds little."""
    once = np.unique(np.floor(time - time[0]), return_index=True)[1]
    return float(np.linalg.norm(np.diff(_local(truth, origin)[once], axis=0), axis=1).sum())


def _rms(error: Array) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def _rms_or_none(error: Array | None) -> float | None:
    return None if error is None or np.isnan(error).all() else _rms(error)


def _mean(values: Array | None) -> float | None:
    """Mean over the values that exist; None without any."""
    if values is None or not np.isfinite(values).any():
        return None
    return float(values[np.isfinite(values)].mean())


def _share_below(limit: float, values: Array | None) -> float | None:
    return None if values is None else _mean(np.where(np.isfinite(values), values < limit, np.nan))
