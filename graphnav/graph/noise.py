"""How noisy the data really are: variance components and correlation found in the residuals.

A factor's assumed sigma is multiplied by `sqrt(var(residual) / redundancy * correlation)`: the
variance is robust (median absolute deviation), the redundancy `1 - diag(J P J^T)` is the share of
its own noise a residual keeps after the fit (Foerstner's variance component estimate), and the
correlation is the long-run over the short-run variance, because a white model of a correlated error
would average it away and promise too much.
"""

from collections.abc import Iterator

import numpy as np

from factors import kinds
from factors.block import NODE_DIM, Block
from graphnav.common.run import Array
from graphnav.graph.elimination import Joints

ENOUGH = 30  # residuals that make a group
LEAST_REDUNDANCY = 0.05
SMALLEST, LARGEST = 0.02, 30.0
# a receiver's own sigma is evidence too: a poor fit must not talk the fixes away, nor fixes that it
# has smoothed promise more than it does
LIMITS = {kinds.GNSS: (1.0, 3.0)}
# s over which the residuals of a kind may be correlated
LAGS_S = {kinds.DISPLACEMENT: 20.0, kinds.VELOCITY: 20.0, kinds.TRACK_WIDTH: 20.0, kinds.GNSS: 60.0}


def rescaled(
    scales: dict[str, float], blocks: list[Block], groups: dict[str, np.ndarray], joints: Joints
) -> dict[str, float]:
    """The scales of the next round, from the residuals of this one.

    `groups` names the state of every row of a block kind ("" where states do not matter); keys of
    the result are "kind:state:axis".
    """
    found = dict(scales)
    for block in blocks:
        if block.kind not in LAGS_S or block.kind not in groups:
            continue
        names = groups[block.kind]
        lags = _lags(block)
        redundancy = _redundancy(block, joints)
        for state in np.unique(names):
            for row, axis in enumerate(block.axes):
                r, red = block.residual[names == state, row], redundancy[names == state, row]
                red = red[np.isfinite(red)]
                key = f"{block.kind}:{state}:{axis}"
                if len(r) >= ENOUGH and len(red) and red.mean() > LEAST_REDUNDANCY:
                    grown = _scale(r, float(red.mean()), lags)
                    low, high = LIMITS.get(block.kind, (SMALLEST, LARGEST))
                    found[key] = float(np.clip(grown * scales.get(key, 1.0), low, high))
    return found


def _lags(block: Block) -> int:
    """How many of its factors a block's residuals may be correlated over."""
    spacing = float(np.median(np.diff(block.time))) if len(block.time) > 1 else 1.0
    return max(1, round(LAGS_S[block.kind] / max(spacing, 1e-3)))


def _scale(r: Array, redundancy: float, lags: int) -> float:
    """Factor on the assumed sigma."""
    spread = 1.4826 * float(np.median(np.abs(r - np.median(r)))) + 1e-9
    clipped = np.clip((r - np.median(r)) / spread, -3, 3)
    return float(spread * np.sqrt(correlation(clipped, lags) / redundancy))


def correlation(x: Array, lags: int) -> float:
    """Long-run over short-run variance of a series (Bartlett window), at least 1."""
    n = len(x)
    lags = min(lags, n // 4)
    x = x - x.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(x, size)) ** 2
    auto = np.fft.irfft(spectrum, size)[: lags + 1] / n
    taper = 1 - np.arange(1, lags + 1) / (lags + 1)
    ratio = 1 + 2 * np.sum(taper * auto[1:]) / max(auto[0], 1e-12)
    return float(np.clip(ratio, 1.0, lags + 1))


def _redundancy(block: Block, joints: Joints) -> Array:
    """`1 - diag(J P J^T)` of the rows whose interval has a joint covariance, else NaN, (n, r)."""
    n, r = block.residual.shape
    out = np.full((n, r), np.nan)
    for k, joint in _sampled(block, joints):
        J = np.zeros((r, joint.shape[0]))
        base = block.terms[0].index[k]
        for term in block.terms:
            at = 2 * NODE_DIM if term.family == "c" else (term.index[k] - base) * NODE_DIM
            J[:, at : at + term.jacobian.shape[2]] += term.jacobian[k]
        out[k] = 1 - np.einsum("ij,jk,ik->i", J, joint, J)
    return out


def _sampled(block: Block, joints: Joints) -> Iterator[tuple[int, Array]]:
    """Rows of a block that begin at a sampled node, with that interval's joint covariance."""
    for k, node in enumerate(block.terms[0].index):
        if int(node) in joints:
            yield k, joints[int(node)]
