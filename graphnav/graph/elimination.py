"""Blocks to a GTSAM Gaussian factor graph, its elimination by QR, steps and covariances.

Nodes are eliminated in time order, each calibration vector after the last node it acts on: the
separators stay at one node and one calibration vector, so cost is linear in the run's length, and
covariances follow by one backward pass over the Bayes net. Cholesky can break on navigation-grade
weights (design fact 3): it serves for steps on the way, QR for the last one and the covariances.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np
from scipy.linalg.lapack import dtrtri

from factors.block import NODE_DIM, Block, Index
from graphnav.common.errors import SolutionError
from graphnav.common.run import Array
from graphnav.graph.assembly import stacked

JOINTS = 800  # intervals whose joint covariance is kept


@dataclass(frozen=True)
class EliminationOrder:
    """Numbers of nodes and segments and the order in which they are eliminated."""

    nodes: int
    segments: int
    calibration_dim: int
    segment_of_interval: Index  # (N - 1,)

    @cached_property
    def x(self) -> list[int]:
        """GTSAM's keys of the nodes."""
        first = gtsam.symbol("x", 0)
        return list(range(first, first + self.nodes))

    @cached_property
    def c(self) -> list[int]:
        """GTSAM's keys of the calibration segments."""
        first = gtsam.symbol("c", 0)
        return list(range(first, first + self.segments))

    @cached_property
    def ordering(self) -> gtsam.Ordering:
        """x_0 ... x_9 c_0 x_10 ...: every c after the last node whose interval it acts on."""
        ordering = gtsam.Ordering()
        first = np.searchsorted(self.segment_of_interval, np.arange(self.segments + 1))
        first[-1] = self.nodes
        for k in range(self.segments):
            for key in self.x[first[k] : first[k + 1]]:
                ordering.push_back(key)
            ordering.push_back(self.c[k])
        return ordering


def linear_system(blocks: Sequence[Block], order: EliminationOrder) -> gtsam.GaussianFactorGraph:
    """All blocks as one Gaussian factor graph."""
    graph = gtsam.GaussianFactorGraph()
    for block in blocks:
        if len(block.time) and block.terms[0].family == "c":
            for factor in block.jacobian_factors():
                graph.add(factor)
    rows = stacked(blocks, order.segment_of_interval, order.calibration_dim)
    for factor in rows.factors(order.x, [order.c[k] for k in order.segment_of_interval.tolist()]):
        graph.add(factor)
    return graph


def quickly(
    graph: gtsam.GaussianFactorGraph, order: EliminationOrder
) -> gtsam.GaussianBayesNet | None:
    """Elimination by Cholesky, three times as fast as QR; None where it breaks down.

    It saves 6 to 36 % of the time of all rounds (slip, tracked, wheeled, comma2k19), but squares
    the condition number: good enough for a step whose cost is checked and for the noise of an early
    round, not for the covariances a user reads.
    """
    try:
        return graph.eliminateSequential(order.ordering)
    except RuntimeError:
        return None


class Undetermined(SolutionError):
    """The sensors do not determine a variable: node ("x") or segment ("c") number `index`."""

    def __init__(self, family: str, index: int) -> None:
        super().__init__(f"the sensors leave the solution undetermined near state {family}{index}")
        self.family, self.index = family, index


def eliminate(graph: gtsam.GaussianFactorGraph, order: EliminationOrder) -> gtsam.GaussianBayesNet:
    """Square-root form by QR; raises Undetermined when a state is not determined."""
    try:
        return graph.eliminateSequential(order.ordering, gtsam.EliminateQR)
    except RuntimeError as error:
        raise _undetermined(error) from error


def _undetermined(error: RuntimeError) -> Undetermined:
    named = re.search(r"Symbol: ([xc])(\d+)", str(error))
    return Undetermined(named[1] if named else "?", int(named[2]) if named else -1)


def step(bayes_net: gtsam.GaussianBayesNet, order: EliminationOrder) -> tuple[Array, Array]:
    """Error states of all nodes (N, 10) and segments (K, dim) that minimise the linear system.

    Raises Undetermined where the system is singular to working precision.
    """
    try:
        solved = bayes_net.optimize()
    except RuntimeError as error:
        raise _undetermined(error) from error
    flat = solved.vector()  # in the order of the keys: 'c' before 'x'
    split = order.segments * order.calibration_dim
    return flat[split:].reshape(-1, NODE_DIM), flat[:split].reshape(order.segments, -1)


Joints = dict[int, Array]  # node i -> covariance of [x_i, x_{i+1}, c of the interval]


@dataclass(frozen=True)
class Covariances:
    """Marginal covariances of every state; nodes in their error coordinates."""

    nodes: Array  # (N, 10, 10)
    calibration: Array  # (K, dim, dim)
    joints: Joints  # of about `JOINTS` intervals spread over the run


def covariances(bayes_net: gtsam.GaussianBayesNet, order: EliminationOrder) -> Covariances:
    """All marginal covariances in one backward pass, linear in the number of states.

    For `R x = d - S y`: `P_xx = (R^T R)^-1 + G P_yy G^T`, `P_xy = G P_yy`, `G = -R^-1 S`. The
    parents of a variable all belong to the clique visited just before it.
    """
    dim = order.calibration_dim
    nodes = np.empty((order.nodes, NODE_DIM, NODE_DIM))
    calibration = np.empty((order.segments, dim, dim))
    joints: Joints = {}
    stride = max(1, order.nodes // JOINTS)
    first_x, first_c = order.x[0], order.c[0]
    joint, place = np.empty((0, 0)), dict[int, slice]()
    for k in range(bayes_net.size() - 1, -1, -1):
        conditional = bayes_net.at(k)
        keys = conditional.keys()
        joint = _extended(joint, [place[key] for key in keys[1:]], conditional)
        end, place = 0, {}
        for key in keys:
            begin, end = end, end + (NODE_DIM if key >= first_x else dim)
            place[key] = slice(begin, end)
        own = joint[place[keys[0]], place[keys[0]]]
        i = keys[0] - first_x
        if i < 0:
            calibration[keys[0] - first_c] = own
            continue
        nodes[i] = own
        if i % stride == 0 and len(keys) == 3:
            ordered = [keys[0], *sorted(keys[1:], reverse=True)]  # x_i, x_i+1, c
            at = np.concatenate([np.arange(place[q].start, place[q].stop) for q in ordered])
            joints[i] = joint[at[:, None], at]
    return Covariances(nodes, calibration, joints)


def _extended(joint: Array, parents: list[slice], conditional: gtsam.GaussianConditional) -> Array:
    """Joint covariance of a conditional's variable and its parents, these taken from `joint`."""
    inverse = dtrtri(conditional.R())[0]
    if not parents:
        return np.asarray(inverse @ inverse.T)
    size = len(inverse)
    total = size + sum(p.stop - p.start for p in parents)
    out = np.empty((total, total))
    at = size
    ends = []
    for parent in parents:
        ends.append((slice(at, at + parent.stop - parent.start), parent))
        at += parent.stop - parent.start
    for rows, parent in ends:
        for columns, other in ends:
            out[rows, columns] = joint[parent, other]
    G = inverse @ conditional.S()
    P_xy = -(G @ out[size:, size:])
    out[:size, size:], out[size:, :size] = P_xy, P_xy.T
    out[:size, :size] = inverse @ inverse.T - P_xy @ G.T
    return out
