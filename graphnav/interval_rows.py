"""All rows of a block list gathered by the interval they end with: one linear factor each."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from factors import so3
from factors.block import NODE_DIM, ROTATION, Block, Index
from factors.weights import Robust
from graphnav.run import Array


@dataclass(frozen=True)
class Rows:
    """Whitened rows `A_i dx_i + A_j dx_j + A_c dc = b` of W consecutive intervals."""

    A_i: Array  # (W, r, 10)
    A_j: Array  # (W, r, 10)
    A_c: Array  # (W, r, dim)
    b: Array  # (W, r)
    robust: tuple[tuple[slice, Robust], ...] = ()  # rows that may be down-weighted, and how

    def at(self, intervals: slice) -> "Rows":
        """Some of the intervals."""
        A_i, A_j, A_c, b = (x[intervals] for x in (self.A_i, self.A_j, self.A_c, self.b))
        return Rows(A_i, A_j, A_c, b, self.robust)

    def weighted(self, residual: Array) -> "Rows":
        """Robust rows scaled by the root of their weight at whitened residuals (W, r)."""
        root = np.ones_like(self.b)
        for on, robust in self.robust:
            root[:, on] = np.sqrt(robust.weight(residual[:, on]))
        A_i, A_j, A_c = (A * root[:, :, None] for A in (self.A_i, self.A_j, self.A_c))
        return Rows(A_i, A_j, A_c, self.b * root, self.robust)

    def predicted(self, x: Array, c: Array) -> Array:
        """Residuals of one interval (1, r) with node i at `x` (10,), calibration at `c` (dim,) and
        node j where the inertial rows, the first nine, put it.
        """
        r = self.A_i[0] @ x + self.A_c[0] @ c - self.b[0]
        ahead = np.linalg.solve(self.A_j[0, :9, :9], -r[:9])
        return np.asarray(r + self.A_j[0, :, :9] @ ahead)[None]

    def in_base(self, x: Array, c: Array) -> "Rows":
        """Told as error states about the base, linearised at `x` (W + 1, 10) and `c` (W, dim)."""
        Jr = so3.right_jacobian(x[:, ROTATION])
        A_i, A_j = self.A_i.copy(), self.A_j.copy()
        A_i[:, :, ROTATION] = A_i[:, :, ROTATION] @ Jr[:-1]
        A_j[:, :, ROTATION] = A_j[:, :, ROTATION] @ Jr[1:]
        b = self.b + so3.mv(A_i, x[:-1]) + so3.mv(A_j, x[1:]) + so3.mv(self.A_c, c)
        return Rows(A_i, A_j, self.A_c, b, self.robust)

    def factors(self, first: int, segment: Index, unit_c: Array) -> list[gtsam.JacobianFactor]:
        """One factor per interval; the first starts at node `first`, `segment` (W,).

        `unit_c` (dim,) what 1 is in the tree's calibration errors.
        """
        said = (self.A_i != 0).any(2) | (self.A_j != 0).any(2)
        node, unit = gtsam.symbol("x", first), gtsam.noiseModel.Unit.Create
        in_unit, out = self.A_c * unit_c, []
        for k, (keep, c) in enumerate(zip(said, segment, strict=True)):
            A_i, A_j, A_c, b = (
                self.A_i[k][keep],
                self.A_j[k][keep],
                in_unit[k][keep],
                self.b[k][keep],
            )
            key = gtsam.symbol("c", int(c))
            i = node + k
            out.append(gtsam.JacobianFactor(i, A_i, i + 1, A_j, key, A_c, b, unit(len(b))))
        return out


def stacked(
    blocks: Iterable[Block],
    intervals: int,
    dim: int,
    begins: bool,
    robust: Mapping[str, Robust],
) -> Rows:
    """Rows of all blocks over a window of nodes numbered from 0, gathered by interval.

    A row belongs to the interval that ends at its later node. Rows on node 0 alone belong to the
    interval before the window and are left out, or to the first when the run `begins` here; those
    on calibrations alone are left out. The inertial rows come first.
    """
    parts: list[tuple[Array, Array, Array, Array]] = []
    doubted, filled = [], 0
    for block in sorted(blocks, key=lambda b: b.kind != "inertial"):
        nodes = [term.index for term in block.terms if term.family == "x"]
        if not nodes or not len(block.time):
            continue
        owner = np.max(nodes, axis=0) - 1
        sets = _spread(block, owner, np.flatnonzero(owner >= 0), intervals, dim)
        if begins:
            sets += _spread(block, owner * 0, np.flatnonzero(owner < 0), intervals, dim)
        rows = len(sets) * block.residual.shape[1]
        if block.robust and block.kind in robust:
            doubted.append((slice(filled, filled + rows), robust[block.kind]))
        parts, filled = parts + sets, filled + rows
    A_i, A_j, A_c, b = (np.concatenate(column, axis=1) for column in zip(*parts, strict=True))
    return Rows(A_i, A_j, A_c, b, tuple(doubted))


def _spread(
    block: Block, owner: Index, on: Index, intervals: int, dim: int
) -> list[tuple[Array, Array, Array, Array]]:
    """Some factors of a block at their intervals; several sets where an interval has several."""
    rows, out = block.residual.shape[1], []
    while len(on):
        took, first = np.unique(owner[on], return_index=True)
        now = on[first]
        A = [np.zeros((intervals, rows, d)) for d in (NODE_DIM, NODE_DIM, dim)]
        b = np.zeros((intervals, rows))
        b[took] = -block.residual[now]
        for term in block.terms:
            side = 2 if term.family == "c" else int(term.index[now[0]] - took[0])
            A[side][took] += term.jacobian[now]
        out.append((A[0], A[1], A[2], b))
        on = np.delete(on, first)
    return out
