"""The simulator at other sample rates, and its rotations."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from graphnav.simulation import DRIVES, Options, simulate
from graphnav.simulation.rotation import about, single


@pytest.mark.parametrize("scenario", sorted(DRIVES))
def test_twice_the_rate_is_the_same_drive_seen_twice_as_often(scenario: str) -> None:
    slow, fast = (
        DRIVES[scenario](Options(7, duration=450.0, rate_hz=rate)).truth for rate in (100, 200)
    )
    np.testing.assert_allclose(fast.time[::2], slow.time, atol=1e-12)
    np.testing.assert_array_equal(fast.lla[::2], slow.lla)
    np.testing.assert_allclose(fast.gyro.reshape(-1, 2, 3).mean(1), slow.gyro, atol=1e-12)
    np.testing.assert_allclose(fast.accel.reshape(-1, 2, 3).mean(1), slow.accel, atol=1e-9)


def test_other_sensors_and_truth_keep_their_own_rates(tmp_path: Path) -> None:
    options = {"duration": 450.0, "slips": True, "gnss": True, "rate_hz": 200}
    out = simulate("wheeled", tmp_path / "car", 5, **options)
    run, truth = pd.read_csv(out / "run.csv.gz"), pd.read_csv(out / "truth.csv.gz")
    assert len(run) == 200 * 450 and np.allclose(np.diff(run["time"]), 0.005)
    assert np.allclose(np.diff(run["time"][run["odo_speed"].notna()]), 0.1)
    assert np.allclose(np.diff(run["time"][run["gnss_lat"].notna()]), 1.0)
    assert np.allclose(np.diff(truth["time"]), 0.1)


def test_white_noise_grows_with_the_root_of_the_rate(tmp_path: Path) -> None:
    sd = []
    for rate in (100, 200):
        out = simulate("wheeled", tmp_path / f"{rate}", 5, duration=450.0, rate_hz=rate)
        gyro = pd.read_csv(out / "run.csv.gz")["gyro_z"].to_numpy()[: 10 * rate]  # standing
        sd.append(gyro.std())
    assert sd[1] / sd[0] == pytest.approx(np.sqrt(2), rel=0.1)


def test_rotations_agree_with_scipy() -> None:
    rng = np.random.default_rng(0)
    z, x, v = rng.uniform(-3, 3, 50), rng.uniform(-1.4, 1.4, 50), rng.standard_normal((50, 3))
    ours = about("z", z) * about("x", x) * single(np.array([0.01, -0.02, 0.003]))
    theirs = Rotation.from_euler("ZX", np.stack([z, x], -1))
    theirs = theirs * Rotation.from_rotvec([0.01, -0.02, 0.003])
    np.testing.assert_allclose(ours.apply(v), theirs.apply(v), atol=1e-14)
    np.testing.assert_allclose(ours.matrices(), theirs.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(ours.rotvec(), theirs.as_rotvec(), atol=1e-13)
