"""Motion states as the vehicle knew them: recognised on the seconds just driven, anew every few."""

import numpy as np

from graphnav.corrections import VehicleParams
from graphnav.densify import densify
from graphnav.errors import SolutionError
from graphnav.growing import SWEEP_EVERY, Growing
from graphnav.kinematics import kinematics
from graphnav.motion_states import recognise
from graphnav.preparation import params
from graphnav.vehicle import Vehicle

EVERY = 5  # nodes between recognitions
BACK_S = 20.0  # s looked at
SETTLING_S = 4.0  # s at the beginning of them whose states stay as they were


class CausalStates:
    """The state of the newest interval; corrects those of the last seconds as more is seen.

    The most probable sequence over a sliding window of the past: a state is known some seconds
    after it began (`EVERY` nodes and the minimum dwell), until then the last one holds.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._params: VehicleParams | None = params(vehicle) if vehicle.kind == "tracked" else None
        self.now = "straight_high" if self._params else "moving"
        self.every = EVERY if self._params else SWEEP_EVERY  # nodes that may be added at once

    def follow(self, graph: Growing) -> None:
        """Recognise again when it is time, and exchange the factors of intervals told otherwise."""
        if self._params is None or graph.last % self.every:
            return
        times = graph.time.rows
        first = int(np.searchsorted(times, times[-1] - BACK_S))
        if times[-1] - times[first] < 3.0:
            return
        estimate = graph.at(first, graph.last)
        problem, prep = graph.problem(first, graph.last, estimate)
        if prep.run.odometer is None:
            return
        path = densify(prep.inc, problem.pre, problem.nodes, estimate, prep.alignment.origin)
        try:
            line = recognise(kinematics(prep, path, estimate, problem.nodes), self._params)
        except SolutionError:
            return
        middle = 0.5 * (times[first + 1 :] + times[first:-1])
        told = line.state_at(middle)
        free = (middle > times[first] + SETTLING_S) | (first == 0)
        before = np.array(graph.states[first:])
        changed = np.flatnonzero(free & (told != before))
        self.now = str(told[-1])
        if len(changed):
            for k in changed:
                graph.states[first + k] = str(told[k])
            graph.relinearise(first + int(changed[0]))
