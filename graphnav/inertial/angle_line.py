"""A straight line through angles that are known modulo a turn."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array

Complex = NDArray[np.complex128]

REWEIGHTED = 5  # rounds
TUNING = 3.0  # Cauchy's constant, in standard deviations


@dataclass(frozen=True)
class AngleLine:
    """`angle + slope t`."""

    angle: float  # rad at time zero
    sd: float  # rad, with the scatter found
    slope: float  # rad/s
    slope_sd: float  # rad/s


def angle_line(phasor: Complex, time: Array, weight: Array, slope_sd: float) -> AngleLine:
    """Robust line through the angles of phasors (n,) at times (n,) s.

    `weight` (n,) 1/rad^2; the slope is zero with `slope_sd` rad/s beforehand, and turns the angles
    by less than half a turn over the span. Cauchy weights.
    """
    mean = float(np.angle(np.sum(weight * phasor)))
    off = np.angle(phasor * np.exp(-1j * mean))
    A = np.stack([np.ones_like(time), time], -1)
    x, robust, spread = np.zeros(2), np.ones_like(off), 1.0
    H = np.eye(2)
    for _ in range(REWEIGHTED):
        w = weight * robust
        H = (A * w[:, None]).T @ A + np.diag([0.0, slope_sd**-2.0])
        x = np.linalg.solve(H, A.T @ (w * off))
        u = (off - A @ x) * np.sqrt(weight)
        spread = max(1.0, 1.4826 * float(np.median(np.abs(u))))
        robust = 1 / (1 + (u / (TUNING * spread)) ** 2)
    sd = spread * np.sqrt(np.diag(np.linalg.inv(H)))
    return AngleLine(mean + float(x[0]), float(sd[0]), float(x[1]), float(sd[1]))
