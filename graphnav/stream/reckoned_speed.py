"""The speed of a vehicle without an odometer, reckoned from the IMU alone as a stream goes on."""

import numpy as np

from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array
from graphnav.graph.preparation import Setup, speed_along
from graphnav.stream.inertial_intake import InertialIntake


class ReckonedSpeed:
    """Forward speed at the ends of frames, once aligned."""

    def __init__(self) -> None:
        self._setup: Setup | None = None
        self._tape = GrowingArray(2)  # s, m/s
        self._edge = 0  # number of the edge it reaches
        self._R, self._v = np.eye(3), np.zeros(3)

    def align(self, setup: Setup) -> None:
        """Begin, at the first edge, perhaps anew."""
        self._edge = 0
        self._tape.cut(0)
        start = setup.alignment.start
        self._setup, self._R, self._v = setup, start.R_nb, start.v_n

    def extend(self, inertial: InertialIntake, edge: int) -> None:
        """Up to an edge, from wherever it was."""
        if self._setup is None or edge <= self._edge:
            return
        inc = inertial.between(self._edge, edge)
        nodes = np.unique(np.append(np.arange(0, edge - self._edge, 20), edge - self._edge))
        R, v, speed = speed_along(inc, nodes, self._setup, self._R, self._v)
        new = slice(1 if len(self._tape) else 0, None)
        self._tape.append(np.column_stack([inc.edge[nodes], speed])[new])
        self._edge, self._R, self._v = edge, R, v

    @property
    def speed(self) -> tuple[Array, Array]:
        """Times s and speeds m/s, unknown until aligned."""
        if not len(self._tape):
            return np.array([0.0, np.inf]), np.array([0.0, np.inf])
        return self._tape.rows[:, 0], self._tape.rows[:, 1]
