"""A vehicle that drives across a slope drifts downhill."""

import numpy as np
import pytest

from factors import so3
from factors.block import ROTATION, Array
from factors.calibration import Component, Layout
from factors.mounting import mounting
from factors.side_slope import Attitude, slide_downhill

LAYOUT = Layout(
    (
        Component("mounting", np.zeros(2), np.ones(2)),
        Component("slope_drift", np.zeros(1), np.ones(1)),
    )
)
NORTH_ON_A_RIGHT_SLOPE = so3.exp(np.array([0, np.deg2rad(10), 0]))  # right side 10 deg lower
C = np.array([[0.0, 0.0, 0.1]])


def residual(R_nb: Array, slid: float) -> float:
    """Lateral, of 50 m across a slope that ended `slid` m to the right."""
    r, J_x, J_c = np.array([[slid, 0, 0]]), np.zeros((1, 3, 10)), np.zeros((1, 3, 3))
    at = Attitude(R_nb[None], mounting(C[:, :2], 0.0))
    slide_downhill(LAYOUT, C, np.array([50.0]), at, (r, J_x, J_c))
    assert not (J_x[0, 1:].any() or J_c[0, 1:].any() or r[0, 1:].any())
    assert J_x[0, 0, ROTATION].any()
    return float(r[0, 0])


@pytest.mark.parametrize("heading_deg", [0.0, 130.0])
def test_it_is_the_lower_side_it_drifts_to(heading_deg: float) -> None:
    turned = so3.exp(np.array([0, 0, np.deg2rad(heading_deg)])) @ NORTH_ON_A_RIGHT_SLOPE
    assert residual(turned, 50 * 0.1 * np.sin(np.deg2rad(10))) == pytest.approx(0, abs=1e-12)


def test_a_level_vehicle_and_one_that_climbs_do_not_drift() -> None:
    assert residual(np.eye(3), 0.0) == 0
    assert residual(so3.exp(np.array([0.3, 0, 0])), 0.0) == pytest.approx(0, abs=1e-12)
