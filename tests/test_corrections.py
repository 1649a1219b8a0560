"""The table of corrections against the paper's own numbers and the rigid body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graphnav.recognition.corrections import VehicleParams, correction_table

VEHICLE = VehicleParams("tracked", 2.8, 3.84, 1.42)
TABLE = correction_table(VEHICLE)


def test_every_state_of_the_contract_has_a_row() -> None:
    assert set(TABLE) == {
        "straight_high",
        "straight_low",
        "stop",
        "turn_arc",
        "turn_pivot",
        "turn_separated",
        "turn_separated_low",
        "turn_pivot_low",
        "turn_large",
    }
    assert set(correction_table(VehicleParams("wheeled"))) == {"stop", "moving"}
    assert all(name == row.state for name, row in TABLE.items())


def test_paper_constants() -> None:
    one, still = np.ones(1), np.zeros(1)
    assert TABLE["straight_high"].forward(one, still)[0] == 1.0
    assert TABLE["straight_low"].forward(1.42 * one, still)[0] == pytest.approx(1.0)
    assert TABLE["turn_arc"].forward(one, one)[0] == pytest.approx(0.8688)
    discarded = {name for name, row in TABLE.items() if not row.use_odometer}
    assert discarded == {"turn_pivot", "turn_pivot_low", "turn_large"}


@given(
    v_y=st.floats(0.5, 15.0),
    radius=st.floats(16.0, 140.0),
    side=st.sampled_from([-1.0, 1.0]),
    way=st.sampled_from([-1.0, 1.0]),
)
def test_separated_turn_is_a23_without_the_radius(
    v_y: float, radius: float, side: float, way: float
) -> None:
    half = VEHICLE.track_gauge / 2
    v_o = way * v_y * (radius + half) / radius  # A23 solved for v_o
    yaw_rate = np.array([side * v_y / radius])
    high = TABLE["turn_separated"].forward(np.array([v_o]), yaw_rate)
    low = TABLE["turn_separated_low"].forward(np.array([1.42 * v_o]), yaw_rate)
    assert high[0] == pytest.approx(way * v_y)
    assert low[0] == pytest.approx(way * v_y)


def test_lateral_speed_has_the_sign_and_bound_of_a17() -> None:
    for row in TABLE.values():
        assert abs(row.kappa) <= 0.5  # the turning centre lies between the ends of the track
        v_x = row.lateral(np.array([0.3, -0.3]), VEHICLE.contact_length)
        assert v_x[0] <= 0 <= v_x[1]
        assert v_x[0] == -v_x[1]


def test_the_turning_centre_lies_where_track_friction_holds_it() -> None:
    """|kappa| = a_c / (2 mu g): at 1.4 m/s^2 on concrete (mu 0.7), with room for its sign."""
    turning = [row for row in TABLE.values() if row.state.startswith("turn")]
    for row in turning:
        assert row.kappa == pytest.approx(1.4 / (2 * 0.7 * 9.81), abs=0.005)
        assert row.kappa < row.kappa_sd < 2 * row.kappa
    assert {row.kappa for row in TABLE.values() if row not in turning} == {0.0}
