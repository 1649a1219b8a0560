"""The chain of calibration vectors: what is in it, its prior and its random walk.

Everything that is constant or slow (biases, scale factor, mounting, lever arm, delay, ground) is one
vector per segment of some ten seconds; neighbouring vectors are tied by a random walk whose density
says how constant each component is. One uniform chain keeps batch and incremental smoothing linear
in the run's length (design fact 6).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from factors.block import Block, Index, Term

Array = NDArray[np.float64]

GYRO_BIAS, ACCEL_BIAS = slice(0, 3), slice(3, 6)
CONSTANT = 1e-6  # of its prior sd: how far a constant may wander in one second


@dataclass(frozen=True)
class Component:
    """One calibrated quantity; `walk` is None for a constant."""

    name: str
    prior: Array  # (d,)
    sd: Array  # (d,) one sigma of the prior
    walk: float | None = None  # per sqrt(s), in the component's unit


@dataclass(frozen=True)
class Layout:
    """Where each component stands in the calibration vector."""

    components: tuple[Component, ...]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Columns of each component."""
        ends = np.cumsum([len(c.prior) for c in self.components])
        starts = [0, *ends[:-1]]
        return {
            c.name: slice(int(a), int(b))
            for c, a, b in zip(self.components, starts, ends, strict=True)
        }

    @property
    def dim(self) -> int:
        """Length of the calibration vector."""
        return sum(len(c.prior) for c in self.components)

    @cached_property
    def prior(self) -> Array:
        """(dim,)"""
        return np.concatenate([c.prior for c in self.components])

    @cached_property
    def prior_sd(self) -> Array:
        """(dim,)"""
        return np.concatenate([c.sd for c in self.components])

    @cached_property
    def walk(self) -> Array:
        """(dim,) random-walk density per sqrt(s)."""
        return np.concatenate(
            [CONSTANT * c.sd if c.walk is None else np.full(len(c.prior), c.walk) for c in self.components]
        )

    def column(self, name: str, offset: int = 0) -> int:
        """First column of a component, or -1 when the layout has none of that name."""
        return self.slices[name].start + offset if name in self.slices else -1


def prior(layout: Layout, calibration: Array) -> Block:
    """The first segment at its prior: `(c_0 - prior) / sd`, `dim` rows."""
    d = layout.dim
    residual = (calibration[:1] - layout.prior) / layout.prior_sd
    jacobian = np.diag(1 / layout.prior_sd)[None]
    axes = tuple(str(k) for k in range(d))
    term = Term("c", np.zeros(1, np.int64), jacobian)
    return Block("calibration_prior", axes, np.zeros(1), residual, (term,))


def walk(layout: Layout, calibration: Array, time: Array) -> Block:
    """Random walk between segments (B6): `(c_{k+1} - c_k) / (walk sqrt(dt))`.

    `calibration` (K, dim), `time` (K,) s, the middles of the segments. Marked robust: a heavy-tailed
    step lets a puncture be a step instead of a smear.
    """
    K, d = calibration.shape
    inverse = 1 / (layout.walk * np.sqrt(np.diff(time))[:, None])  # (K - 1, dim)
    eye = np.eye(d)[None] * inverse[:, :, None]
    index: Index = np.arange(K - 1)
    return Block(
        kind="calibration_walk",
        axes=tuple(str(k) for k in range(d)),
        time=time[1:],
        residual=np.diff(calibration, axis=0) * inverse,
        terms=(Term("c", index, -eye), Term("c", index + 1, eye)),
        robust=True,
    )
