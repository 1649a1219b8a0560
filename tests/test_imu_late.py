"""Whose clock is late: a receiver stamps no fix before it is taken."""

import numpy as np
import pytest

from graphnav.batch.learnt import imu_late, verdicts
from graphnav.result.solved import Calibrated


def delay(value: float, sd: float) -> list[Calibrated]:
    one = np.ones((1, 1))
    return [
        Calibrated(
            name="gnss_time_offset_s", unit="s", components=("fixes",), constant=True,
            time=np.zeros(1), value=value * one, sd=sd * one,
            prior=np.zeros(1), prior_sd=np.full(1, 0.1),
        )
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "sd", "late"),
    [(0.3, 0.01, 0.0), (-0.06, 0.01, 0.06), (-0.06, 0.03, 0.0), (-1.2, 0.01, 0.0)],
)
def test_fixes_that_come_early_tell_of_an_imu_that_is_late(
    value: float, sd: float, late: float
) -> None:
    assert imu_late(delay(value, sd)) == late


def test_it_is_told_whose_clock_is_late() -> None:
    assert verdicts(delay(0.3, 0.01)) == ["fixes come 0.30 +- 0.01 s late"]
    assert (
        "the fixes come 0.06 +- 0.01 s early, the IMU's stamps late"
        in verdicts(delay(-0.06, 0.01))[0]
    )
    assert verdicts(delay(-0.01, 0.01)) == []
    assert "1.20 +- 0.01 s early: told on the clock of the IMU" in verdicts(delay(-1.2, 0.01))[0]
