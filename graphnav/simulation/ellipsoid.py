"""The rotating WGS 84 ellipsoid as the simulator sees it: inertial axes, no smoother's equations.

i is inertial, equal to the Earth-fixed frame at time 0. Gravity is Somigliana's, linear in height,
the model of pyins, by which the simulator is checked.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE = 7.292115e-5  # rad/s
A = 6378137.0  # m
E2 = 6.6943799901413e-3
G_EQUATOR, G_POLE = 9.7803253359, 9.8321849378  # m/s^2
G_STANDARD = 9.80665  # m/s^2 per g


def radii(lat: Array, height: Array) -> tuple[Array, Array]:
    """Radii of curvature at height [m], along the meridian and across it; latitude in rad."""
    x = 1 - E2 * np.sin(lat) ** 2
    across = A / np.sqrt(x)
    return across * (1 - E2) / x + height, across + height


def geodetic(start: Array, v_n: Array, dt: float) -> Array:
    """Latitude, longitude [rad], height [m] (N, 3) by the trapezoid of ENU velocities (N, 3).

    The trapezoid is the truth by definition: velocity is linear between the nodes.
    """

    def summed(rate: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(rate[1:] + rate[:-1]) * (dt / 2)])

    height = start[2] + summed(v_n[:, 2])
    lat = np.full(len(v_n), start[0])
    for _ in range(3):  # the radius hardly changes over a drive: the second round moves < 1e-6 m
        lat = start[0] + summed(v_n[:, 1] / radii(lat, height)[0])
    across = radii(lat, height)[1]
    lon = start[1] + summed(v_n[:, 0] / (across * np.cos(lat)))
    return np.stack([lat, lon, height], -1)


def inertial_position(lla: Array, time: Array) -> Array:
    """Position (N, 3) m in inertial axes."""
    lat, height, lon_i = lla[:, 0], lla[:, 2], lla[:, 1] + RATE * time
    across = radii(lat, np.zeros_like(lat))[1]
    p = (across + height) * np.cos(lat)
    z = ((1 - E2) * across + height) * np.sin(lat)
    return np.stack([p * np.cos(lon_i), p * np.sin(lon_i), z], -1)


def gravitation(lla: Array) -> Array:
    """Gravitation (N, 3) m/s^2 in local axes: normal gravity without the centrifugal part."""
    lat, height = lla[:, 0], lla[:, 2]
    s2 = np.sin(lat) ** 2
    k = np.sqrt(1 - E2) * G_POLE / G_EQUATOR - 1
    gravity = G_EQUATOR * (1 + k * s2) / np.sqrt(1 - E2 * s2) * (1 - 2 * height / A)
    axis_distance = radii(lat, height)[1] * np.cos(lat)
    pull = RATE**2 * axis_distance
    north, down = pull * np.sin(lat), gravity + pull * np.cos(lat)
    return np.stack([np.zeros_like(lat), north, -down], -1)
