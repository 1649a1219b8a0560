"""The ellipsoid against pyins, and the frame n against its own definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyins import earth as pyins_earth
from pyins import transform

from graphnav.common import earth
from graphnav.common.earth import Origin

latitudes = st.floats(-1.57, 1.57)
longitudes = st.floats(-np.pi, np.pi)
heights = st.floats(-500, 9000)
BEIJING = Origin(np.deg2rad(40.12), np.deg2rad(116.23), 60.0)


@given(latitudes, longitudes, heights)
def test_geodetic_and_back(lat: float, lon: float, height: float) -> None:
    x_e = earth.ecef_of_geodetic(np.float64(lat), np.float64(lon), np.float64(height))
    found = earth.geodetic_of_ecef(x_e)
    np.testing.assert_allclose(found[0], lat, atol=1e-13)
    np.testing.assert_allclose(found[1:], [lon, height], atol=2e-8)


@given(latitudes, longitudes, heights)
def test_ecef_is_pyins(lat: float, lon: float, height: float) -> None:
    theirs = transform.lla_to_ecef([np.rad2deg(lat), np.rad2deg(lon), height])
    ours = earth.ecef_of_geodetic(np.float64(lat), np.float64(lon), np.float64(height))
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


@given(latitudes)
def test_gravity_on_the_ellipsoid_is_pyins(lat: float) -> None:
    ours = earth.normal_gravity(np.float64(lat), np.float64(0.0))
    assert float(ours) == pytest.approx(pyins_earth.gravity(np.rad2deg(lat), 0.0), abs=2e-9)


def test_gravity_with_height_is_the_published_one() -> None:
    """Free-air gradient at 45 degrees, 3.0844e-6 1/s^2 (Torge, Geodesy)."""
    lat = np.float64(np.pi / 4)
    fall = earth.normal_gravity(lat, np.float64(0)) - earth.normal_gravity(lat, np.float64(1))
    assert float(fall) == pytest.approx(3.0844e-6, rel=2e-3)


@given(st.floats(-3e4, 3e4), st.floats(-3e4, 3e4), st.floats(-100, 2000))
def test_local_metres_and_back(e: float, n: float, u: float) -> None:
    p_n = np.array([e, n, u])
    np.testing.assert_allclose(BEIJING.local(*BEIJING.geodetic(p_n)), p_n, atol=1e-6)


def test_axes_of_n_point_east_north_and_up() -> None:
    step = np.array([1e-6, 0.0]), np.array([0.0, 1e-6])
    lat, lon, h = BEIJING.lat, BEIJING.lon, BEIJING.height
    east = BEIJING.local(np.float64(lat), np.float64(lon + step[0][0]), np.float64(h))
    north = BEIJING.local(np.float64(lat + step[1][1]), np.float64(lon), np.float64(h))
    up = BEIJING.local(np.float64(lat), np.float64(lon), np.float64(h + 1))
    for direction, axis in zip((east, north, up), np.eye(3), strict=True):
        np.testing.assert_allclose(direction / np.linalg.norm(direction), axis, atol=2e-6)


def test_earth_turns_about_its_own_axis() -> None:
    np.testing.assert_allclose(BEIJING.R_en @ BEIJING.Omega_n, [0, 0, earth.RATE], atol=1e-20)


def test_gravity_gradient_is_the_derivative_of_gravity() -> None:
    for k, step in enumerate(10.0 * np.eye(3)):
        slope = (BEIJING.gravity(step) - BEIJING.gravity(-step)) / 20
        np.testing.assert_allclose(slope, BEIJING.gravity_gradient[:, k], atol=2.5e-8)


def test_level_axes_far_away_are_the_local_east_north_up() -> None:
    p_n = np.array([2e4, 1e4, 0.0])
    lat, lon, h = BEIJING.geodetic(p_n)
    there = Origin(float(lat), float(lon), float(h))
    level = BEIJING.level_axes(p_n)
    np.testing.assert_allclose(level @ BEIJING.gravity(p_n), there.gravity(np.zeros(3)), atol=1e-9)
    np.testing.assert_allclose(level @ BEIJING.R_en.T, there.R_en.T, atol=1e-12)
