"""Satellite fixes in the graph: carried to their true time, with what they have in common."""

import numpy as np

from factors import kinds, so3
from factors.block import Index, Scope
from factors.calibration import GNSS_DELAY, Layout
from factors.estimate import Estimate
from factors.position import AXES, Carried, Fixes, position
from factors.preintegration import Increments, Preintegrated, corrected, interval_of_increment
from graphnav.common.run import Array, Gnss
from graphnav.graph.densify import inside_intervals
from graphnav.graph.nodes import Nodes
from graphnav.graph.noise import Parts, Scales, parts
from graphnav.graph.preparation import Setup
from graphnav.graph.round import Factor, Round, with_noise

NODE_SLACK_S = 0.03  # after a node a fix still belongs before it: nodes stand on increments' edges
NEAR_S = 0.02  # between the delay and that which fixes are carried with
REACH_S = 0.3  # before the first node or after the last: a fix further out is left out
FIX_SD = 0.002  # m, no receiver is better


def satellite_fixes(round_: Round, at_standstill: Index) -> tuple[Factor, Parts]:
    """All fixes in use, carried with the delay of the round; with what their errors are sums of."""
    prep, nodes, pre, at = round_.prep, round_.nodes, round_.pre, round_.at
    gnss, setup = prep.sensed.gnss, prep.setup
    assert gnss is not None
    delay = carried_with(setup, at)
    time = gnss.time + setup.fix_delay - delay
    on, scope = between(nodes, time)
    carried = carry(prep.sensed.inc, pre, nodes, scope)
    held = np.isin(scope.node, at_standstill)
    for x, level in ((carried.swing, 0), (carried.surge, 0), (carried.turn, np.eye(3))):
        x[held] = level
    carried.rate[held] = 0
    noise = fix_noise(gnss.sd_enu[on], round_.scales)
    fixes = Fixes(prep.sensed.fixes_n[on], noise.sigma, carried, delay)
    return with_noise(noise, lambda x: position(fixes, setup.layout, scope, x)), noise


def fixes_on_smooth_path(gnss: Gnss, fixes_n: Array, layout: Layout, nodes: Nodes) -> Factor:
    """Fixes (F, 3) m in n carried by the nodes alone, where no increments tell more."""
    on, scope = between(nodes, gnss.time)
    T, steady = np.diff(nodes.time)[scope.node], np.zeros((len(on), 3))
    share = (scope.time - nodes.time[scope.node]) / T
    turn = np.broadcast_to(np.eye(3), (len(on), 3, 3))
    carried = Carried(T, share, steady, steady, turn, steady)
    fixes = Fixes(fixes_n[on], fix_noise(gnss.sd_enu[on], {}).sigma, carried, 0.0)
    return lambda x: [position(fixes, layout, scope, x)]


def fix_noise(sd_enu: Array, scales: Scales) -> Parts:
    """What the errors of fixes are sums of, whose receiver told (F, 3) m."""
    stated = {"told": np.maximum(sd_enu, FIX_SD)}
    return parts(kinds.GNSS, np.full(len(sd_enu), ""), AXES, stated, scales)


def carried_with(setup: Setup, at: Estimate) -> float:
    """The delay [s] to carry fixes with: that of an estimate, unless the one taken off beforehand
    is as good; so that it seldom changes and a stream's fixes stay in their intervals.
    """
    if GNSS_DELAY not in setup.layout.slices:
        return setup.fix_delay
    delay = float(np.median(at.calibration[:, setup.layout.column(GNSS_DELAY)]))
    return delay if abs(delay - setup.fix_delay) > NEAR_S else setup.fix_delay


def between(nodes: Nodes, time: Array) -> tuple[Index, Scope]:
    """Which of the times (n,) s nodes enclose, and what factors there act on."""
    reach = nodes.time[0] - REACH_S, nodes.time[-1] + REACH_S
    on = np.flatnonzero((time > reach[0]) & (time < reach[1]))
    node = np.searchsorted(nodes.time + NODE_SLACK_S, time[on]) - 1
    node = np.clip(node, 0, len(nodes.time) - 2)
    return on, Scope(node, nodes.segment[node], time[on])


def carry(inc: Increments, pre: Preintegrated, nodes: Nodes, scope: Scope) -> Carried:
    """What carries the path from the nodes of a scope to its times, felt by the increments."""
    node, time = scope.node, scope.time
    T = pre.T[node]
    s = (time - nodes.time[node]) / T
    k = np.searchsorted(inc.edge, time, side="right") - 1
    k = np.clip(k, nodes.edge[node], nodes.edge[node + 1] - 1)
    own, inside, V, P = (x[k] for x in inside_intervals(inc, pre, nodes.edge))
    dt = (inc.edge[k + 1] - inc.edge[k])[:, None]
    part = (time - inc.edge[k])[:, None] / dt  # of the increment
    V, P = V - own, P - (V - own) * dt - inside  # at its start
    P = P + V * part * dt + part * part * inside
    V = V + part * own
    rise, slope = s * s * (3 - 2 * s), T * s * s * (s - 1)
    rotation = corrected(inc, pre.errors[interval_of_increment(nodes.edge)]).rotation[k]
    return Carried(
        T=T,
        share=s,
        swing=P - rise[:, None] * pre.dp[node] - slope[:, None] * pre.dv[node],
        surge=V - s[:, None] * pre.dv[node],
        turn=pre.C[k] @ so3.exp(part * rotation),
        rate=rotation / dt,
    )
