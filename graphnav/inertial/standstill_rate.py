"""Which rate the gyros show while the vehicle stands: bias and Earth rate, or is it a turn?

A steady turn on the spot is as quiet as a stop, and its odometer as zero. What tells them apart is
that a bias is the same at every standstill and while driving, and that it has a size to be
expected.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from graphnav.common.earth import RATE
from graphnav.common.run import Array

PRIOR_SIGMAS = 3.0  # of the bias, within which rates at standstill may differ
NOISE_SIGMAS = 8.0  # of a window's mean rate; an engine's rocking is not white
MOST_COMPARED = 600  # rates
ENOUGH_DRIVING = 10  # seconds


@dataclass(frozen=True)
class StandstillRate:
    """The rate shown at standstill and how far a window's mean may be from it."""

    rate: Array  # (3,) rad/s
    tolerance: float  # rad/s


def standstill_rate(
    steady: Array, driving: Array, noise: float, bias_sd: float
) -> StandstillRate | None:
    """The rate at standstill among those of quiet seconds (n, 3) rad/s; None when all are turns.

    `noise` one sigma of a second's mean, `bias_sd` the vehicle file's; `driving` (k, 3) rad/s are
    means of seconds on the move, whose median is near the bias. Of the rates that come up, the one
    wins that comes up often, is small against the bias' sigma and near what driving shows: as a
    sum of logarithms, so that a bias beyond its data sheet is found where nothing speaks against
    it. A rate beyond that sigma which driving contradicts is a turn, however steady.
    """
    if not len(steady):
        return None
    some = steady[:: -(-len(steady) // MOST_COMPARED)]
    tolerance = PRIOR_SIGMAS * bias_sd + 2 * RATE + NOISE_SIGMAS * noise
    size = np.linalg.norm(some, axis=1)
    near = cdist(some, some) < tolerance
    score = np.log(near.sum(1)) - np.log1p((size / tolerance) ** 2)
    driven = np.median(driving, axis=0) if len(driving) >= ENOUGH_DRIVING else None
    if driven is not None:
        apart = np.linalg.norm(driving - driven, axis=1)
        sd = np.hypot(tolerance, np.median(apart) / np.sqrt(len(driving) / ENOUGH_DRIVING))
        score -= np.log1p((np.linalg.norm(some - driven, axis=1) / sd) ** 2)
    found = np.median(some[near[int(score.argmax())]], axis=0)
    beyond = float(np.linalg.norm(found))
    contradicted = driven is not None and np.linalg.norm(found - driven) > 0.5 * beyond
    if beyond > tolerance and contradicted:
        return None
    return StandstillRate(found, tolerance)
