"""Where the smoother's nodes stand: 1 Hz, and wherever something happens."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.block import Index, Scope
from graphnav.common.run import Array

INTERVAL_S = 1.0  # between nodes, unless told otherwise
FIX_SPACING_S = 0.45  # at least, between fixes that make nodes
REST_INTERVAL_S = 10.0  # nodes inside a standstill: rocking is bounded, so few and long intervals
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


def place_nodes(
    edges: Array, events: Array, extra: Array, rests: Array, interval: float = INTERVAL_S
) -> Nodes:
    """Nodes every `interval`, at `events` (standstill edges, state boundaries) and near `extra`.

    `edges` (M + 1,) s; `events` are kept always, `extra` (fixes) where no event is closer than
    `CLOSEST_S`, grid nodes where neither is. Inside `rests` (K, 2) s there are only a few.
    """
    last = len(edges) - 1
    grid = np.arange(edges[0], edges[-1], interval)
    resting = _inside(grid, rests)
    coarse = np.concatenate([np.arange(a, b, REST_INTERVAL_S) for a, b in rests] or [grid[:0]])
    extra = extra[~_inside(extra, rests)]

    def nearest(times: Array) -> Index:
        right = np.clip(np.searchsorted(edges, times), 1, last)
        return right - (times - edges[right - 1] < edges[right] - times)

    chosen = np.unique(np.concatenate([[0, last], nearest(events)]))
    for candidates in (nearest(coarse), nearest(extra), nearest(grid[~resting])):
        chosen = _with_room(chosen, np.unique(candidates), edges, room_of(interval))
    time = edges[chosen]
    segment = np.floor((time[:-1] - time[0]) / SEGMENT_S).astype(np.int64)
    segment = np.unique(segment, return_inverse=True)[1]
    first = np.flatnonzero(np.diff(segment, prepend=-1))
    bounds = np.append(time[first], time[-1])
    return Nodes(chosen, time, segment, 0.5 * (bounds[1:] + bounds[:-1]))


def next_node(
    last: int, edge: Array, still: Array, aids: Array, start: float, interval: float
) -> int | None:
    """Edge number of the node after edge `last`, or None while that is open.

    Nodes stand where standstill begins or ends, at `aids` (sorted times of fixes), else at every
    `interval` s since `start`, at rest every ten. `still` covers the increments that are judged,
    `aids` reach further.
    """
    ready, t = len(still), float(edge[last])
    if last >= ready:
        return None
    resting, half = still[last] > 0, 0.5 * float(edge[last + 1] - t)
    if resting:
        target = t + REST_INTERVAL_S
    else:
        room = room_of(interval)
        target = start + np.floor((t - start + room) / interval + 1) * interval
        k = int(np.searchsorted(aids, t + room))
        if k < len(aids) and aids[k] < target + room:
            target = float(aids[k])
    # an edge may not be the last of the judged ones: a change of standstill is seen after it
    found = max(int(np.searchsorted(edge[:ready], target - half)), last + 1)
    changes = np.flatnonzero(np.diff(still[last : found + 1])) + last + 1
    if len(changes):
        return int(min(changes[0], found))
    return found if found < ready else None


def near_fixes(*times: Array) -> Array:
    """Times of fixes that ask for nodes: of each sensor's (n,) s one in `FIX_SPACING_S`."""
    some = [t[np.unique(np.floor(t / FIX_SPACING_S), return_index=True)[1]] for t in times]
    return np.concatenate([np.zeros(0), *some])


def room_of(interval: float) -> float:
    """s that a grid node keeps from events, with nodes every `interval` s."""
    return min(CLOSEST_S, interval / 2)


def _inside(times: Array, rests: Array) -> NDArray[np.bool_]:
    """Whether each time lies strictly inside a rest."""
    if not len(rests):
        return np.zeros(len(times), bool)
    at = np.clip(np.searchsorted(rests[:, 0], times, side="right") - 1, 0, None)
    return np.asarray((times > rests[at, 0]) & (times < rests[at, 1]))


def _with_room(chosen: Index, candidates: Index, edges: Array, room: float) -> Index:
    """Add the candidates that keep their distance from what is chosen and from each other."""
    right = np.clip(np.searchsorted(chosen, candidates), 1, len(chosen) - 1)
    gap = np.minimum(
        np.abs(edges[candidates] - edges[chosen[right - 1]]),
        np.abs(edges[chosen[right]] - edges[candidates]),
    )
    free = candidates[gap >= room - 1e-9]
    if len(free) and np.min(np.diff(edges[free]), initial=np.inf) < room:
        slot = np.floor((edges[free] - edges[0]) / room)
        free = free[np.unique(slot, return_index=True)[1]]
        # one a slot may still stand right behind that of the slot before
        free = free[np.diff(edges[free], prepend=-np.inf) >= room / 2]
    return np.unique(np.concatenate([chosen, free]))


def nearest_node(nodes: Nodes, times: Array) -> tuple[Index, Array]:
    """Nearest node of each time and how long after the node it is, (n,) and (n,) s."""
    right = np.clip(np.searchsorted(nodes.time, times), 1, len(nodes.time) - 1)
    index = right - (times - nodes.time[right - 1] < nodes.time[right] - times)
    return index, times - nodes.time[index]
