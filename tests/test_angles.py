"""Roll, pitch and heading as engineers say them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from graphnav.common.angles import angles_of_rotation, rotation_of_angles, wrapped

FORWARD, RIGHT, UP = np.array([0, 1.0, 0]), np.array([1.0, 0, 0]), np.array([0, 0, 1.0])


def rotation(roll: float, pitch: float, heading: float) -> np.ndarray:
    """Body to east-north-up of angles in degrees."""
    return rotation_of_angles(*np.deg2rad(np.array([roll, pitch, heading], dtype=np.float64)))


def test_heading_is_clockwise_from_north() -> None:
    np.testing.assert_allclose(rotation(0, 0, 90) @ FORWARD, [1, 0, 0], atol=1e-15)


def test_pitch_is_nose_up() -> None:
    assert (rotation(0, 10, 77) @ FORWARD)[2] == pytest.approx(np.sin(np.deg2rad(10)))


def test_roll_is_right_side_down() -> None:
    assert (rotation(10, 0, 77) @ RIGHT)[2] == pytest.approx(-np.sin(np.deg2rad(10)))


@given(st.floats(-179, 179), st.floats(-89, 89), st.floats(0, 359.9))
def test_angles_and_back(roll: float, pitch: float, heading: float) -> None:
    R = rotation(roll, pitch, heading)
    theirs = Rotation.from_euler("ZXY", [-heading, pitch, roll], degrees=True).as_matrix()
    np.testing.assert_allclose(R, theirs, atol=1e-14)
    found = np.rad2deg(angles_of_rotation(R))
    np.testing.assert_allclose(found[:2], [roll, pitch], atol=1e-6)
    assert (found[2] - heading + 180) % 360 - 180 == pytest.approx(0, abs=1e-6)
    assert 0 <= found[2] < 360


def test_straight_up_stays_finite() -> None:
    assert np.isfinite(angles_of_rotation(rotation(0, 90, 30))).all()


def test_principal_values_lie_within_half_a_turn() -> None:
    angle = np.array([-350.0, -190.0, -170.0, 0.0, 190.0, 530.0])
    np.testing.assert_allclose(wrapped(angle, 360.0), [10.0, 170.0, -170.0, 0.0, -170.0, 170.0])
    np.testing.assert_allclose(wrapped(np.deg2rad(angle)), np.deg2rad(wrapped(angle, 360.0)))
