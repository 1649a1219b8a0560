"""The nodes of a stream so far: where they stand, and what the sensors said between them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from factors.block import Index
from factors.estimate import Estimate
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import ExternalHeading, Run
from graphnav.graph.common_error import ASSUMED
from graphnav.graph.nodes import Nodes, segment_middle
from graphnav.graph.preparation import Prepared, Sensed, Setup, fixes_in
from graphnav.graph.problem import Problem, build
from graphnav.graph.satellite_fixes import NODE_SLACK_S, carried_with
from graphnav.recognition.timeline import Timeline
from graphnav.stream.aiding import Aiding, joined
from graphnav.stream.sensors import Sensors


class NodeLog:
    """Nodes 0 to `last` with their intervals' motion states and calibration segments."""

    def __init__(self, setup: Setup, sensors: Sensors, aiding: Aiding) -> None:
        self.setup, self._sensors, self._aiding = setup, sensors, aiding
        self.rocking = np.zeros(3)  # rad, how far the standing vehicle rocks
        self.edge, self.time = GrowingArray(), GrowingArray()
        self.segment, self.segment_time = (
            GrowingArray(),
            GrowingArray(),
        )  # of each interval; of each segment
        self.states: list[str] = []  # of each interval
        self.scales: dict[str, float] = dict(ASSUMED)  # noise found so far over noise assumed
        self._headings: list[ExternalHeading | None] = []  # of each node
        self._place(0)
        self.segment_time.append(segment_middle(self.time.rows, float(self.time.rows[0])))

    @property
    def last(self) -> int:
        """Number of the newest node."""
        return len(self.time) - 1

    def extend(self, edge: int, state: str) -> bool:
        """A node at an edge; whether a new calibration segment begins with its interval."""
        start = float(self.time.rows[0])
        middle = segment_middle(self.time.rows[-1:], start)
        new = bool(middle[0] > self.segment_time.rows[-1])
        if new:
            self.segment_time.append(middle)
        self.segment.push(len(self.segment_time) - 1)
        self.states.append(state)
        self._place(edge)
        return new

    def _place(self, edge: int) -> None:
        time = float(self._sensors.inertial.edge.rows[edge])
        self.edge.push(edge)
        self.time.push(time)
        # what was sensed until node 0 went into the alignment
        self._headings.append(self._aiding.heading_near(time) if self.last else None)

    def segments(self, first: int, last: int) -> slice:
        """Segments in force from node `first` to node `last`, or before a single node."""
        if not len(self.segment):
            return slice(0, 1)
        s = self.segment.rows
        start = first if first < last else max(first - 1, 0)
        return slice(int(s[start]), int(s[max(last - 1, 0)]) + 1)

    def segment_of(self, first: int, last: int) -> Index:
        """The segment in force in each interval between two nodes."""
        return self.segment.rows[first:last].astype(np.int64)

    def nodes(self, first: int, last: int) -> Nodes:
        """Nodes `first` to `last`, segments numbered from the first of them."""
        edge = self.edge.rows[first : last + 1].astype(np.int64)
        segment = self.segment_of(first, last)
        middle = self.segment_time.rows[self.segments(first, last)]
        return Nodes(edge - edge[0], self.time.rows[first : last + 1], segment - segment[0], middle)

    def sensed(self, first: int, last: int) -> tuple[Prepared, Nodes]:
        """What the sensors said between two nodes."""
        nodes, heard = self.nodes(first, last), self._sensors
        a, b = int(self.edge.rows[first]), int(self.edge.rows[last])
        span = float(nodes.time[0]), float(nodes.time[-1])
        heading = joined(self._headings[first + 1 if first else 0 : last + 1])
        begin = span[0] + NODE_SLACK_S if first else -np.inf
        heard_by = float(self.time.rows[-1]) + NODE_SLACK_S
        delay = self.setup.fix_delay
        gnss = self._aiding.fixes(begin, span[1] + NODE_SLACK_S, heard_by, delay)
        fixes_n = fixes_in(self.setup.alignment.origin, gnss)
        run = Run(
            path=Path("stream"),
            clock_start=0.0,
            end=span[1],
            imu=None,
            odometer=heard.odometer.around(*span),
            sides=heard.sides.around(*span),
            gnss=gnss,
            heading=heading,
            rover=None,
        )
        inc = heard.inertial.between(a, b)
        standstill = heard.standstill.between(a, b, inc.edge, span[1])
        sensed = Sensed(run, inc, standstill, fixes_n, self.rocking)
        return Prepared(self.setup, sensed), nodes

    def problem(self, first: int, last: int, at: Estimate) -> Problem:
        """The batch's factors between two nodes, increments integrated with the biases of `at`."""
        delay = carried_with(self.setup, at)
        self.setup = replace(self.setup, fix_delay=delay)
        prep, nodes = self.sensed(first, last)
        t, names = nodes.time, np.array(self.states[first:last])
        return build(
            prep, nodes, Timeline(t[:-1], t[1:], names, np.ones(len(names))), at, self.scales
        )
