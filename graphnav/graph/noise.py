"""How noisy the data really are: variance components and correlation found in the residuals.

The variance of every row is a sum of parts, each known up to a factor: what the data sheet says,
the share of the vibration that survives, what a bend or a change of speed adds. With whitened
residuals r, their redundancies `1 - diag(J P J^T)` (the share of its own noise a residual keeps
after the fit) and the variances q_0 assumed so far, the factor of each part a is multiplied, until
nothing changes, by

    sum(r^2 q_0 / q^2 da) / sum(redundancy / q da),    q = sum of parts

(Foerstner's variance components, for sums of variances in the multiplicative form of Fevotte,
Bertin & Durrieu 2009). What was assumed is a wide log-normal prior (`PRIOR_LOG_SD`). A residual
counts `CLIPPED` sigma at most (Huber's second proposal: by weights that redescend a sigma would
shrink until all that does not fit is doubted).

Errors that last longer than an interval are not averaged away: a row's sigma is its spread times
the root of the long-run over the short-run variance of its kind. Weights see the spread alone (D3).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from factors.block import NODE_DIM, Block
from graphnav.common.run import Array
from graphnav.graph.elimination import Joints

Scales = Mapping[str, float]  # noise found in the data over noise assumed, by "kind:state:axis..."
States = NDArray[np.str_]

PRIOR_LOG_SD = np.log(10.0**2)  # of a variance: a sheet's sigma is right within a factor of ten
FURTHER = 1.5  # a round's step over the plain one, which creeps where redundancy is small
DAMPING = 0.3  # redundancies that slow a step no residual supports
CLIPPED = 3.0  # sigma
SETTLING = 30  # multiplicative steps
LEAST, MOST = 1e-3, 1e3  # of the assumed sigma: from a navigation grade to MEMS and back
# a receiver's own sigma is evidence too: a poor fit must not talk the fixes away, nor fixes that it
# has smoothed promise more than it does
LIMITS = {
    kinds.GNSS: (1.0, 3.0),
    # no ground is as even and no running gear as true as a simulated one
    kinds.DISPLACEMENT: (0.01, 100.0),
    kinds.VELOCITY: (0.01, 100.0),
    kinds.TRACK_WIDTH: (0.3, 100.0),
}
# s over which the residuals of a kind may be correlated; an IMU's slow errors are its biases
LAGS_S = {
    kinds.DISPLACEMENT: 20.0,
    kinds.VELOCITY: 20.0,
    kinds.TRACK_WIDTH: 20.0,
    kinds.GNSS: 60.0,
}
ENOUGH = 30  # residuals that show a correlation
CORRELATION = "correlation"


@dataclass(frozen=True)
class Parts:
    """What the variance of a block's rows is the sum of, as found so far."""

    state: States  # (n,) what the factors are found apart for
    axes: tuple[str, ...]
    parts: Mapping[str, Array]  # (n, r) each, in squared units of the row
    fixed: Array  # (n, r) the same, of what is not to be learnt: gaps, rows that say nothing
    inflation: Array  # (n, r) sigma over spread: errors that last
    begin: Mapping[str, float]  # factors of parts not found yet, where not 1

    @property
    def sigma(self) -> Array:
        """(n, r)"""
        return np.sqrt(sum(self.parts.values(), self.fixed)) * self.inflation


def key(kind: str, state: str, axis: str, part: str) -> str:
    """Name of a factor among the scales."""
    return f"{kind}:{state}:{axis}:{part}"


def parts(
    kind: str,
    state: States,
    axes: tuple[str, ...],
    assumed: Mapping[str, Array],
    scales: Scales,
    *,
    fixed: Array | float = 0.0,
    begin: Mapping[str, float] | None = None,
) -> Parts:
    """The variances of a block's rows: sigmas `assumed` (n, r) times the factors found so far, or
    `begin` (1) where none has been found, and sigmas `fixed` beside them.
    """
    begin = begin or {}
    names, which = np.unique(state, return_inverse=True)

    def of(part: str, otherwise: float) -> Array:
        table = [[scales.get(key(kind, s, a, part), otherwise) for a in axes] for s in names]
        return np.array(table, dtype=np.float64).reshape(-1, len(axes))[which]

    found = {part: (sigma * of(part, begin.get(part, 1.0))) ** 2 for part, sigma in assumed.items()}
    held = np.broadcast_to(np.square(fixed), (len(state), len(axes)))
    return Parts(state, axes, found, held, of(CORRELATION, 1.0), begin)


def rescaled(
    scales: Scales, blocks: list[Block], known: Mapping[str, Parts], joints: Joints
) -> dict[str, float]:
    """The scales of the next round, from the residuals of this one; `known` by block kind."""
    found = dict(scales)
    for block in blocks:
        if block.kind in known and len(block.time):
            found |= _found(scales, block, known[block.kind], _redundancy(block, joints))
    return found


def _found(scales: Scales, block: Block, known: Parts, redundancy: Array) -> dict[str, float]:
    """Factors of one kind of block, from the redundancies (n, r) of its rows (NaN: not known)."""
    out: dict[str, float] = {}
    lags = _lags(block)
    low, high = LIMITS.get(block.kind, (LEAST, MOST))
    for state in np.unique(known.state):
        mine = known.state == state
        for row, axis in enumerate(known.axes):
            spread = block.residual[mine, row] * known.inflation[mine, row]
            seen = np.isfinite(redundancy[mine, row])
            red = np.clip(redundancy[mine, row][seen], 1e-6, 1.0)
            begin = {n: p[mine, row][seen] for n, p in known.parts.items() if p[mine, row].any()}
            was = {
                name: scales.get(key(block.kind, state, axis, name), known.begin.get(name, 1.0))
                for name in begin
            }
            fixed = known.fixed[mine, row][seen]
            gains = _factors(spread[seen] ** 2, red, begin, fixed, was)
            now = {n: float(np.clip(was[n] * gains[n] ** (FURTHER / 2), low, high)) for n in begin}
            if lags and len(spread) >= ENOUGH and now:
                lasting = float(np.sqrt(correlation(_clipped(spread), lags)))
                now[CORRELATION] = max(1.0, min(lasting, high / max(now.values())))
            out |= {key(block.kind, state, axis, name): value for name, value in now.items()}
    return out


def _factors(
    r2: Array, red: Array, begin: Mapping[str, Array], fixed: Array, was: Mapping[str, float]
) -> dict[str, float]:
    """By how much each part of the variance is to be multiplied, all having been multiplied by
    `was`^2 already.
    """
    q_0 = sum(begin.values(), fixed)
    times = dict.fromkeys(begin, 1.0)
    for _ in range(SETTLING):
        q = sum((times[name] * begin[name] for name in begin), fixed)
        surprise = np.minimum(r2 * q_0 / q, CLIPPED**2 * red)
        for name, part in begin.items():
            share = times[name] * part / q
            # twice the gradient of the log-likelihood and of the log-prior, by log of the factor
            off = 2 * np.log(times[name] * was[name] ** 2) / PRIOR_LOG_SD**2
            found = float(share @ surprise) + max(-off, 0.0) + DAMPING
            times[name] *= found / (float(share @ red) + max(off, 0.0) + DAMPING)
    return times


def _clipped(r: Array) -> Array:
    """Residuals about their median, at most three spreads from it."""
    spread = 1.4826 * float(np.median(np.abs(r - np.median(r)))) + 1e-9
    return np.clip((r - np.median(r)) / spread, -CLIPPED, CLIPPED)


def _lags(block: Block) -> int:
    """How many of its factors a block's residuals may be correlated over; 0 where none."""
    if block.kind not in LAGS_S:
        return 0
    spacing = float(np.median(np.diff(block.time))) if len(block.time) > 1 else 1.0
    return max(1, round(LAGS_S[block.kind] / max(spacing, 1e-3)))


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
