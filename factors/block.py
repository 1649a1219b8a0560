"""All occurrences of one factor, linearised together: the vectorised face of a factor."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROTATION, VELOCITY, POSITION, PHASE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10)
MOTION = slice(0, 9)  # rotation, velocity and position together
NODE_DIM = 10


@dataclass(frozen=True)
class Scope:
    """The variables that n factors of one kind act on, and when."""

    node: Index  # (n,) the node, or the first of the two
    segment: Index  # (n,) calibration segment in force
    time: Array  # (n,) s, at the node, or at the second of the two

    def of(self, on: Index) -> "Scope":
        """That of some of the factors."""
        return Scope(self.node[on], self.segment[on], self.time[on])


@dataclass(frozen=True)
class Term:
    """Jacobian of a block with respect to one variable of each occurrence."""

    family: str  # "x": nodes, "c": calibration segments
    index: Index  # (n,) which node or segment
    jacobian: Array  # (n, r, d), whitened


@dataclass(frozen=True)
class Block:
    """`n` factors of one kind: whitened residuals and Jacobians.

    The cost is `0.5 sum(weight * residual^2)`; `residual(x + d) ~ residual + sum(jacobian d)`.
    """

    kind: str
    axes: tuple[str, ...]  # names of the r rows
    time: Array  # (n,) s, when each factor acts (its end)
    residual: Array  # (n, r), whitened
    terms: tuple[Term, ...]
    robust: bool = False  # whether its rows may be down-weighted
    sigma: Array | None = None  # (n, r), what a whitened residual of 1 is in the factor's unit
    inflation: Array | None = None  # (n, r), sigma over the errors' spread, where errors last

    @property
    def standardised(self) -> Array:
        """Residuals in units of their errors' spread, (n, r): what robust weights see (D3)."""
        return self.residual if self.inflation is None else self.residual * self.inflation

    def weighted(self, weight: Array) -> "Block":
        """The same block with every row scaled by the root of its weight (n, r)."""
        if not self.robust:
            return self
        root = np.sqrt(weight)
        terms = tuple(replace(t, jacobian=t.jacobian * root[:, :, None]) for t in self.terms)
        return replace(self, residual=self.residual * root, terms=terms)

    def change(self, nodes: Array, segments: Array) -> Array:
        """First-order change of the residual under error states (N, 10) and (K, dim), (n, r)."""
        delta = {"x": nodes, "c": segments}
        moved = [np.einsum("nrd,nd->nr", t.jacobian, delta[t.family][t.index]) for t in self.terms]
        return np.asarray(sum(moved))

    def jacobian_factors(self) -> Iterator[gtsam.JacobianFactor]:
        """One `gtsam.JacobianFactor` per occurrence, A d = -residual."""
        unit = gtsam.noiseModel.Unit.Create(self.residual.shape[1])
        b = -self.residual
        keys = [[gtsam.symbol(t.family, int(k)) for k in t.index] for t in self.terms]
        A = [t.jacobian for t in self.terms]
        if len(A) == 1:
            yield from (
                gtsam.JacobianFactor(*row, unit) for row in zip(keys[0], A[0], b, strict=True)
            )
        elif len(A) == 2:
            rows2 = zip(keys[0], A[0], keys[1], A[1], b, strict=True)
            yield from (gtsam.JacobianFactor(*row, unit) for row in rows2)
        else:
            third = zip(keys[2], A[2], strict=True)
            rows3 = zip(keys[0], A[0], keys[1], A[1], third, b, strict=True)
            yield from (
                gtsam.JacobianFactor(i, A_i, j, A_j, k, A_k, b_k, unit)
                for i, A_i, j, A_j, (k, A_k), b_k in rows3
            )


def between(scope: Scope, J_i: Array, J_j: Array, J_c: Array) -> tuple[Term, Term, Term]:
    """Jacobians with respect to a node, the node after it and the calibrations."""
    return (
        Term("x", scope.node, J_i),
        Term("x", scope.node + 1, J_j),
        Term("c", scope.segment, J_c),
    )


def whitened(
    kind: str,
    axes: tuple[str, ...],
    time: Array,
    residual: Array,
    sigma: Array,
    terms: tuple[Term, ...],
) -> Block:
    """A robust block from residuals and Jacobians still in the factor's unit; `sigma` (n, r)."""
    white = 1 / sigma
    scaled = tuple(replace(t, jacobian=t.jacobian * white[:, :, None]) for t in terms)
    return Block(kind, axes, time, residual * white, scaled, robust=True, sigma=sigma)
