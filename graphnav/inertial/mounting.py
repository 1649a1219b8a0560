"""How the IMU lies in the vehicle: any rotation, from gravity and from what driving makes it feel.

Gravity's mean names the vertical. In the horizontal plane, as complex numbers right + i forward,

    f = c a,   a = -v w + i dv/dt,   c = |c| e^(i alpha)

`a` is what the speed v and the turn rate w say the vehicle feels (A4), `f` what the IMU felt: alpha
is by how much the IMU is turned about the vertical. Where `f = c conj(a)` fits better, left and
right are exchanged: such axes are no rotation of the vehicle's.
"""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.preintegration import Increments
from graphnav.common.run import Array
from graphnav.inertial.angle_line import Complex

SLOTS_S = (1.0, 2.0, 4.0)  # over which accelerations are averaged; the length that tells most
FEWEST = 10  # slots
SIZE = (0.15, 6.0)  # of |c|: an odometer in km/h makes 0.28, in mph 0.45; 1 when all is right
EXPLAINED = 0.3  # of the felt force's variance, at least
WORST_SD = np.deg2rad(15.0)  # a front known worse is not known
USUAL = 0.3  # m/s^2, hills and bumps in the mean of a slot
# share of the centripetal force that the speed does not tell, and what that may turn the front by
ROLLING, ROLLING_SD = 0.2, np.deg2rad(1.0)
SKIDDING, SKIDDING_SD = 1.0, np.deg2rad(3.0)
REWEIGHTED = 6  # rounds
LAGS = 5  # slots that share hills
MIRRORED = 1.7  # times less is left unexplained by exchanged sides


@dataclass(frozen=True)
class Lie:
    """The vehicle's axes in the IMU's, as felt."""

    R_mb: Array  # (3, 3) from the IMU's axes to right-forward-up of the vehicle
    front_sd: float  # rad, about the vertical; inf where driving does not tell where the front is
    mirrored: bool = False  # left and right are exchanged


@dataclass(frozen=True)
class _Fit:
    """`f = c a` or, mirrored, `f = c conj(a)`."""

    alpha: float  # rad
    sd: float  # rad
    size: float  # |c|
    left: float  # share of the force's variance that is not explained
    mirrored: bool

    @property
    def tells(self) -> bool:
        return self.left < 1 - EXPLAINED and SIZE[0] < self.size < SIZE[1] and self.sd < WORST_SD


def lie(inc: Increments, speed: Array | None, skids: bool = False) -> Lie:
    """How the IMU lies, from increments and the speed (M + 1,) m/s at their edges.

    `skids`: the vehicle turns by its tracks, whose speed is not its own then (A17-A23).
    """
    unsure, least = (SKIDDING, SKIDDING_SD) if skids else (ROLLING, ROLLING_SD)
    R_lb = upright(inc)
    if speed is None:
        return Lie(R_lb, np.inf)
    pairs = [pair for length in SLOTS_S if (pair := _fits(inc, speed, R_lb, length, unsure))]
    better = [
        mirror if proper.left > MIRRORED * mirror.left else proper for proper, mirror in pairs
    ]
    telling = [fit for fit in better if fit.tells]
    if not telling:
        return Lie(R_lb, np.inf)
    best = min(telling, key=lambda fit: fit.sd)
    # conj(a) is -a with right and left exchanged
    alpha = best.alpha + np.pi if best.mirrored else best.alpha
    turn = so3.exp(np.array([0.0, 0.0, -alpha]))
    return Lie(turn @ R_lb, float(np.hypot(best.sd, least)), best.mirrored)


def upright(inc: Increments) -> Array:
    """The least rotation (3, 3) that turns the mean specific force of a run upright."""
    up = inc.velocity.sum(0)
    up = up / np.linalg.norm(up)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    size = float(np.linalg.norm(axis))
    if size < 1e-9:
        return np.eye(3) if up[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(so3.exp(axis / size * np.arctan2(size, up[2])))


def _fits(
    inc: Increments, speed: Array, R_lb: Array, length: float, unsure: float
) -> tuple[_Fit, _Fit] | None:
    """Both fits over slots of a length; None where there are too few of them."""
    edges = np.unique(np.searchsorted(inc.edge, np.arange(inc.edge[0], inc.edge[-1], length)))
    if len(edges) < FEWEST:
        return None
    first, last = edges[:-1], int(edges[-1])
    dt, T = np.diff(inc.edge)[:last], np.diff(inc.edge[edges])
    way = 0.5 * (speed[1:] + speed[:-1])[:last] * dt

    def mean(x: Array) -> Array:
        return np.asarray(np.add.reduceat(x, first) / T)

    force = inc.velocity[:last] @ R_lb.T
    felt = mean(force[:, 0]) + 1j * mean(force[:, 1])
    turn = mean(inc.rotation[:last] @ R_lb[2])
    driven = -mean(way) * turn + 1j * np.diff(speed[edges]) / T
    on = T / length < 1.5  # no gap in it
    felt, driven = felt[on], driven[on]
    if np.ptp(driven.real) + np.ptp(driven.imag) == 0:
        return None
    weight = 1 / (1 + (unsure * driven.real / USUAL) ** 2)
    return _fit(felt, driven, weight, False), _fit(felt, driven.conj(), weight, True)


def _fit(felt: Complex, driven: Complex, trust: Array, mirrored: bool) -> _Fit:
    """Least squares with Cauchy weights beside `trust` (n,), about the weighted means.

    The sigma is the sandwich estimate with the correlation of neighbouring slots, which share
    hills (Newey and West 1987).
    """
    weight = trust
    for _ in range(REWEIGHTED):
        f = felt - np.average(felt, weights=weight)
        a = driven - np.average(driven, weights=weight)
        power = float(np.sum(weight * np.abs(a) ** 2)) + 1e-12
        c = complex(np.sum(weight * a.conj() * f)) / power
        error = f - c * a
        spread = float(np.median(np.abs(error))) + 1e-6
        used, weight = weight, trust / (1 + (np.abs(error) / (3 * spread)) ** 2)
    size = max(abs(c), 1e-12)
    pull = used * (a.conj() * error * c.conjugate()).imag / (size**2 * power)  # on alpha
    shared = sum((1 - k / LAGS) * float(pull[k:] @ pull[:-k]) for k in range(1, LAGS))
    own = used * np.abs(a) ** 2
    few = float(own.sum()) ** 2 / float(own @ own)  # slots that carry the answer
    variance = max(float(pull @ pull) + 2 * shared, 0.25 * float(pull @ pull))
    variance *= np.inf if few < FEWEST else 1 + FEWEST / few
    left = float(used @ np.abs(error) ** 2) / max(float(used @ np.abs(f) ** 2), 1e-12)
    return _Fit(float(np.angle(c)), float(np.sqrt(variance)), size, left, mirrored)
