"""What a stream has heard of the vehicle's own motion.

A new sensor does not begin here: CONTRIBUTING, "A new sensor", names its files.
"""

from dataclasses import dataclass, field

import numpy as np

from graphnav.common.run import Array
from graphnav.graph.nodes import Schedule
from graphnav.stream.causal_standstill import CausalStandstill
from graphnav.stream.inertial_intake import InertialIntake
from graphnav.stream.intake import Distance, Sides


@dataclass(frozen=True)
class Sensors:
    """Inertial samples, running gear and where the vehicle stands."""

    standstill: CausalStandstill
    inertial: InertialIntake = field(default_factory=InertialIntake)
    odometer: Distance = field(default_factory=Distance)
    sides: Sides = field(default_factory=Sides)

    def schedule(self, last: int, aids: Array, interval: float) -> Schedule:
        """What the nodes after edge `last` are placed by, with the `aids` (n,) s after it."""
        edge, held = self.inertial.edge.rows, self.standstill.held.rows
        events = np.flatnonzero(np.diff(held[last:])) + last + 1
        return Schedule(edge, len(held), events.tolist(), aids, held, float(edge[0]), interval)
