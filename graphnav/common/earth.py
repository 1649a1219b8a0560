"""The rotating ellipsoid: WGS 84, the local frame n at a run's origin, normal gravity in it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scalars = float | Array  # one value or many

A_WGS84 = 6378137.0  # m, semi-major axis
F_WGS84 = 1 / 298.257223563
E2_WGS84 = F_WGS84 * (2 - F_WGS84)
RATE = 7.292115e-5  # rad/s
GM = 3.986004418e14  # m^3/s^2
G_EQUATOR = 9.7803253359  # m/s^2
SOMIGLIANA = 0.00193185265241
G_STANDARD = 9.80665  # m/s^2 per g, for units only


def ecef_of_geodetic(lat: Scalars, lon: Scalars, height: Scalars) -> Array:
    """Geodetic radians and metres (...,) to ECEF (..., 3) m."""
    lat, lon, height = np.broadcast_arrays(lat, lon, height)
    normal = A_WGS84 / np.sqrt(1 - E2_WGS84 * np.sin(lat) ** 2)
    across = (normal + height) * np.cos(lat)
    z = ((1 - E2_WGS84) * normal + height) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), z], -1)


def geodetic_of_ecef(x_e: Array) -> tuple[Array, Array, Array]:
    """ECEF (..., 3) m to latitude, longitude [rad], height [m] (Bowring, two rounds: < 1e-9 m)."""
    across = np.hypot(x_e[..., 0], x_e[..., 1])
    b = A_WGS84 * (1 - F_WGS84)
    ep2 = E2_WGS84 / (1 - E2_WGS84)
    beta = np.arctan2(x_e[..., 2], (1 - F_WGS84) * across)
    for _ in range(2):
        lat = np.arctan2(
            x_e[..., 2] + ep2 * b * np.sin(beta) ** 3,
            across - E2_WGS84 * A_WGS84 * np.cos(beta) ** 3,
        )
        beta = np.arctan2((1 - F_WGS84) * np.sin(lat), np.cos(lat))
    s = np.sin(lat)
    height = across * np.cos(lat) + x_e[..., 2] * s - A_WGS84 * np.sqrt(1 - E2_WGS84 * s * s)
    return lat, np.arctan2(x_e[..., 1], x_e[..., 0]), height


def normal_gravity(lat: Scalars, height: Scalars) -> Array:
    """Magnitude of normal gravity [m/s^2] (Somigliana, second-order in height; NIMA TR8350.2)."""
    s2 = np.sin(lat) ** 2
    surface = G_EQUATOR * (1 + SOMIGLIANA * s2) / np.sqrt(1 - E2_WGS84 * s2)
    m = RATE**2 * A_WGS84**2 * A_WGS84 * (1 - F_WGS84) / GM
    h = height / A_WGS84
    return np.asarray(surface * (1 - 2 * h * (1 + F_WGS84 + m - 2 * F_WGS84 * s2) + 3 * h * h))


def enu_axes(lat: Scalars, lon: Scalars) -> Array:
    """`R_en`, east-north-up axes in ECEF as columns, (...,) -> (..., 3, 3)."""
    sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    east = np.stack([-sl, cl, np.zeros_like(sl)], -1)
    north = np.stack([-sp * cl, -sp * sl, cp], -1)
    up = np.stack([cp * cl, cp * sl, sp], -1)
    return np.stack([east, north, up], -1)


@dataclass(frozen=True)
class Origin:
    """The frame n: east-north-up at one geodetic point, fixed to the Earth."""

    lat: float  # rad
    lon: float  # rad
    height: float  # m

    @cached_property
    def R_en(self) -> Array:
        """Axes of n in ECEF, (3, 3)."""
        return enu_axes(self.lat, self.lon)

    @cached_property
    def x_e(self) -> Array:
        """The origin in ECEF, (3,) m."""
        return ecef_of_geodetic(self.lat, self.lon, self.height)

    @cached_property
    def Omega_n(self) -> Array:
        """Earth's rotation in n, (3,) rad/s."""
        return RATE * np.array([0.0, np.cos(self.lat), np.sin(self.lat)])

    @cached_property
    def gravity_gradient(self) -> Array:
        """d g_n / d p_n at the origin (spherical), (3, 3) 1/s^2: the Schuler term."""
        g = float(normal_gravity(self.lat, self.height))
        return g / A_WGS84 * np.diag([-1.0, -1.0, 2.0])

    def geodetic(self, p_n: Array) -> tuple[Array, Array, Array]:
        """Local metres (..., 3) to latitude, longitude [rad], height [m]."""
        return geodetic_of_ecef(self.x_e + p_n @ self.R_en.T)

    def local(self, lat: Array, lon: Array, height: Array) -> Array:
        """Latitude, longitude [rad], height [m] to local metres (..., 3)."""
        return (ecef_of_geodetic(lat, lon, height) - self.x_e) @ self.R_en

    def gravity(self, p_n: Array) -> Array:
        """Normal gravity vector [m/s^2] at local positions, in n, (..., 3) -> (..., 3)."""
        lat, lon, height = self.geodetic(p_n)
        up = enu_axes(lat, lon)[..., 2] @ self.R_en
        return -normal_gravity(lat, height)[..., None] * up

    def level_axes(self, p_n: Array) -> Array:
        """`R_ln`: n to the level frame at each position, where angles and velocities are told."""
        lat, lon, _ = self.geodetic(p_n)
        return np.swapaxes(enu_axes(lat, lon), -1, -2) @ self.R_en
