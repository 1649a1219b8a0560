"""Robust weight functions of the standardised residual, per axis (D2, D3).

Each maps |u| (...,) to a weight in 0..1 with `w = psi(u) / u`; the solver multiplies squared rows.
A side slip thus loses its lateral row and keeps its forward speed. `m_estimator` gives the same
family to GTSAM graphs of the user's own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Name = Literal["none", "huber", "cauchy", "geman_mcclure", "igg3"]


@dataclass(frozen=True)
class Robust:
    """A weight function with its constants in standard deviations.

    `k0` is the tuning constant of Huber, Cauchy and Geman-McClure and the end of IGG-III's
    full-weight zone; `k1` is where IGG-III reaches zero.
    """

    name: Name = "igg3"
    k0: float = 2.0
    k1: float = 6.0

    def weight(self, u: Array) -> Array:
        """Weights of standardised residuals, same shape."""
        return _FAMILY[self.name](np.abs(u), self.k0, self.k1)

    def loss(self, u: Array) -> Array:
        """What the weights are the slope of, `integral of u w(u)`, same shape."""
        return _LOSS[self.name](np.abs(u), self.k0, self.k1)

    def m_estimator(self) -> gtsam.noiseModel.mEstimator.Base:
        """The same weights as a GTSAM M-estimator."""
        m = gtsam.noiseModel.mEstimator
        if self.name == "none":
            return m.Null.Create()
        if self.name == "huber":
            return m.Huber.Create(self.k0)
        if self.name == "cauchy":
            return m.Cauchy.Create(self.k0)
        if self.name == "geman_mcclure":
            return m.GemanMcClure.Create(self.k0)
        return m.Custom.Create(
            lambda u: float(self.weight(np.array(u))),
            lambda u: float(self.loss(np.array(u))),
        )


def none(u: Array, k0: float, k1: float) -> Array:
    """Least squares: `w = 1`."""
    return np.ones_like(u)


def huber(u: Array, k0: float, k1: float) -> Array:
    """`w = min(1, k0 / u)`: convex."""
    return k0 / np.maximum(u, k0)


def cauchy(u: Array, k0: float, k1: float) -> Array:
    """`w = 1 / (1 + (u / k0)^2)`: redescending, never quite zero."""
    return 1 / (1 + (u / k0) ** 2)


def geman_mcclure(u: Array, k0: float, k1: float) -> Array:
    """`w = (k0^2 / (k0^2 + u^2))^2`: strongly redescending."""
    return (k0**2 / (k0**2 + u**2)) ** 2


def igg3(u: Array, k0: float, k1: float) -> Array:
    """D3: 1 up to k0, `k0/u ((k1 - u)/(k1 - k0))^2` up to k1, 0 beyond."""
    fading = (np.clip(k1 - u, 0, k1 - k0) / (k1 - k0)) ** 2
    return np.where(u <= k0, 1.0, k0 / np.maximum(u, k0) * fading)


def igg3_loss(u: Array, k0: float, k1: float) -> Array:
    """The loss whose weight is IGG-III, in closed form."""
    left = (k1 - np.clip(u, k0, k1)) / (k1 - k0)  # 1 to 0, exactly 1 where nothing fades
    return np.asarray(0.5 * np.minimum(u, k0) ** 2 + k0 * (k1 - k0) / 3 * (1.0 - left**3))


_FAMILY: dict[Name, Callable[[Array, float, float], Array]] = {
    "none": none,
    "huber": huber,
    "cauchy": cauchy,
    "geman_mcclure": geman_mcclure,
    "igg3": igg3,
}
_LOSS: dict[Name, Callable[[Array, float, float], Array]] = {
    "none": lambda u, k0, k1: 0.5 * u**2,
    "huber": lambda u, k0, k1: 0.5 * np.minimum(u, k0) ** 2 + k0 * np.maximum(u - k0, 0.0),
    "cauchy": lambda u, k0, k1: 0.5 * k0**2 * np.log1p((u / k0) ** 2),
    "geman_mcclure": lambda u, k0, k1: 0.5 * k0**2 * u**2 / (k0**2 + u**2),
    "igg3": igg3_loss,
}
