"""The unknowns all factors speak of: the states of the nodes and the chain of calibrations."""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.block import PHASE, POSITION, ROTATION, VELOCITY, Array


@dataclass(frozen=True)
class Estimate:
    """States of N nodes and K calibration segments; see `factors` for the error state."""

    R_nb: Array  # (N, 3, 3)
    v_n: Array  # (N, 3) m/s
    p_n: Array  # (N, 3) m
    phase: Array  # (N,) m
    calibration: Array  # (K, dim)

    def retract(self, nodes: Array, calibration: Array) -> "Estimate":
        """The estimate moved by error states (N, 10) and (K, dim)."""
        return Estimate(
            R_nb=so3.orthonormalised(self.R_nb @ so3.exp(nodes[:, ROTATION])),
            v_n=self.v_n + nodes[:, VELOCITY],
            p_n=self.p_n + nodes[:, POSITION],
            phase=self.phase + nodes[:, PHASE.start],
            calibration=self.calibration + calibration,
        )


def finite(estimate: Estimate) -> bool:
    """Whether every number is finite."""
    parts = (estimate.R_nb, estimate.v_n, estimate.p_n, estimate.calibration)
    return all(bool(np.isfinite(x).all()) for x in parts)
