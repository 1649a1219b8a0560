"""How much the inertial samples scatter about a smooth motion: what vibration leaves in them.

A recorded IMU is 10 to 300 times noisier on a driving vehicle than on a desk: vibration, aliased
and quantised. What a sample differs from the middle of its neighbours is of that kind, the motion
of a vehicle is not. How much of it survives in the sums is found from the residuals
(`graph/inertial_noise.py`): here only its level, by axis and moment.
"""

import numpy as np

from factors.block import Index
from factors.preintegration import Increments, interval_of_increment
from graphnav.common.run import Array

SECOND_DIFFERENCE = 1.5  # variance of x_k - (x_k-1 + x_k+1) / 2 of white x, over that of x
GRID_S = 0.05  # over which samples are averaged first: finer increments tell the same


def scatter(inc: Increments, nodes: Index) -> Array:
    """Squared noise density that the scatter of the increments would be if it were white, mean over
    each interval between the edges `nodes` (N,): (N - 1, 6) in rad^2/s and m^2/s^3. Nothing outside
    an interval is looked at; one too short to tell has none.
    """
    first, owner = _groups(inc, nodes)
    dt = np.add.reduceat(np.diff(inc.edge), first)[:, None]
    rate = np.add.reduceat(np.concatenate([inc.rotation, inc.velocity], axis=1), first) / dt
    off = rate[1:-1] - 0.5 * (rate[2:] + rate[:-2])
    inside = owner[2:] == owner[:-2]
    density = off[inside] ** 2 / SECOND_DIFFERENCE * dt[1:-1][inside]
    at, n = owner[1:-1][inside], len(nodes) - 1
    total = np.stack([np.bincount(at, column, n) for column in density.T], axis=1)
    return np.asarray(total / np.maximum(np.bincount(at, minlength=n), 1)[:, None])


def _groups(inc: Increments, nodes: Index) -> tuple[Index, Index]:
    """First increment of each group of about `GRID_S` and the interval it lies in."""
    size = max(1, round(GRID_S / float(np.median(np.diff(inc.edge)))))
    owner = interval_of_increment(nodes)
    place = np.arange(len(owner)) - nodes[:-1][owner]
    first = np.flatnonzero(place % size == 0)
    return first, owner[first]
