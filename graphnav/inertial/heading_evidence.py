"""Pieces of evidence of the start heading, weighed by their sigmas and by how they agree.

Each is Gaussian, with a chance of being careless by some degrees and of being grossly wrong:
`p(h) = (1 - c - e) N(h - h_i; sd_i) + c N(h - h_i; CARELESS_SD) + e / 2 pi`.
The heading of greatest product is taken, so that many weak pieces outvote a bold one that stands
alone, and the order in which they came does not matter.
"""

from dataclasses import dataclass

import numpy as np

from graphnav.common.angles import wrapped

AGREES = 3.0  # sigma of both together
ROUNDS = 5
CARELESS_SD = np.deg2rad(10.0)


@dataclass(frozen=True)
class Evidence:
    """One source's heading of the IMU's forward axis at the start."""

    heading: float  # rad
    sd: float  # rad
    source: str  # in words
    gross: float  # chance of being wrong altogether
    careless: float = 0.0  # chance of being wrong by some degrees

    def apart(self, heading: float) -> float:
        """Signed difference from another heading [rad], at most half a turn."""
        return float(wrapped(heading - self.heading))


@dataclass(frozen=True)
class Weighed:
    """The heading all evidence makes together."""

    heading: float  # rad
    sd: float  # rad
    agreeing: tuple[Evidence, ...]  # best first
    outvoted: tuple[Evidence, ...]


def weigh(pieces: list[Evidence]) -> Weighed:
    """The most probable heading of at least one piece of evidence."""
    ordered = sorted(pieces, key=lambda piece: (piece.sd, piece.source))
    candidates = [_agreed(ordered, piece.heading) for piece in ordered]
    heading, sd = max(candidates, key=lambda c: _log_probability(ordered, c[0]))
    agreeing = tuple(p for p in ordered if _agrees(p, heading, sd))
    return Weighed(heading, sd, agreeing, tuple(p for p in ordered if p not in agreeing))


def _agrees(piece: Evidence, heading: float, sd: float) -> bool:
    return bool(abs(piece.apart(heading)) < AGREES * np.hypot(piece.sd, sd))


def _agreed(pieces: list[Evidence], heading: float) -> tuple[float, float]:
    """The weighted mean of the pieces that agree with a heading, and its sigma."""
    sd = 0.0
    for _ in range(ROUNDS):
        near = [p for p in pieces if _agrees(p, heading, sd)]
        if not near:
            break
        weight = np.array([p.sd**-2 for p in near])
        heading += float(np.average([-p.apart(heading) for p in near], weights=weight))
        sd = float(weight.sum() ** -0.5)
    return heading, sd


def _log_probability(pieces: list[Evidence], heading: float) -> float:
    total = 0.0
    for p in pieces:
        off = p.apart(heading)
        usual = (1 - p.gross - p.careless) * _normal(off, p.sd)
        loose = p.careless * _normal(off, max(CARELESS_SD, p.sd))
        total += float(np.log(usual + loose + p.gross / (2 * np.pi)))
    return total


def _normal(x: float, sd: float) -> float:
    return float(np.exp(-0.5 * (x / sd) ** 2) / (sd * np.sqrt(2 * np.pi)))
