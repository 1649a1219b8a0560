"""Where a stream finds that a vehicle at standstill is carried, and when it knew."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from factors.preintegration import Increments
from graphnav.common.run import Array, Gnss
from graphnav.inertial.carried_standstill import (
    WINDOW_S,
    carried_in,
    creeps,
    moving_standstills,
    travels,
)
from graphnav.inertial.standstill_evidence import SHORTEST_S, Mask, runs
from graphnav.stream.inertial_intake import InertialIntake

Fixes = Callable[[float, float], Gnss | None]  # those in use between two times
LOOK_S = 5.0  # between looks at the whole of a stop of the gear
NOTHING = np.zeros((0, 4))


@dataclass
class GearStop:
    """A span in which the running gear shows no motion, and what contradicts standstill in it."""

    start: float  # s
    standstills: list[tuple[float, float]] = field(default_factory=list)  # s, the last may go on
    compared: int = 0  # standstills whose velocities were compared
    looked: float = 0.0  # s, when all of it was looked at
    moving: Array = field(default_factory=lambda: NOTHING)  # start, end, horizontal, vertical
    travelled: list[tuple[float, float, float, float]] = field(default_factory=list)
    known: list[tuple[float, Array]] = field(default_factory=list)  # `spans`, by time

    @property
    def spans(self) -> Array:
        """All that is carried, as `carried_in` has it, (L, 4)."""
        return np.concatenate([self.moving, np.reshape(self.travelled, (-1, 4))])


class CausalCarried:
    """Stops of the gear so far, what accelerometers and fixes said against each, and when."""

    def __init__(self) -> None:
        self._stops: list[GearStop] = []
        self._goes_on = False

    def follow(self, gear_stopped: Mask, edge: Array) -> None:
        """More increments (n,) between `edge` (n + 1,) s."""
        for first, _, on in runs(gear_stopped):
            if on and not self._goes_on:
                self._stops.append(GearStop(float(edge[first])))
            self._goes_on = on

    def standstill(self, start: float, end: float) -> None:
        """A standstill of the present stop, or what has become of its last one."""
        standstills = self._stops[-1].standstills
        if standstills and standstills[-1][0] == start:
            standstills.pop()
        standstills.append((start, end))

    def look(self, inertial: InertialIntake, fixes: Fixes, now: float) -> None:
        """Hold what was recorded until `now` s against the standstills of the present stop."""
        if not self._goes_on or now - self._stops[-1].start < SHORTEST_S:
            return
        stop = self._stops[-1]
        before = stop.spans
        grown = len(stop.standstills), now - stop.looked > LOOK_S
        if len(stop.standstills) > 1 and (grown[0] != stop.compared or grown[1]):
            stop.compared = grown[0]
            inc = _since(inertial, stop.standstills[0][0], now)
            # what moves does so until it is seen to stop
            stop.moving = moving_standstills(
                inc, np.array(stop.standstills), [(stop.start, np.inf)]
            )
        gnss = fixes(stop.start, now)
        if gnss is not None:
            stop.travelled += travels(gnss, stop.start, now)
            stop.travelled += creeps(gnss, stop.start, now) if grown[1] else []
        stop.looked = now if grown[1] else stop.looked
        if not np.array_equal(before, stop.spans):
            stop.known.append((now, stop.spans))

    @property
    def now(self) -> bool:
        """Whether the vehicle was being carried when last looked at."""
        if not self._goes_on or not self._stops[-1].known:
            return False
        when, spans = self._stops[-1].known[-1]
        return bool(len(spans) and spans[:, 1].max() > when - WINDOW_S / 4)

    def within(self, edge: Array, known: float) -> Mask:
        """What each increment between `edge` (M + 1,) s was known for at a time, (M, 2)."""
        out = np.zeros((len(edge) - 1, 2), bool)
        for stop in reversed(self._stops):
            spans = [found for when, found in stop.known if when <= known + 1e-9]
            if spans and stop.start < edge[-1]:
                out |= carried_in(edge, spans[-1])
        return out


def _since(inertial: InertialIntake, start: float, end: float) -> Increments:
    """The increments between two times."""
    edge = inertial.edge.rows
    first, last = np.searchsorted(edge, [start - 1e-6, end - 1e-6])
    return inertial.between(int(first), int(last))
