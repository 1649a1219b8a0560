"""Samples that a test of `screening` may name, whatever the window it looks at: one pass over all.

Each condition here is necessary for a test there and asks little of what lies around a sample, so a
stream that judges frame by frame leaves the tests out where no sample is suspected.
"""

import numpy as np
from scipy.ndimage import maximum_filter1d

from graphnav.common.run import Array
from graphnav.inertial.gaps import Mask
from graphnav.inertial.screening import (
    ABSURD,
    BLOCK,
    LONGEST,
    REPEATS,
    REPEATS_S,
    STEP,
)

BEFORE = LONGEST + 1  # samples before one that is named which may have made it so


def suspects(x: Array, step: float, behind: int, reach: int) -> Mask:
    """Which samples of six channels (N, 6), `step` s apart, a test may name, (N,).

    In any window that begins at a multiple of `BLOCK` samples from the first, at least `behind`
    before what is judged, and is no longer than `reach` samples.
    """
    out: Mask = np.asarray(~(np.abs(x) < np.repeat(ABSURD, 3)).all(axis=1))
    x = x[:, np.ptp(x, axis=0) != 0]  # an axis that was not recorded tells nothing
    if not x.shape[1]:
        return out
    moved = np.abs(np.diff(x, axis=0))
    step_here = _large(moved)
    out[1:] |= step_here
    out[:-1] |= step_here
    out[1:] |= _repeats(moved == 0, max(REPEATS, round(REPEATS_S / step)))
    for side in (x, -x):
        out |= _tops(side, behind, reach)
    return out


def _large(moved: Array) -> Mask:
    """Steps (n, k) beyond any that is usual, (n,): where a spike may begin or end.

    Usual is the median of a block at least, or of the one before where the window ends in it.
    """
    whole = len(moved) // BLOCK
    if not whole:
        return np.ones(len(moved), bool)
    median = np.median(moved[: whole * BLOCK].reshape(whole, BLOCK, -1), axis=1)
    before = np.concatenate([median[:1], median])
    least = np.minimum(np.concatenate([median, median[-1:]]), before)
    quantum = np.min(moved, axis=0, where=moved > 0, initial=np.inf)
    far = moved > STEP * np.repeat(least + quantum, BLOCK, axis=0)[: len(moved)]
    return np.asarray(far.any(axis=1))


def _repeats(same: Mask, least: int) -> Mask:
    """Repeats (n, k) in all channels, or in one for so many samples, (n,)."""
    out: Mask = np.asarray(same.all(axis=1))
    count = np.concatenate([np.zeros((1, same.shape[1]), int), np.cumsum(same, axis=0)])
    long = (count[least:] - count[:-least] == least).any(axis=1)
    for k in range(least if long.any() else 0):
        out[k : k + len(long)] |= long
    return out


def _tops(x: Array, behind: int, reach: int) -> Mask:
    """Samples (N,) that equal the largest value of a window (N, k) once more."""
    out = np.zeros(len(x), bool)
    lately, ever = (
        maximum_filter1d(x, n, axis=0, origin=(n - 1) // 2, mode="nearest") for n in (behind, reach)
    )
    at, k = np.nonzero((x[1:] >= lately[1:]) & (x[1:] <= ever[:-1]))
    at += 1
    window = np.maximum(at[:, None] - np.arange(1, reach + 1), 0)
    out[at] |= (x[window, k[:, None]] == x[at, k][:, None]).any(axis=1)
    return out
