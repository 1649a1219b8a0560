"""From nodes to every increment edge: inertial motion between nodes, hitting the nodes exactly."""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.block import Index
from factors.estimate import Estimate
from factors.preintegration import Increments, Preintegrated, corrected, interval_of_increment
from graphnav.common.earth import Origin
from graphnav.common.run import Array
from graphnav.graph.nodes import Nodes


@dataclass(frozen=True)
class Path:
    """Motion at increment edges in n."""

    time: Array  # (M + 1,) s
    R_nb: Array  # (M + 1, 3, 3)
    v_n: Array  # (M + 1, 3) m/s
    p_n: Array  # (M + 1, 3) m

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Attitude, velocity, position at any times (n,) s: Hermite between edges."""
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        T = self.time[k + 1] - self.time[k]
        s = ((time - self.time[k]) / T)[:, None]
        turn = so3.log(so3.transpose(self.R_nb[k]) @ self.R_nb[k + 1])
        v_i, v_j = self.v_n[k], self.v_n[k + 1]
        p_i, p_j = self.p_n[k], self.p_n[k + 1]
        a, b = s * s * (3 - 2 * s), s * (1 - s)
        p = p_i + a * (p_j - p_i) + T[:, None] * b * ((1 - s) * v_i - s * v_j)
        return self.R_nb[k] @ so3.exp(s * turn), v_i + s * (v_j - v_i), p


def densify(
    inc: Increments, pre: Preintegrated, nodes: Nodes, estimate: Estimate, origin: Origin
) -> Path:
    """Integrate the increments from each node; what is missing at the next node is spread smoothly.

    The rotation gap grows linearly over the interval, position and velocity by the cubic that
    starts from rest and ends with the gap's velocity.
    """
    owner = interval_of_increment(nodes.edge)
    t = (inc.edge[1:] - nodes.time[:-1][owner])[:, None]
    R, v, p = _integrated(inc, pre, nodes, estimate, origin)

    ends = nodes.edge[1:]
    gap_R = so3.log(so3.transpose(R[ends - 1]) @ estimate.R_nb[1:])[owner]
    gap_v = (estimate.v_n[1:] - v[ends - 1])[owner]
    gap_p = (estimate.p_n[1:] - p[ends - 1])[owner]
    T = pre.T[owner][:, None]
    s = t / T
    rise, slope = s * s * (3 - 2 * s), s * s * (s - 1)
    rise_v, slope_v = 6 * s * (1 - s) / T, s * (3 * s - 2)
    return Path(
        time=inc.edge,
        R_nb=np.concatenate([estimate.R_nb[:1], R @ so3.exp(s * gap_R)]),
        v_n=np.concatenate([estimate.v_n[:1], v + rise_v * gap_p + slope_v * gap_v]),
        p_n=np.concatenate([estimate.p_n[:1], p + rise * gap_p + slope * T * gap_v]),
    )


def _integrated(
    inc: Increments, pre: Preintegrated, nodes: Nodes, estimate: Estimate, origin: Origin
) -> tuple[Array, Array, Array]:
    """Attitude, velocity and position at the end of every increment (M, ...), from the node before
    it (the equations of `factors.inertial`).
    """
    owner = interval_of_increment(nodes.edge)
    _, _, V, P = inside_intervals(inc, pre, nodes.edge)
    C = pre.C[1:].copy()  # at the end of each increment
    C[nodes.edge[1:] - 1] = pre.dR

    t = (inc.edge[1:] - nodes.time[:-1][owner])[:, None]
    R_i, v_i, p_i = estimate.R_nb[owner], estimate.v_n[owner], estimate.p_n[owner]
    Omega = origin.Omega_n
    g = origin.gravity(0.5 * (estimate.p_n[:-1] + estimate.p_n[1:]))[owner]
    a_n, s_n = so3.mv(R_i, V), so3.mv(R_i, P)
    reach = v_i * t + s_n + 0.5 * g * t * t
    v = v_i + a_n - so3.cross(Omega, t * a_n - s_n) + g * t - 2 * so3.cross(Omega, reach)
    p = (
        p_i
        + reach
        - so3.cross(Omega, s_n) * t / 3
        - so3.cross(Omega, v_i * t * t + (v - v_i) * t * t / 3)
    )
    return so3.exp(-Omega * t) @ R_i @ C, v, p


def inside_intervals(
    inc: Increments, pre: Preintegrated, nodes: Index
) -> tuple[Array, Array, Array, Array]:
    """Specific force integrated since the node before, in its body frame, (M, 3) each: every
    increment's own velocity and position, and both summed at the increment's end.
    """
    owner = interval_of_increment(nodes)
    dt = np.diff(inc.edge)[:, None]
    true = corrected(inc, pre.errors[owner])
    own = so3.mv(pre.C[:-1], true.velocity)
    inside = so3.mv(pre.C[:-1], true.position)
    V = _running(own, nodes, owner)
    return own, inside, V, _running((V - own) * dt + inside, nodes, owner)


def _running(x: Array, edge: Index, owner: Index) -> Array:
    """Running sums (inclusive) that start anew at every node, (M, 3)."""
    total = np.cumsum(x, 0)
    before = (total - x)[edge[:-1]]
    return total - before[owner]
