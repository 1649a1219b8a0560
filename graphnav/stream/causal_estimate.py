"""A state as a vehicle knew it at one moment."""

from dataclasses import dataclass

import numpy as np

from factors.block import POSITION
from graphnav.common.angles import angles_of_rotation
from graphnav.common.earth import Origin
from graphnav.common.run import Array


@dataclass(frozen=True)
class CausalEstimate:
    """What the vehicle knew of itself at one moment."""

    time: float  # s, on the sensors' clock
    R_nb: Array  # (3, 3)
    v_n: Array  # (3,) m/s
    p_n: Array  # (3,) m from `origin`
    covariance: Array  # (9, 9) of [theta (b), v (n), p (n)]
    origin: Origin
    latency: float  # s from being due to this estimate, the mean of nodes that entered together

    @property
    def heading_deg(self) -> float:
        """Clockwise from north."""
        return float(np.rad2deg(angles_of_rotation(self.R_nb)[2]))

    @property
    def geodetic(self) -> tuple[float, float, float]:
        """Latitude, longitude [rad], ellipsoidal height [m]."""
        lat, lon, height = self.origin.geodetic(self.p_n)
        return float(lat), float(lon), float(height)

    @property
    def sd_enu(self) -> Array:
        """(3,) m"""
        return np.sqrt(np.diag(self.covariance)[POSITION])
