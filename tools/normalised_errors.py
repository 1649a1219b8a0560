"""Errors over their own deviations, and how many independent samples they are worth."""

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from graphnav.common.earth import Origin

Array = NDArray[np.float64]
LONGEST_LAG = 0.5  # of the run
HARDEST = 9.8  # m/s^2, of true velocities that a vehicle can have
ZERO = 1e-9  # deviations below tell nothing: the quantity is held


def normalised(table: DataFrame, truth: DataFrame, origin: Origin) -> dict[str, Array]:
    """position (n, 2), velocity (n, 2), heading (n, 1) once a second, as far as both sides know.

    `table` has the columns of trajectory.parquet, e n u in the frame of `origin`.
    """
    time = truth["time"].to_numpy()
    inside = (time >= table["time"].iloc[0]) & (time <= table["time"].iloc[-1])
    first = np.unique(np.floor(time[inside]), return_index=True)[1]
    at = truth[inside].iloc[first]

    def own(name: str) -> Array:
        return np.asarray(np.interp(at["time"], table["time"], table[name]))

    lla = np.deg2rad(at["lat"]), np.deg2rad(at["lon"]), at["height"]
    true_n = origin.local(*(np.asarray(x) for x in lla))
    found = {
        "position": [(own(k) - x) / own(f"sd_{k}") for k, x in zip("en", true_n.T[:2], strict=True)]
    }
    if "v_e" in at and "sd_v_e" in table:
        smooth = _smooth(truth)[inside][first]
        errors = [(own(f"v_{k}") - at[f"v_{k}"]) / own(f"sd_v_{k}") for k in "en"]
        found["velocity"] = [np.asarray(error)[smooth] for error in errors]
    if "heading_deg" in at and "sd_heading_deg" in table:
        turned = np.interp(at["time"], table["time"], np.unwrap(table["heading_deg"], period=360))
        off = (turned - at["heading_deg"].to_numpy() + 180) % 360 - 180
        sd = own("sd_heading_deg")
        found["heading"] = [off[sd > ZERO] / sd[sd > ZERO]]
    return {kind: np.stack(parts, -1) for kind, parts in found.items()}


def _smooth(truth: DataFrame) -> NDArray[np.bool_]:
    """Where the true velocity (K,) does not jump: simulated wheels of the laboratory lock at once,
    and no row or increment is as short as that."""
    rate = np.abs(np.diff(truth[["v_e", "v_n"]], axis=0)).max(1) / np.diff(truth["time"])
    jumps = np.concatenate([[False], rate > HARDEST, [False]])
    near = np.convolve(jumps, np.ones(5), "same") > 0
    return np.asarray(~(near[1:] | near[:-1]))


def independent(errors: Array) -> float:
    """Samples (n, k) that are worth as much if they were independent, at least 1.

    The squares of a process correlate as the square of its autocorrelation.
    """
    n = len(errors)
    auto = np.zeros(round(LONGEST_LAG * n))
    for column in errors.T:
        spectrum = np.abs(np.fft.rfft(column, 2 * n)) ** 2
        each = np.fft.irfft(spectrum)[: len(auto)] / np.arange(n, n - len(auto), -1)
        auto += each / each[0] / errors.shape[1]
    first = int(np.argmax(auto < 0)) or len(auto)
    return float(max(n / (1 + 2 * np.sum(auto[1:first] ** 2)), 1.0))
