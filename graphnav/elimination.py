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


JOINTS = 800  # intervals whose joint covariance is kept


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


Joints = dict[int, Array]  # node i -> covariance of [x_i, x_{i+1}, c of the interval]


@dataclass(frozen=True)
class Covariances:
    """Marginal covariances of every state; nodes in their error coordinates."""

    nodes: Array  # (N, 10, 10)
    calibration: Array  # (K, dim, dim)
    joints: Joints  # of about `JOINTS` intervals spread over the run


def covariances(bayes_net: gtsam.GaussianBayesNet, chain: Chain) -> Covariances:
    """All marginal covariances in one backward pass, linear in the number of states.

    For `R x = d - S y`: `P_xx = (R^T R)^-1 + G P_yy G^T`, `P_xy = G P_yy`, `G = -R^-1 S`.
    """
    nodes = np.empty((chain.nodes, NODE_DIM, NODE_DIM))
    calibration = np.empty((chain.segments, chain.calibration_dim, chain.calibration_dim))
    joints: Joints = {}
    stride = max(1, chain.nodes // JOINTS)
    first_x, first_c = gtsam.symbol("x", 0), gtsam.symbol("c", 0)
    joint, place = np.empty((0, 0)), dict[int, Array]()
    for k in range(bayes_net.size() - 1, -1, -1):
        conditional = bayes_net.at(k)
        keys = list(conditional.keys())
        joint = _extended(joint, place, conditional, keys[1:])
        widths = [NODE_DIM if key >= first_x else chain.calibration_dim for key in keys]
        ends = np.cumsum(widths)
        place = {
            key: np.arange(end - width, end)
            for key, end, width in zip(keys, ends, widths, strict=True)
        }
        own = joint[: widths[0], : widths[0]]
        if keys[0] < first_x:
            calibration[keys[0] - first_c] = own
            continue
        i = keys[0] - first_x
        nodes[i] = own
        if i % stride == 0 and len(keys) == 3:
            order = np.concatenate([place[key] for key in sorted(keys, key=lambda q: (q < first_x, q))])
            joints[i] = joint[np.ix_(order, order)]
    return Covariances(nodes, calibration, joints)


def _extended(
    joint: Array, place: dict[int, Array], conditional: gtsam.GaussianConditional, parents: list[int]
) -> Array:
    """Joint covariance of one conditional's variable and its parents, parents taken from `joint`."""
    inverse = dtrtri(conditional.R())[0]
    own = inverse @ inverse.T
    if not parents:
        return own
    columns = np.concatenate([place[key] for key in parents])
    P_yy = joint[np.ix_(columns, columns)]
    G = -inverse @ conditional.S()
    P_xy = G @ P_yy
    size = len(own)
    out = np.empty((size + len(columns), size + len(columns)))
    out[:size, :size] = own + P_xy @ G.T
    out[:size, size:], out[size:, :size], out[size:, size:] = P_xy, P_xy.T, P_yy
    return out
