"""A drive as a list of legs, and its commands eased from one leg to the next."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from graphnav.simulation.ellipsoid import Array

HALT = 2 / 3  # of the easing time: the wheels lock before the eased speed has run out


@dataclass(frozen=True)
class Leg:
    """A stretch of one motion state at one commanded speed and yaw rate."""

    duration: float  # s
    speed: float  # m/s, forward
    yaw_rate: float  # rad/s, left positive
    state: str


@dataclass(frozen=True)
class Commands:
    """Eased commands on the internal grid."""

    time: Array  # (M,) s
    speed: Array  # (M,) m/s, exactly 0 at rest
    yaw_rate: Array  # (M,) rad/s, left positive
    shaking: Array  # (M,) 0..1, 0 at rest
    edges: Array  # (L + 1,) s, of the legs
    legs: tuple[Leg, ...]

    def state_at(self, time: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.str_]]:
        """Name of the state in force at each time."""
        return np.array([leg.state for leg in self.legs])[leg_index(self.edges, time)]


def cut(legs: Iterable[Leg], duration: float) -> tuple[Leg, ...]:
    """As many legs as fill `duration` seconds, the last one cut short."""
    kept: list[Leg] = []
    left = duration
    for leg in legs:
        kept.append(replace(leg, duration=min(leg.duration, left)))
        left -= leg.duration
        if left <= 0:
            break
    return tuple(kept)


def leg_index(edges: Array, time: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Index of the leg each time falls in."""
    return np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)


def eased(time: Array, edges: Array, values: Sequence[float] | Array, ease: float) -> Array:
    """A value per leg, its steps rounded by a Gaussian of `ease` seconds, (M,)."""
    value = np.asarray(values, float)
    out = value[leg_index(edges, time)]
    for k, step in enumerate(np.diff(value), start=1):
        if step:
            a, b = np.searchsorted(time, [edges[k] - 5 * ease, edges[k] + 5 * ease])
            late = time[a:b] - edges[k]
            out[a:b] += step * (ndtr(late / ease) - (late >= 0))
    return out


def commands(
    time: Array, legs: tuple[Leg, ...], speed_ease: float, yaw_ease: float, halt_ease: float = 0.0
) -> Commands:
    """Legs eased into commands; at rest (`stop` legs, save their ends) everything is exactly 0.

    Locking wheels halt at once, or within `halt_ease` s.
    """
    edges = np.concatenate([[0.0], np.cumsum([leg.duration for leg in legs])])
    at_standstill = np.zeros(len(time), bool)
    calm = np.ones(len(time))
    for leg, start, end in zip(legs, edges[:-1], edges[1:], strict=True):
        if leg.state == "stop":
            begin = -np.inf if start == 0 else start + HALT * speed_ease
            finish = end - HALT * speed_ease if end < edges[-1] else np.inf
            at_standstill |= (time >= begin) & (time <= finish)
            calm *= 1 - ndtr((time - begin + 0.4) / 0.1) * ndtr((finish + 0.4 - time) / 0.1)
    moving = ~at_standstill
    speed = moving * eased(time, edges, [leg.speed for leg in legs], speed_ease)
    yaw_rate = moving * eased(time, edges, [leg.yaw_rate for leg in legs], yaw_ease)
    speed, yaw_rate = (_softened(x, halt_ease / (time[1] - time[0])) for x in (speed, yaw_rate))
    shaking = moving * calm * np.abs(speed) / (np.abs(speed) + 3.5)
    return Commands(time, speed, yaw_rate, shaking, edges, legs)


def _softened(command: Array, width: float) -> Array:
    """Twice the mean over `width` / 2 samples: rests stay exact, shorter by it at either end."""
    size = round(width / 2)
    if size < 2:
        return command
    box = np.full(size | 1, 1 / (size | 1))
    twice = np.convolve(box, box)
    return np.convolve(np.pad(command, len(twice) // 2, "edge"), twice, "valid")
