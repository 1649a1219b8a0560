"""The motion-state timeline: one lane each for recognised states, true states, kinds of slip."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graphnav.result import palette
from graphnav.result.result_directory import Results, columns
from graphnav.views.recording.entry import Entry, over_time, part, static

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]


def entries(results: Results) -> list[Entry]:
    """Everything below `/state`; the viewer orders lanes by name."""
    starts = columns(results.states, "start")[:, 0]
    names = [str(s) for s in results.states["state"]]
    return [
        *_motion(results, "/state/motion", starts, names),
        *_true(results),
        *_events(results),
    ]


def _motion(results: Results, entity: str, starts: Array, names: list[str]) -> list[Entry]:
    import rerun as rr

    present = palette.in_order(name for name in names if name)
    configuration = rr.StateConfiguration(
        values=present,
        labels=[palette.motion_label(s) for s in present],
        colors=np.array([palette.rgba32(palette.motion(s)) for s in present], np.uint32),
    )
    change = rr.StateChange.columns(state=names)
    time = starts - results.clock_start
    return [*static(entity, configuration), over_time(entity, time, change)]


def _true(results: Results) -> list[Entry]:
    if results.truth is None or "state" not in results.truth:
        return []
    names = results.truth["state"].fillna("").astype(str).to_numpy()
    first = np.flatnonzero(np.append(True, names[1:] != names[:-1]))
    starts = columns(results.truth, "time")[first, 0]
    return _motion(results, "/state/motion_true", starts, [str(s) for s in names[first]])


def _events(results: Results) -> list[Entry]:
    if results.events is None:
        return []
    out: list[Entry] = []
    for kind, events in results.events.groupby("kind", sort=True):
        out += _event_lane(results, str(kind), events)
    return out


def _event_lane(results: Results, kind: str, events: "DataFrame") -> list[Entry]:
    import rerun as rr

    configuration = rr.StateConfiguration(
        values=[kind],
        labels=[palette.event_label(kind)],
        colors=np.array([palette.rgba32(palette.event(kind))], np.uint32),
    )
    events = events.sort_values("start")
    start, end = columns(events, "start", "end").T
    end = np.minimum(end, np.append(start[1:], np.inf))  # a lane shows one event at a time
    time = np.stack([start, end], -1).reshape(-1) - results.clock_start
    change = rr.StateChange.columns(state=[kind, ""] * len(events))
    entity = f"/state/slip/{part(kind)}"
    return [*static(entity, configuration), over_time(entity, time, change)]
