"""How far the vehicle of a stream rocks, of the standstills so far."""

import numpy as np

from factors.preintegration import InertialNoise
from graphnav.common.run import Array
from graphnav.inertial.standstill import rocking
from graphnav.stream.sensors import Sensors


class Rocking:
    """The median over the standstills, the last as far as it has come."""

    def __init__(self) -> None:
        self._of: dict[int, Array] = {}  # rad, of each standstill, by its first increment
        self._usual = np.zeros(3)

    def until(self, edge: int, heard: Sensors, noise: InertialNoise) -> Array:
        """One sigma by axis (3,) rad, of the standstills until an edge; `noise` the IMU's."""
        held = heard.standstill.held.rows
        if edge > 0 and held[edge - 1]:
            moving = np.flatnonzero(held[:edge] == 0)
            first = int(moving[-1]) + 1 if len(moving) else 0
            inc = heard.inertial.between(first, edge)
            self._of[first] = rocking(inc, inc.edge[None, [0, -1]], float(np.min(noise.gyro)))
            self._usual = np.median(list(self._of.values()), axis=0)
        return self._usual
