"""Motion states over time: a gap-free sequence of segments, each with its probability."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import SolutionError
from graphnav.common.run import Array

Names = NDArray[np.str_]


@dataclass(frozen=True)
class Timeline:
    """Segments `[start, end)` in order, `end[i] == start[i + 1]`; neighbours differ in state."""

    start: Array  # (K,) s
    end: Array  # (K,) s
    state: Names  # (K,)
    probability: Array  # (K,) posterior of the state averaged over the segment, 0..1

    def __post_init__(self) -> None:
        gap_free = len(self.start) > 0 and np.array_equal(self.end[:-1], self.start[1:])
        if not gap_free or np.any(self.end <= self.start):
            raise SolutionError("motion states: the timeline has gaps or empty segments")

    def __len__(self) -> int:
        return len(self.start)

    @property
    def boundaries(self) -> Array:
        """Times at which the state changes, (K-1,) s; smoother nodes belong there."""
        return self.start[1:]

    @property
    def duration(self) -> Array:
        """Length of each segment, (K,) s."""
        return self.end - self.start

    def segment_at(self, times: Array) -> NDArray[np.intp]:
        """Index of the segment each time lies in, (N,); times outside take the nearest segment."""
        return np.searchsorted(self.boundaries, times, side="right")

    def state_at(self, times: Array) -> Names:
        """State name at each time, (N,)."""
        return self.state[self.segment_at(times)]

    def covering(self, start: float, end: float) -> "Timeline":
        """The same segments with the first and last stretched (or cut) to span start..end, s."""
        inside = (self.end > start) & (self.start < end)
        first, last = np.flatnonzero(inside)[[0, -1]] if inside.any() else (0, 0)
        kept = slice(first, last + 1)
        starts, ends = self.start[kept].copy(), self.end[kept].copy()
        starts[0], ends[-1] = start, end
        return replace(
            self,
            start=starts,
            end=ends,
            state=self.state[kept],
            probability=self.probability[kept],
        )

    def totals(self) -> dict[str, tuple[int, float]]:
        """State name -> (number of segments, seconds)."""
        return {
            str(name): (
                int(np.sum(self.state == name)),
                float(self.duration[self.state == name].sum()),
            )
            for name in np.unique(self.state)
        }


def timeline_from_states(time: Array, state: Names, probability: Array | None = None) -> Timeline:
    """Run-length code the states of samples at `time` (N,) s; cuts fall midway between samples.

    `probability` (N,) is averaged over each segment; without it every segment has 1.
    """
    weight = np.ones(len(time)) if probability is None else probability
    first = np.flatnonzero(np.r_[True, state[1:] != state[:-1]])
    cuts = 0.5 * (time[first[1:] - 1] + time[first[1:]])
    count = np.diff(np.r_[first, len(time)])
    return Timeline(
        start=np.r_[time[0], cuts],
        end=np.r_[cuts, time[-1]],
        state=np.asarray(state[first], dtype=np.str_),
        probability=np.add.reduceat(weight, first) / count,
    )


def disagreement(first: Timeline, second: Timeline, step: float = 0.1) -> float:
    """Share of time, 0..1, at which two timelines over the same run name different states."""
    times = np.arange(first.start[0], first.end[-1], step)
    return float(np.mean(first.state_at(times) != second.state_at(times)))
