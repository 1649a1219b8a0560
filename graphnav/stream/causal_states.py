"""Motion states as the vehicle knew them: recognised on the seconds just driven, anew every few."""

import numpy as np

from factors.preintegration import preintegrate
from graphnav.common.errors import SolutionError
from graphnav.graph.densify import densify
from graphnav.graph.kinematics import kinematics
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.motion_states import recognise
from graphnav.stream.incremental_graph import IncrementalGraph, Window

EVERY_S, EVERY_OTHER_S = 10.0, 20.0  # between looks back, with states to be told and without
SHORTEST_S = 3.0  # s of driving that show a state
SETTLING_S = 4.0  # s at the beginning of a window whose states stay as they were


class CausalStates:
    """The state of the newest interval; corrects those of a window as more is seen.

    The most probable sequence over a sliding window of the past: a state is known some seconds
    after it began (`EVERY_S` and the minimum dwell), until then the last one holds.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._has_gears = vehicle.kind == "tracked"
        self.now = "straight_high" if self._has_gears else "moving"
        self.every_s = EVERY_S if self._has_gears else EVERY_OTHER_S

    def follow(self, graph: IncrementalGraph, window: Window) -> None:
        """Recognise the window's states again."""
        first, times = window.first, graph.log.time.rows[window.first :]
        if not self._has_gears or times[-1] - times[0] < SHORTEST_S:
            return
        prep, nodes = graph.log.sensed(first, graph.last)
        if prep.sensed.run.odometer is None:
            return
        estimate = window.estimate
        errors = prep.setup.layout.imu_errors_of(estimate.calibration)[nodes.segment]
        pre = preintegrate(prep.sensed.inc, nodes.edge, errors, prep.setup.noise)
        path = densify(prep.sensed.inc, pre, nodes, estimate, prep.setup.alignment.origin)
        try:
            line = recognise(kinematics(prep, path, estimate, nodes), prep.setup.params)
        except SolutionError:
            return
        middle = 0.5 * (times[1:] + times[:-1])
        states = line.state_at(middle).tolist()
        self.now = states[-1]
        for k in np.flatnonzero((middle > times[0] + SETTLING_S) | (first == 0)).tolist():
            graph.log.states[first + k] = states[k]
