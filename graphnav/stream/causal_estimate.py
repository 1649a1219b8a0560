"""A state as a vehicle knew it at one moment."""

from dataclasses import dataclass

import numpy as np

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
    latency: float  # s, from the node being due to this estimate

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
        return np.sqrt(np.diag(self.covariance)[6:9])


def shares(spans: Array, sweep: float) -> list[float]:
    """Seconds spent on each of the nodes that were linearised together, in the first one's span;
    a sweep over the whole run after them is the last one's.
    """
    own = spans.copy()
    if len(own) > 1:
        own[0] = own[1:].mean()
    own += (spans[0] - own[0]) / len(own)
    own[-1] += sweep
    return list(own.tolist())
