"""Where a stream finds that a standing vehicle is carried, and when it knew."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from factors.preintegration import Increments
from graphnav.common.run import Array, Gnss
from graphnav.inertial.carried import WINDOW_S, carried_in, creeps, moving_rests, travels
from graphnav.inertial.quietness import SHORTEST_S, Mask, runs
from graphnav.stream.inertial_intake import Inertial

Fixes = Callable[[float, float], Gnss | None]  # those in use between two times
LOOK_S = 5.0  # between looks at the whole of a silence
NOTHING = np.zeros((0, 4))


@dataclass
class Silence:
    """A span in which the running gear shows no motion, and what contradicts rest in it."""

    start: float  # s
    rests: list[tuple[float, float]] = field(default_factory=list)  # s, the last may go on
    compared: int = 0  # rests whose velocities were compared
    looked: float = 0.0  # s, when all of it was looked at
    moving: Array = field(default_factory=lambda: NOTHING)  # start, end, horizontal, vertical
    travelled: list[tuple[float, float, float, float]] = field(default_factory=list)
    known: list[tuple[float, Array]] = field(default_factory=list)  # `spans`, by time

    @property
    def spans(self) -> Array:
        """All that is carried, as `carried_in` has it, (L, 4)."""
        return np.concatenate([self.moving, np.reshape(self.travelled, (-1, 4))])


class CausalCarried:
    """Silences so far, each with what accelerometers and fixes said against its rests, and when."""

    def __init__(self) -> None:
        self._silences: list[Silence] = []
        self._goes_on = False

    def follow(self, silent: Mask, edge: Array) -> None:
        """More increments (n,) between `edge` (n + 1,) s."""
        for first, _, on in runs(silent):
            if on and not self._goes_on:
                self._silences.append(Silence(float(edge[first])))
            self._goes_on = on

    def rest(self, start: float, end: float) -> None:
        """A rest of the present silence, or what has become of its last one."""
        rests = self._silences[-1].rests
        if rests and rests[-1][0] == start:
            rests.pop()
        rests.append((start, end))

    def look(self, inertial: Inertial, fixes: Fixes, now: float) -> None:
        """Hold what was recorded until `now` s against the rests of the present silence."""
        if not self._goes_on or now - self._silences[-1].start < SHORTEST_S:
            return
        silence = self._silences[-1]
        before = silence.spans
        grown = len(silence.rests), now - silence.looked > LOOK_S
        if len(silence.rests) > 1 and (grown[0] != silence.compared or grown[1]):
            silence.compared = grown[0]
            inc = _since(inertial, silence.rests[0][0], now)
            # what moves does so until it is seen to stop
            silence.moving = moving_rests(inc, np.array(silence.rests), [(silence.start, np.inf)])
        gnss = fixes(silence.start, now)
        if gnss is not None:
            silence.travelled += travels(gnss, silence.start, now)
            silence.travelled += creeps(gnss, silence.start, now) if grown[1] else []
        silence.looked = now if grown[1] else silence.looked
        if not np.array_equal(before, silence.spans):
            silence.known.append((now, silence.spans))

    @property
    def now(self) -> bool:
        """Whether the vehicle was being carried when last looked at."""
        if not self._goes_on or not self._silences[-1].known:
            return False
        when, spans = self._silences[-1].known[-1]
        return bool(len(spans) and spans[:, 1].max() > when - WINDOW_S / 4)

    def within(self, edge: Array, known: float) -> Mask:
        """What each increment between `edge` (M + 1,) s was known for at a time, (M, 2)."""
        out = np.zeros((len(edge) - 1, 2), bool)
        for silence in reversed(self._silences):
            told = [spans for when, spans in silence.known if when <= known + 1e-9]
            if told and silence.start < edge[-1]:
                out |= carried_in(edge, told[-1])
        return out


def _since(inertial: Inertial, start: float, end: float) -> Increments:
    """The increments between two times."""
    edge = inertial.edge.rows
    first, last = np.searchsorted(edge, [start - 1e-6, end - 1e-6])
    return inertial.between(int(first), int(last))
