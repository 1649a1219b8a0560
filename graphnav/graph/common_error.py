"""What neighbouring fixes have in common: errors correlated over minutes, found in the residuals.

Orbits, atmosphere, multipath about a standing antenna and a receiver's own smoothing do not average
out from fix to fix. They are a first-order Gauss-Markov process (Source: Gelb 1974, Applied Optimal
Estimation, 3.6), whose deviation and time constant are found by laying `A exp(-h / tau)` on the
autocovariance of fix minus path, taken of means over calibration segments. In the first round the
process is a wide one: a path that had bent to fixes that are dragged along would not show it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from factors.block import Block, Index
from factors.calibration import GNSS_OFFSET, Component, Layout
from factors.estimate import Estimate
from factors.position import AXES
from graphnav.common.run import Array
from graphnav.graph.nodes import SEGMENT_S

KEY, MEMORY = "gnss_common", "gnss_common::memory"
FIRST_SHARE = 10.0  # of the deviation assumed, in the first round
ASSUMED = {f"{KEY}::{axis}": 1.0 for axis in AXES}
# shares of the deviation assumed; a larger one would talk good fixes away (a car on a ferry)
SMALLEST, LARGEST = 0.05, 10.0
MEMORIES_S = (20.0, 40.0, 80.0, 160.0, 320.0, 640.0)
ENOUGH, LONGEST = 20, 0.5  # segments that tell; lags looked at, of their number
OUTLYING = 3.0  # usual deviations of the white part
SURE = 2.0  # deviations by which a correlation must stand out of the noise
# A process as large as assumed is believed as it is found. A larger one may be the path's own
# error: it must stand far out of the path's variance, and is then kept while it stands out
UNASKED, OUTSTANDING, STILL_OUT = 1.0, 9.0, 2.0


def common_layout(layout: Layout, scales: Mapping[str, float]) -> Layout:
    """The layout with the process found so far; at first a wide one."""

    def found(c: Component) -> Component:
        if c.name != GNSS_OFFSET:
            return c
        return replace(c, sd=c.sd * _shares(scales), memory=scales.get(MEMORY, c.memory))

    return Layout(tuple(found(c) for c in layout.components))


def found_common(
    blocks: list[Block], layout: Layout, at: Estimate, path: Array, scales: Mapping[str, float]
) -> dict[str, float]:
    """The process by axis, as shares of the deviation in `layout`, and its memory [s].

    `path` (3,) m^2 the usual variance of a position, `scales` what was found before.
    """
    fixes = [b for b in blocks if b.kind == kinds.GNSS and len(b.time)]
    if not fixes or GNSS_OFFSET not in layout.slices:
        return {}
    seen = _Errors.of(fixes[0], layout, at)
    if len(seen.number) < ENOUGH:
        return ASSUMED
    variance, memory = _fitted(seen)
    share = np.sqrt(variance) / layout.prior_sd[layout.slices[GNSS_OFFSET]]
    before = _shares(scales)
    need = np.where(before == FIRST_SHARE, OUTSTANDING, STILL_OUT)
    need = np.where(before > UNASKED, need, np.inf)
    doubtful = (share > UNASKED) & (variance < need * path)
    share = np.clip(np.where(doubtful, 1.0, share), SMALLEST, LARGEST)
    found = {f"{KEY}::{axis}": float(x) for axis, x in zip(AXES, share, strict=True)}
    return found if doubtful.any() else found | {MEMORY: memory}


def _shares(scales: Mapping[str, float]) -> Array:
    return np.array([scales.get(f"{KEY}::{axis}", FIRST_SHARE) for axis in AXES])


@dataclass(frozen=True)
class _Errors:
    """Means of fix minus path by segment."""

    mean: Array  # (S, 3) m
    number: Index  # (S,) of the segment

    @staticmethod
    def of(block: Block, layout: Layout, at: Estimate) -> "_Errors":
        """From the residuals of the fixes; outliers of the white part left out."""
        assert block.sigma is not None
        segment = block.terms[-1].index
        error = at.calibration[segment][:, layout.slices[GNSS_OFFSET]]
        error = error - block.residual * block.sigma
        spread = 1.4826 * np.median(np.abs(block.residual - np.median(block.residual, 0)), 0)
        good = np.abs(block.residual) < OUTLYING * np.maximum(spread, 1.0)
        number, of = np.unique(segment, return_inverse=True)
        mean = [_means(x, g, of) for x, g in zip(error.T, good.T, strict=True)]
        return _Errors(np.stack(mean, -1), number)


def _means(x: Array, good: NDArray[np.bool_], of: Index) -> Array:
    """Means of the good ones of x (n,) by segment `of` each; 0 where there are none, (S,)."""
    total = np.bincount(of, np.where(good, x, 0.0))
    return np.asarray(total / np.maximum(np.bincount(of, good), 1))


def _fitted(seen: _Errors) -> tuple[Array, float]:
    """Variance by axis (3,) m^2, 0 where no correlation is sure, and time constant [s]."""
    size = int(seen.number[-1] - seen.number[0]) + 1
    lag = np.arange(1, max(2, int(LONGEST * size)))
    C, pairs = _autocovariance(seen, size, lag)
    noise = seen.mean.var(axis=0) + 1e-12
    best, most, tau = np.zeros(3), 0.0, MEMORIES_S[-1]
    for memory in MEMORIES_S:
        rho = np.exp(-lag * SEGMENT_S / memory)[:, None]
        power = (pairs * rho * rho).sum(0)
        A = (pairs * rho * C).sum(0) / power
        sure = A * np.sqrt(power) / noise
        gained = float((np.maximum(sure[:2], 0.0) ** 2).sum())
        if gained > most:
            best, most, tau = np.where(sure > SURE, np.maximum(A, 0.0), 0.0), gained, memory
    return best, tau


def _autocovariance(seen: _Errors, size: int, lag: Index) -> tuple[Array, Array]:
    """By lag and axis (L, 3), and of how many pairs each (L, 1)."""
    full, there = np.zeros((size, 3)), np.zeros((size, 1))
    full[seen.number - seen.number[0]], there[seen.number - seen.number[0]] = seen.mean, 1.0
    padded = 1 << (2 * size - 1).bit_length()

    def summed(x: Array) -> Array:
        power = np.abs(np.fft.rfft(x, padded, axis=0)) ** 2
        return np.asarray(np.fft.irfft(power, padded, axis=0)[lag])

    pairs = np.maximum(np.round(summed(there)), 1e-9)
    return summed(full) / np.maximum(pairs, 1.0), pairs
