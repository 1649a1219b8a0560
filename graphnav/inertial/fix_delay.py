"""By how much satellite fixes are stamped late, sought before anything is estimated.

The way reckoned with odometer and gyro, shifted in time, is laid on the way between fixes, window
by window and turned freely in each: neither the heading nor a slow gyro bias matters. Every window
has a scatter of its own, so that a spell of multipath counts for little. Minus the logarithm of the
likelihood is then `sum n log(r)`, with r the mean square left over from n steps.
"""

import numpy as np
from numpy.typing import NDArray

from factors.block import Index
from factors.preintegration import Increments
from graphnav.common.earth import Origin
from graphnav.common.run import Array, Gnss, Odometer
from graphnav.inertial.odometer_steps import distance_at

Way = NDArray[np.complex128]  # east + i north [m]

STEP_S, WINDOW = 2.0, 10  # s between the fixes compared, steps in a window
LONGEST_S, COARSE_S, FINE_S = 22.0, 0.5, 0.05  # delays tried, either way
LEAST_S = 0.3  # a smaller delay is left to the graph
CONVINCING = 6.0  # in log-likelihood over no delay
EXPLAINED = 0.5  # of the squared way between fixes that the best delay must explain
ROUND_OFF = 1e-4  # m^2


def found_delay(inc: Increments, odometer: Odometer | None, gnss: Gnss) -> float:
    """The delay [s] that lays the reckoned way on the fixes; 0 where they do not tell, or where it
    is small. Where the odometer does not fit, or is not there, turns alone tell: speed is then that
    of the fixes.
    """
    fix = _sparse(gnss)
    span = min(inc.edge[-1], gnss.time[-1]) - max(inc.edge[0], gnss.time[0])
    longest = COARSE_S * np.floor(min(LONGEST_S, span / 4) / COARSE_S)
    time, way = gnss.time[fix], _horizontal(gnss, fix)
    inside = (time > inc.edge[0] + longest) & (time < inc.edge[-1] - longest)
    time, way = time[inside], way[inside]
    if len(time) <= 2 * WINDOW or longest < COARSE_S:
        return 0.0
    for heard in (odometer, None) if odometer is not None else (None,):
        found = _best(_Reckoned(inc, heard, time, np.diff(way)), np.diff(way), longest)
        if found is not None:
            return found if abs(found) > LEAST_S else 0.0
    return 0.0


def _best(reckoned: "_Reckoned", way: Way, longest: float) -> float | None:
    """The delay that explains the way between fixes best, 0 where it does hardly better than none;
    None where no delay explains it.
    """
    tried = np.arange(-longest, longest + 0.5 * COARSE_S, COARSE_S)
    rough = float(tried[int(np.argmin([_misfit(way, reckoned.steps(d))[0] for d in tried]))])
    near = rough + np.arange(-COARSE_S, COARSE_S + 0.5 * FINE_S, FINE_S)
    fine = [_misfit(way, reckoned.steps(d)) for d in near]
    best = int(np.argmin([f[0] for f in fine]))
    cost, left = fine[best]
    if left > 1 - EXPLAINED:
        return None
    gained = _misfit(way, reckoned.steps(0.0))[0] - cost
    return float(near[best]) if gained > CONVINCING and abs(rough) < longest else 0.0


class _Reckoned:
    """Steps between fixes as odometer and gyro have them, (n,) m, complex: east + i north, turned
    by an unknown angle.
    """

    def __init__(self, inc: Increments, odometer: Odometer | None, time: Array, way: Way) -> None:
        up = inc.velocity.sum(0)
        turn = inc.rotation @ (up / np.linalg.norm(up))
        self._edge, self._time = inc.edge, time
        self._angle = np.concatenate([[0.0], np.cumsum(turn)])
        self._length = np.abs(way)
        self._path = None
        if odometer is not None:
            middle = 0.5 * (self._angle[1:] + self._angle[:-1])
            steps = np.diff(distance_at(odometer, inc.edge)) * np.exp(1j * middle)
            self._path = np.concatenate([[0.0], np.cumsum(steps)])

    def steps(self, delay: float) -> Way:
        """With the fixes stamped late by `delay` s."""
        if self._path is not None:
            return np.asarray(np.diff(np.interp(self._time - delay, self._edge, self._path)))
        middle = 0.5 * (self._time[1:] + self._time[:-1])
        turned = np.exp(1j * np.interp(middle - delay, self._edge, self._angle))
        return np.asarray(self._length * turned)


def _misfit(seen: Way, reckoned: Way) -> tuple[float, float]:
    """Minus log-likelihood and the share of the squared way that stays unexplained, where the
    reckoned way moves: at rest there is the fixes' noise alone, which nothing explains.
    """
    whole = len(seen) // WINDOW * WINDOW
    D, E = (x[:whole].reshape(-1, WINDOW) for x in (seen, reckoned))
    both = np.abs((D * E.conj()).sum(1))
    d2, e2 = (np.abs(D) ** 2).sum(1), (np.abs(E) ** 2).sum(1)
    gain = both.sum() / max(float(e2.sum()), ROUND_OFF)
    left = np.maximum(d2 - 2 * gain * both + gain * gain * e2, 0.0)
    cost = WINDOW * float(np.log(left / WINDOW + ROUND_OFF).sum())
    moves = e2 > WINDOW * ROUND_OFF
    return cost, float(np.median((left / (d2 + ROUND_OFF))[moves])) if moves.any() else 1.0


def _sparse(gnss: Gnss) -> Index:
    """Numbers of fixes at least about `STEP_S` apart."""
    slot = np.floor(gnss.time / STEP_S)
    return np.asarray(np.unique(slot, return_index=True)[1])


def _horizontal(gnss: Gnss, on: Index) -> Way:
    """Fixes as east + i north [m] of the first one, (n,)."""
    lat, lon = np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg)
    origin = Origin(float(lat[0]), float(lon[0]), float(gnss.height[0]))
    local = origin.local(lat[on], lon[on], gnss.height[on])
    return np.asarray(local[:, 0] + 1j * local[:, 1])
