"""Where the smoother's nodes stand: 1 Hz, and wherever something happens."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import cached_property
from math import floor

import numpy as np
from numpy.typing import NDArray

from factors.block import Index, Scope
from graphnav.common.run import Array

INTERVAL_S = 1.0  # between nodes, unless told otherwise
FIX_SPACING_S = 0.45  # at least, between fixes that make nodes
STANDSTILL_INTERVAL_S = (
    10.0  # nodes inside a standstill: rocking is bounded, so few and long intervals
)
CLOSEST_S = 0.25  # a grid node this close to an event gives way
SEGMENT_S = 10.0  # length of a calibration segment


@dataclass(frozen=True)
class Nodes:
    """N nodes on edges of the increments; interval k runs from node k to k + 1."""

    edge: Index  # (N,) edge number
    time: Array  # (N,) s
    segment: Index  # (N - 1,) calibration segment in force in each interval
    segment_time: Array  # (K,) s, middle of each segment

    @property
    def intervals(self) -> Scope:
        """What a factor over each interval acts on, stamped at the interval's end."""
        return Scope(np.arange(len(self.segment)), self.segment, self.time[1:])

    def at(self, node: Index, time: Array | None = None) -> Scope:
        """What a factor at each node (n,) acts on, stamped `time` (n,) s.

        In force at a node is the segment of the interval that ends there: a row belongs to the
        interval of its later node, and node 0 to the first.
        """
        stamp = self.time[node] if time is None else time
        return Scope(node, self.segment[np.maximum(node - 1, 0)], stamp)


@dataclass(frozen=True)
class Schedule:
    """What nodes are placed by, as far as it is known."""

    edge: Array | list[float]  # (M + 1,) s, of the increments
    judged: int  # edges before this one are known to be events, or none
    events: list[int]  # edges where a node must stand, in order
    aids: Array | list[float]  # s, times of fixes that ask for nodes, in order
    at_standstill: (
        Array | list[bool]
    )  # (at least `judged` - 1,) whether each increment is at standstill
    start: float  # s, where the grid begins
    interval: float  # s, its step
    ahead: float = 0.0  # s behind a node of which the events are known when it is placed

    @cached_property
    def room(self) -> float:
        """s that a grid node keeps from events and fixes."""
        return room_of(self.interval)


def next_node(last: int, by: Schedule) -> int | None:
    """Edge number of the node after edge `last`, or None while that is open.

    Nodes stand at events (standstill edges, state boundaries), near fixes, else on the grid; at
    standstill every ten seconds. A node that is no event gives way to one within `room` after it,
    where that is known by then; a grid node gives way to a fix.
    """
    if last >= by.judged:
        return None
    k = bisect_right(by.events, last)
    event = by.events[k] if k < len(by.events) else None
    target = _wanted(last, by) - 0.5 * (by.edge[last + 1] - by.edge[last])
    found = max(bisect_left(by.edge, target, last + 1, by.judged), last + 1)
    # an event is seen after its edge: what stands on the last of those judged is open
    if event is not None and (found >= event or by.edge[event] - by.edge[found] < by.ahead - 1e-9):
        return event
    return found if found < by.judged else None


def _wanted(last: int, by: Schedule) -> float:
    """Time at which the node after edge `last` should stand where there are no events, s."""
    t = by.edge[last]
    if by.at_standstill[last]:
        return t + STANDSTILL_INTERVAL_S
    steps = floor((t - by.start + by.room) / by.interval + 1)
    grid = by.start + steps * by.interval
    k = bisect_left(by.aids, t + by.room)
    return by.aids[k] if k < len(by.aids) and by.aids[k] < grid + by.room else grid


def place_nodes(
    edges: Array, events: Array, aids: Array, standstills: Array, interval: float = INTERVAL_S
) -> Nodes:
    """All nodes of a run between its first and last of `edges` (M + 1,) s, by `next_node`.

    `events` (E,) s; `aids` (F,) s, fixes; few inside `standstills` (K, 2) s; else every
    `interval` s.
    """
    end = len(edges) - 1
    right = np.clip(np.searchsorted(edges, events), 1, end)
    nearest = right - (events - edges[right - 1] < edges[right] - events)
    by = Schedule(
        edge=edges.tolist(),
        judged=len(edges),
        events=np.union1d(nearest, end).tolist(),
        aids=np.sort(aids).tolist(),
        at_standstill=_inside(0.5 * (edges[1:] + edges[:-1]), standstills).tolist(),
        start=float(edges[0]),
        interval=interval,
        ahead=room_of(interval),
    )
    chosen = [0]
    while chosen[-1] < end and (found := next_node(chosen[-1], by)) is not None:
        chosen.append(found)
    time = edges[chosen]
    middle, segment = np.unique(segment_middle(time[:-1], time[0]), return_inverse=True)
    return Nodes(np.array(chosen), time, segment, middle)


def segment_middle(time: Array, start: float) -> Array:
    """Middle (n,) s of the calibration segments in force in the intervals that begin at `time`
    (n,) s, the first segment at `start`.
    """
    return start + (np.floor((time - start) / SEGMENT_S) + 0.5) * SEGMENT_S


def near_fixes(*times: Array) -> Array:
    """Times of fixes that ask for nodes, of several sensors' (n,) s each."""
    return np.concatenate([np.zeros(0), *(t[first_in_slot(t)] for t in times)])


def first_in_slot(time: Array, before: Array | None = None) -> NDArray[np.bool_]:
    """Which of the fixes at `time` (n,) s in order ask for a node: the first in every slot of
    `FIX_SPACING_S`; `before` (1,) s the last one that did, if there is one.
    """
    slot = np.floor(np.append(time[:0] if before is None else before, time) / FIX_SPACING_S)
    return np.asarray(np.diff(slot, prepend=np.nan)[len(slot) - len(time) :] != 0)


def room_of(interval: float) -> float:
    """s that a grid node keeps from events, with nodes every `interval` s."""
    return min(CLOSEST_S, interval / 2)


def _inside(times: Array, standstills: Array) -> NDArray[np.bool_]:
    """Whether each time lies strictly inside a standstill."""
    if not len(standstills):
        return np.zeros(len(times), bool)
    at = np.clip(np.searchsorted(standstills[:, 0], times, side="right") - 1, 0, None)
    return np.asarray((times > standstills[at, 0]) & (times < standstills[at, 1]))


def nearest_node(nodes: Nodes, times: Array) -> tuple[Index, Array]:
    """Nearest node of each time and how long after the node it is, (n,) and (n,) s."""
    right = np.clip(np.searchsorted(nodes.time, times), 1, len(nodes.time) - 1)
    index = right - (times - nodes.time[right - 1] < nodes.time[right] - times)
    return index, times - nodes.time[index]
