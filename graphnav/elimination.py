"""Blocks to a GTSAM Gaussian factor graph, its elimination by QR, steps and covariances.

Nodes are eliminated in time order, each calibration vector after the last node it acts on: the
separators stay at one node and one calibration vector, so cost is linear in the run's length, and
covariances follow by one backward pass over the Bayes net. QR because Cholesky breaks on
navigation-grade weights (design fact 3).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg.lapack import dtrtri

from factors.block import NODE_DIM, Block, Index
from graphnav.errors import SolutionError
from graphnav.run import Array


@dataclass(frozen=True)
class Chain:
    """Numbers of nodes and segments and the order in which they are eliminated."""

    nodes: int
    segments: int
    calibration_dim: int
    segment_of_interval: Index  # (N - 1,)

    def ordering(self) -> gtsam.Ordering:
        """x_0 x_1 ... c_0 x_10 ...: every c after the first node of the next segment's interval."""
        ordering = gtsam.Ordering()
        first = np.searchsorted(self.segment_of_interval, np.arange(self.segments + 1))
        for k in range(self.segments):
            end = first[k + 1] if k + 1 < self.segments else self.nodes
            for i in range(first[k], end):
                ordering.push_back(gtsam.symbol("x", int(i)))
            ordering.push_back(gtsam.symbol("c", k))
        return ordering


def eliminate(blocks: Sequence[Block], chain: Chain) -> gtsam.GaussianBayesNet:
    """Square-root form of all blocks; raises SolutionError when a state is not determined."""
    graph = gtsam.GaussianFactorGraph()
    for block in blocks:
        for factor in block.jacobian_factors():
            graph.add(factor)
    try:
        return graph.eliminateSequential(chain.ordering(), gtsam.EliminateQR)
    except RuntimeError as error:
        where = str(error).partition("Symbol: ")[2].partition(")")[0]
        raise SolutionError(
            f"the sensors leave the solution undetermined near state {where or '?'}"
        ) from error


def step(bayes_net: gtsam.GaussianBayesNet, chain: Chain) -> tuple[Array, Array]:
    """Error states of all nodes (N, 10) and segments (K, dim) that minimise the linear system."""
    delta = bayes_net.optimize()
    nodes = np.array([delta.at(gtsam.symbol("x", i)) for i in range(chain.nodes)])
    segments = np.array([delta.at(gtsam.symbol("c", k)) for k in range(chain.segments)])
    return nodes, segments


@dataclass(frozen=True)
class Covariances:
    """Marginal covariances of every state; nodes in their error coordinates."""

    nodes: Array  # (N, 10, 10)
    calibration: Array  # (K, dim, dim)


def covariances(bayes_net: gtsam.GaussianBayesNet, chain: Chain) -> Covariances:
    """All marginal covariances in one backward pass, linear in the number of states.

    For `R x = d - S y`: `P_xx = (R^T R)^-1 + G P_yy G^T`, `P_xy = G P_yy`, `G = -R^-1 S`.
    """
    nodes = np.empty((chain.nodes, NODE_DIM, NODE_DIM))
    calibration = np.empty((chain.segments, chain.calibration_dim, chain.calibration_dim))
    first_segment = gtsam.symbol("c", 0)
    first_node = gtsam.symbol("x", 0)
    is_node = lambda key: key >= first_node  # noqa: E731  'x' sorts after 'c'
    joint, place = np.empty((0, 0)), {}
    for k in range(bayes_net.size() - 1, -1, -1):
        conditional = bayes_net.at(k)
        keys = list(conditional.keys())
        R, S = conditional.R(), conditional.S()
        inverse = dtrtri(R)[0]
        own = inverse @ inverse.T
        if len(keys) > 1:
            columns = np.concatenate([place[key] for key in keys[1:]])
            P_yy = joint[np.ix_(columns, columns)]
            G = -inverse @ S
            P_xy = G @ P_yy
            own = own + P_xy @ G.T
            joint = np.block([[own, P_xy], [P_xy.T, P_yy]])
        else:
            joint = own
        place = {}
        at = 0
        for key in keys:
            width = NODE_DIM if is_node(key) else chain.calibration_dim
            place[key] = np.arange(at, at + width)
            at += width
        if is_node(keys[0]):
            nodes[keys[0] - first_node] = own
        else:
            calibration[keys[0] - first_segment] = own
    return Covariances(nodes, calibration)
