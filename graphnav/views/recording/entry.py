"""What goes into a recording: a list of entries, made by pure functions and sent in one place."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]

TIMELINE = "time"  # s since the start of the run
SERIES_LIMIT = 60_000  # samples of one plotted series: 10 Hz stays whole up to 100 min
STRIP_LIMIT = 30_000  # vertices of one path: finer than a pixel on any screen


@dataclass(frozen=True)
class Entry:
    """One entity's data: an archetype when static, columns over `time` (N,) s otherwise."""

    entity: str
    content: Any  # rr.AsComponents | Iterable[ComponentColumn]
    time: Array | None = None
    y_range: tuple[float, float] | None = None  # rerun's own range forgets 3-sigma bands


def static(entity: str, *archetypes: "rr.AsComponents") -> list[Entry]:
    """Entries that hold for the whole recording."""
    return [Entry(entity, archetype) for archetype in archetypes]


def part(name: object) -> str:
    """A name as one part of an entity path."""
    import rerun as rr

    return rr.escape_entity_path_part(str(name))


def over_time(entity: str, time: Array, content: Iterable[Any]) -> Entry:
    """One column entry; `content` is what an archetype's `columns()` returns."""
    return Entry(entity, list(content), time)


def send(recording: "rr.RecordingStream", entries: list[Entry]) -> None:
    """Write the entries. Raises rerun's own error when lengths do not match."""
    import rerun as rr

    for entry in entries:
        if entry.time is None:
            recording.log(entry.entity, entry.content, static=True, strict=True)
            continue
        # rint: TimeColumn truncates floats to nanoseconds
        nanoseconds = np.rint(entry.time * 1e9).astype("timedelta64[ns]")
        index = [rr.TimeColumn(TIMELINE, duration=nanoseconds)]
        recording.send_columns(entry.entity, index, entry.content, strict=True)
