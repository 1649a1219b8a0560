"""Heading from the whole path: odometer and gyro held against all fixes, at any speed.

The path reckoned at heading zero and the path of the fixes are cut into slots; from one slot to the
next each moves by a displacement, and the angle between the two displacements is the heading at the
start plus what the gyro's bias has turned it since. Which heading `phi` and rate `b` explain all
slots is read off the peak of

    S(phi, b) = sum_k w_k Re( exp(-i phi) D_fix,k conj(D_k(b)) / max(|D_fix,k|, |D_k(b)|)^2 )

over a grid of `b`: no start value, no order, and a wild fix or a ferry costs its own slots only.
A robust line about the peak gives the standard deviation.
Source: a periodogram of unit phasors (maximum likelihood of von Mises angles, Mardia & Jupp 2000).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from factors.block import Index
from graphnav.common.run import Array
from graphnav.inertial.angle_line import Complex, angle_line

STEP_S = 0.2  # between samples of the reckoned path
SLOTS_S = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # lengths of a slot that are tried
COUNTED = 4  # fixes of a slot whose errors count as independent
CLEAR = 3.0  # sigma that a displacement must be clear of the fixes' errors
BESIDE, WILD = 5, 5.0  # fixes that vouch for each other, and sigma they may be apart
FLOOR = np.deg2rad(2.0)  # of a slot's angle: slip, levelling, antenna and odometer lever arms
SPAN_S = 600.0  # of the run over which one rate explains the slots
FASTEST_BIAS = np.deg2rad(6.0)  # rad/s; no gyro in use is worse
APART_S = 64.0  # between slots that still make a displacement
TRACKED_S = 30.0  # over which the heading's wander along the run is averaged
FEW = 9  # fixes that tell where the path begins
SCALE_SD = 0.05  # of an odometer that is not calibrated yet
FEWEST = 3  # slots that make a heading


@dataclass(frozen=True)
class Reckoned:
    """The horizontal path reckoned from a heading of zero (north)."""

    time: Array  # (n,) s, every `STEP_S`
    speed: Array  # (n,) m/s
    angle: Array  # (n,) rad, turned to the left since the start

    def path(self, rate: float) -> Complex:
        """East + i north [m] with the gyro's error `rate` rad/s (to the left) taken off, (n,)."""
        turned = self.angle - rate * (self.time - self.time[0])
        velocity = self.speed * np.exp(1j * turned) * 1j
        step = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(self.time)
        return np.concatenate([[0], np.cumsum(step)])


@dataclass(frozen=True)
class PathHeading:
    """What the fixes say of the reckoned path's direction."""

    heading: float  # rad, of the direction of travel at the start of the run
    sd: float  # rad
    rate: float  # rad/s to the left that the gyro reads too much
    rate_sd: float  # rad/s
    time: Array  # (K,) s, middles of the slots
    turn: Array  # (K,) rad to the left the path still wants beyond heading and rate
    agreement: float  # of the slots on one heading, 0 to 1
    begin: complex  # m, east + i north of the start by the first fixes, in their frame
    begin_sd: float  # m


@dataclass(frozen=True)
class _Displacements:
    """Displacements between neighbouring slots of fixes."""

    at: Index  # (F,) sample of the reckoned path at each fix
    owner: Index  # (F,) slot of each fix
    count: Array  # (S,) fixes in each slot
    pick: Index  # (K,) first slot of the displacements in use
    moved: Complex  # (K,) m, by the fixes
    time: Array  # (K,) s, middle
    weight: Array  # (K,) 1/rad^2
    fixes: Complex  # (F,) m
    sd: Array  # (F,) m

    def mean(self, values: Complex) -> Complex:
        """Mean of a quantity at the fixes (F,) in each slot, (S,)."""
        real = np.bincount(self.owner, values.real) / self.count
        return np.asarray(real + 1j * np.bincount(self.owner, values.imag) / self.count)

    def phasors(self, path: Complex) -> Complex:
        """How the fixes' displacements lie to a path's, at most 1 long, (K,)."""
        reckoned = np.diff(self.mean(path[self.at]))[self.pick]
        size = np.maximum(np.abs(reckoned), np.abs(self.moved)) ** 2
        return np.asarray(self.moved * reckoned.conj() / size)


def path_heading(
    reckoned: Reckoned, fixes: Complex, time: Array, sd: Array, bias_sd: float
) -> PathHeading | None:
    """The heading that lays the reckoned path on the fixes, or None where they hardly move.

    `fixes` (F,) east + i north [m] at `time` (F,) with `sd` (F,) m; `bias_sd` rad/s, one sigma of
    the gyro's error about the vertical as far as it is not removed.
    """
    slots = _best_slots(reckoned, fixes, time, sd)
    if slots is None:
        return None
    first = slots.time <= slots.time[0] + SPAN_S
    rate, phasor = _peak(reckoned, slots, first, bias_sd)
    since = slots.time - reckoned.time[0]
    line = angle_line(phasor[first], since[first], slots.weight[first], bias_sd)
    left = phasor * np.exp(-1j * (line.angle + line.slope * since))
    wander = _tracked(left, slots.weight, slots.time)
    agreement = abs(np.sum(slots.weight[first] * left[first])) / np.sum(slots.weight[first])
    error = rate - line.slope
    begin, begin_sd = _begin(reckoned.path(error) * np.exp(1j * line.angle), line.sd, slots)
    return PathHeading(
        -line.angle,
        line.sd,
        error,
        line.slope_sd,
        slots.time,
        wander,
        float(agreement),
        begin,
        begin_sd,
    )


def _begin(path: Complex, heading_sd: float, slots: _Displacements) -> tuple[complex, float]:
    """Where the first fixes put the start along the path, and its sigma."""
    few = slice(0, FEW)
    way = path[slots.at[few]]
    there = slots.fixes[few] - way
    begin = complex(np.median(there.real), np.median(there.imag))
    off = float(np.abs(way).max()) * float(np.hypot(heading_sd, SCALE_SD))
    return begin, float(np.hypot(off, np.median(slots.sd[few])))


def _best_slots(
    reckoned: Reckoned, fixes: Complex, time: Array, sd: Array
) -> _Displacements | None:
    """Slots of the length that tells most; None where no length has enough of them."""
    inside = (time >= reckoned.time[0]) & (time <= reckoned.time[-1])
    fixes, time, sd = fixes[inside], time[inside], sd[inside]
    if len(time) < FEWEST + 1:
        return None
    tame = _tame(reckoned, fixes, time, sd)
    fixes, time, sd = fixes[tame], time[tame], sd[tame]
    tried = [_slots(reckoned, fixes, time, sd, length) for length in SLOTS_S]
    best = max(tried, key=lambda s: float(s.weight.sum()))
    return best if len(best.pick) >= FEWEST else None


def _tame(reckoned: Reckoned, fixes: Complex, time: Array, sd: Array) -> NDArray[np.bool_]:
    """Fixes no further from the median of their neighbours than the vehicle can have come, (F,)."""
    median = median_filter(fixes.real, BESIDE) + 1j * median_filter(fixes.imag, BESIDE)
    way = np.interp(time, reckoned.time, np.cumsum(np.abs(reckoned.speed)) * STEP_S)
    wide = np.arange(len(way))
    reach = (
        way[np.minimum(wide + BESIDE // 2, len(way) - 1)] - way[np.maximum(wide - BESIDE // 2, 0)]
    )
    tame = np.abs(fixes - median) < reach + WILD * sd
    return tame if tame.mean() > 0.5 else np.ones(len(fixes), bool)


def _slots(
    reckoned: Reckoned, fixes: Complex, time: Array, sd: Array, length: float
) -> _Displacements:
    owner = np.unique(np.floor(time / length), return_inverse=True)[1]
    count = np.bincount(owner).astype(np.float64)
    own_sd = np.sqrt(np.bincount(owner, sd**2) / count / np.minimum(count, COUNTED))
    at = np.clip(np.searchsorted(reckoned.time, time), 0, len(reckoned.time) - 1)
    middle = np.bincount(owner, time) / count
    empty = np.zeros(0)
    none = empty.astype(np.complex128)
    whole = _Displacements(at, owner, count, np.arange(0), none, empty, empty, fixes, sd)
    moved: Complex = np.diff(whole.mean(fixes)).astype(np.complex128)
    way = np.abs(np.diff(whole.mean(reckoned.path(0.0)[at])))
    noise = np.hypot(own_sd[1:], own_sd[:-1])
    shorter = np.minimum(np.abs(moved), way)
    pick = np.flatnonzero((shorter > CLEAR * noise) & (np.diff(middle) < APART_S))
    weight = 1 / ((noise[pick] / shorter[pick]) ** 2 + FLOOR**2)
    if len(pick):  # wild fixes, slipping or carried wheels: not as far as the others
        ratio = np.abs(moved[pick]) / way[pick]
        ratio /= np.median(ratio)
        weight *= np.minimum(ratio, 1 / ratio) ** 2
    time = 0.5 * (middle[1:] + middle[:-1])[pick]
    return _Displacements(at, owner, count, pick, moved[pick], time, weight, fixes, sd)


def _peak(
    reckoned: Reckoned, slots: _Displacements, on: NDArray[np.bool_], bias_sd: float
) -> tuple[float, Complex]:
    """The rate [rad/s] at which all slots agree best on one heading, and their phasors there."""
    span = float(slots.time[on][-1] - reckoned.time[0]) + 1.0
    half = int(np.ceil(FASTEST_BIAS * span * 2 / np.pi))
    rates = FASTEST_BIAS * np.arange(-half, half + 1) / half

    def phasors(rate: float) -> Complex:
        return slots.phasors(reckoned.path(rate))

    def agreement(rate: float) -> float:
        together = abs(np.sum(slots.weight[on] * phasors(rate)[on]))
        return float(together) - 0.5 * (rate / bias_sd) ** 2

    best = max(rates.tolist(), key=agreement)
    for step in FASTEST_BIAS / half * 0.5 ** np.arange(1, 5):
        best = max((best - step, best, best + step), key=agreement)
    return best, phasors(best)


def _tracked(phasor: Complex, weight: Array, time: Array) -> Array:
    """The angle of the phasors (K,) averaged over `TRACKED_S`, without jumps of a turn, (K,)."""
    total = np.concatenate([[0], np.cumsum(weight * phasor)])
    begin = np.minimum(np.searchsorted(time, time - TRACKED_S / 2), np.arange(len(time)))
    end = np.searchsorted(time, time + TRACKED_S / 2, side="right")
    return np.unwrap(np.angle(total[end] - total[begin]))
