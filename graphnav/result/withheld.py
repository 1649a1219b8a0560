"""Fixes withheld in turn: how far the path was off at them against what it had promised."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from factors import kinds, so3
from factors.block import Index
from graphnav.common.run import Array
from graphnav.result import trajectory
from graphnav.result.solved import Solved

LEAST_KEPT_S = 30.0  # of fixes between two blocks, so that the path has found back
SETTLING_S = 60.0  # of fixes at the start that are always kept: the heading comes from them
DOUBTED = 0.5  # weight under which the whole solution does not believe a fix
INSIDE_95 = 5.991  # chi-square of two degrees of freedom
HONEST = (0.8, 1.25)  # promised over found


@dataclass(frozen=True)
class Promise:
    """Blocks of one length: horizontal, rms over the withheld fixes."""

    block_s: float
    blocks: int
    fixes: int
    found_m: float
    worst_m: float
    promised_m: float  # path and fix together
    path_m: float  # of it the path's own
    inside_95: float  # share of the fixes in their 95 % ellipse

    @property
    def promised_over_found(self) -> float:
        """1 is honest; below, the deviations promise too much."""
        return self.promised_m / self.found_m

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"promised_over_found": self.promised_over_found}


@dataclass(frozen=True)
class Believed:
    """Fixes the whole solution believes, with the deviations found in them: those they tell, times
    what makes them those of fix and path, so that a receiver's caution is no merit of the path."""

    time: Array  # (n,) s
    p_n: Array  # (n, 3) m
    sd_en: Array  # (n, 2) m
    doubted: int  # how many it does not


def blocks(time: Array, length: float) -> list[tuple[float, float]]:
    """Spans of `length` s to withhold, from fix times (n,) s, about as much kept between them.

    None that holds no fix, nor any in the first and last `SETTLING_S` of fixes.
    """
    first, last = float(time[0]) + SETTLING_S, float(time[-1]) - LEAST_KEPT_S
    starts = np.arange(first, last - length, length + max(length, LEAST_KEPT_S))
    held = [(float(a), float(a + length)) for a in starts]
    return [(a, b) for a, b in held if np.any((time >= a) & (time <= b))]


def believed(whole: Solved) -> Believed:
    """The fixes of the whole solution with weights of at least a half, east and north."""
    assert whole.run.gnss is not None
    own = whole.run.gnss.time
    for block, weight in zip(whole.blocks, whole.weights, strict=True):
        if block.kind == kinds.GNSS and block.sigma is not None and len(block.time):
            at = _nearest(own, block.time + delay(whole))
            on = (weight[:, :2] > DOUBTED).all(axis=1)
            # what lasts is in the path; a single fix strays by its spread
            spread = block.sigma if block.inflation is None else block.sigma / block.inflation
            off = (block.residual * block.sigma)[on, :2]
            found = np.sqrt(np.sum(off**2, axis=0) / np.sum(spread[on, :2] ** 2, axis=0))
            sd = spread[on, :2] * found
            return Believed(own[at[on]], whole.fixes_n[at[on]], sd, int((~on).sum()))
    return Believed(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 2)), 0)


def _nearest(own: Array, time: Array) -> Index:
    """Which of the times `own` (m,) is nearest to each of some times (n,)."""
    after = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
    return np.asarray(after - (time - own[after - 1] < own[after] - time))


def promise(
    without: Solved, fixes: Believed, held: list[tuple[float, float]], length: float
) -> Promise | None:
    """Hold the fixes in the blocks `held` against the path `without` them; None when none is."""
    inside = np.zeros(len(fixes.time), bool)
    for start, end in held:
        inside |= (fixes.time >= start) & (fixes.time <= end)
    time = fixes.time[inside] - delay(without)
    table = trajectory.table(without, 10.0)
    clock = table["time"] - without.run.clock_start
    inside[inside] = on = (time >= clock[0]) & (time <= clock[-1])
    if not on.any():
        return None
    off = (_antenna(without, time[on]) - fixes.p_n[inside])[:, :2]
    sd = {k: np.interp(time[on], clock, table[k]) for k in ("sd_e", "sd_n", "corr_en")}
    path = np.stack([sd["sd_e"], sd["sd_n"]], -1)
    P = np.einsum("ni,ij->nij", path**2 + fixes.sd_en[inside] ** 2, np.eye(2))
    P[:, 0, 1] = P[:, 1, 0] = sd["corr_en"] * path[:, 0] * path[:, 1]
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(P), off)
    return Promise(
        block_s=length,
        blocks=len(held),
        fixes=int(on.sum()),
        found_m=_rms(off),
        worst_m=float(np.linalg.norm(off, axis=1).max()),
        promised_m=float(np.sqrt(np.mean(np.trace(P, axis1=1, axis2=2)))),
        path_m=_rms(path),
        inside_95=float(np.mean(squared < INSIDE_95)),
    )


def in_words(promises: list[Promise]) -> str:
    """One line about all block lengths."""
    ratios = [p.promised_over_found for p in promises]
    last = promises[-1]
    found = (
        f"with fixes withheld for {promises[0].block_s:g} to {last.block_s:g} s the path was off "
        f"by {promises[0].found_m:.2g} to {last.found_m:.2g} m rms, and had promised "
        f"{promises[0].promised_m:.2g} to {last.promised_m:.2g} m"
    )
    if min(ratios) < HONEST[0]:
        return f"{found}: its deviations promise too much (by {1 / min(ratios):.2g} times)"
    if max(ratios) > HONEST[1]:
        return f"{found}: its deviations are too careful (by {max(ratios):.2g} times)"
    return f"{found}: its deviations are honest"


def delay(solved: Solved) -> float:
    """How late the fixes come, s, where that was found."""
    return float(_last(solved, "gnss_time_offset_s", np.zeros(1))[0])


def _antenna(solved: Solved, time: Array) -> Array:
    """Where fixes would lie at times (n,) s: the antenna, with what they have in common, (n, 3)."""
    R_nb, _, p_n = solved.path.at(time)
    lever_b = _last(solved, "antenna_lever_arm_m", np.zeros(3))
    common = next((c for c in solved.calibrated if c.name == "gnss_offset_m"), None)
    offset_n = np.zeros(3)
    if common is not None:
        offset_n = np.stack([np.interp(time, common.time, x) for x in common.value.T], -1)
    return np.asarray(p_n + so3.mv(R_nb, lever_b) + offset_n)


def _last(solved: Solved, name: str, otherwise: Array) -> Array:
    """A calibration's last value."""
    return next((c.value[-1] for c in solved.calibrated if c.name == name), otherwise)


def _rms(x: Array) -> float:
    """Root mean square length of vectors (n, d)."""
    return float(np.sqrt(np.mean(np.sum(x**2, axis=1))))
