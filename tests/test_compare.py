"""Comparison with truth: known errors are found, and honest deviations are called honest."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphnav.common.earth import Origin
from graphnav.common.errors import InputError
from graphnav.reading.truth import read_trajectory, read_truth
from graphnav.result.compare import compare

ORIGIN = Origin(np.deg2rad(45.0), np.deg2rad(10.0), 100.0)


def geodetic(p_n: np.ndarray) -> dict[str, np.ndarray]:
    lat, lon, height = ORIGIN.geodetic(p_n)
    return {"lat": np.rad2deg(lat), "lon": np.rad2deg(lon), "height": height}


def drive(step: float, duration: float = 100.0) -> pd.DataFrame:
    """A straight drive to the north-east at 10 m/s, heading swaying about north."""
    time = np.arange(0, duration + step / 2, step)
    way = 10 * time / np.sqrt(2)
    p_n = np.stack([way, way, np.zeros_like(way)], -1)
    heading = 10 * np.sin(time / 5) % 360
    return pd.DataFrame({"time": time, **geodetic(p_n), "heading_deg": heading})


def moved(table: pd.DataFrame, offset: np.ndarray) -> pd.DataFrame:
    """The table with its positions displaced by `offset` (3,) or (N, 3) m in n."""
    lat, lon = np.deg2rad(table["lat"].to_numpy()), np.deg2rad(table["lon"].to_numpy())
    p_n = ORIGIN.local(lat, lon, table["height"].to_numpy())
    return table.assign(**geodetic(p_n + offset))


def test_nothing_is_wrong_with_truth_itself() -> None:
    found = compare(drive(0.1), drive(1.0))
    assert found.horizontal_max_m < 1e-4  # straight in n, sampled: the ellipsoid's curve
    assert found.heading_rms_deg is not None
    assert found.heading_rms_deg < 1e-3
    assert found.share_of_truth_matched == 1.0
    assert found.nees_horizontal is None
    assert found.state_accuracy is None


@settings(max_examples=30)
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50))
def test_a_displacement_is_found_as_it_is(e: float, n: float, u: float) -> None:
    found = compare(moved(drive(0.1), np.array([e, n, u])), drive(1.0))
    size = np.hypot(e, n)
    assert found.horizontal_rms_m == pytest.approx(size, abs=1e-2)
    assert found.horizontal_max_m == pytest.approx(size, abs=1e-2)
    assert found.horizontal_end_m == pytest.approx(size, abs=1e-2)
    assert found.height_rms_m == pytest.approx(abs(u), abs=1e-2)


def test_worst_end_and_permille() -> None:
    offset = np.zeros((1001, 3))
    offset[400:601, 0] = 5.0
    offset[990:, 1] = -2.0
    found = compare(moved(drive(0.1), offset), drive(1.0))
    assert found.horizontal_max_m == pytest.approx(5.0, abs=1e-3)
    assert found.horizontal_end_m == pytest.approx(2.0, abs=1e-3)
    assert found.distance_m == pytest.approx(1000.0, abs=1e-2)
    assert found.permille_of_distance == pytest.approx(5.0, abs=1e-2)
    share = (21 * 25 + 2 * 4) / 101  # 40..60 s, 99 and 100 s
    assert found.horizontal_rms_m == pytest.approx(np.sqrt(share), rel=1e-3)


def test_heading_across_north() -> None:
    truth = drive(1.0)
    ahead = drive(0.1)
    ahead["heading_deg"] = (ahead["heading_deg"] + 1.5) % 360
    found = compare(ahead, truth)
    assert found.heading_rms_deg == pytest.approx(1.5, abs=1e-3)


def test_velocity_error_is_the_norm() -> None:
    zero = {"v_e": 0.0, "v_n": 0.0, "v_u": 0.0}
    off = {"v_e": 0.3, "v_n": 0.4, "v_u": 1.2}
    found = compare(drive(0.1).assign(**off), drive(1.0).assign(**zero))
    assert found.velocity_rms_m_s == pytest.approx(1.3)


def test_only_shared_time_counts() -> None:
    result = drive(0.1)
    found = compare(result[(result["time"] >= 20) & (result["time"] <= 70)], drive(1.0))
    assert found.share_of_truth_matched == pytest.approx(51 / 101)
    assert found.distance_m == pytest.approx(500, abs=1e-2)


def test_no_shared_time_is_an_error() -> None:
    late = drive(0.1)
    with pytest.raises(InputError, match="share no time"):
        compare(late.assign(time=late["time"] + 1000), drive(1.0))


@pytest.mark.parametrize("seed", range(4))
def test_honest_deviations_are_called_honest(seed: int) -> None:
    truth = drive(0.05, 200.0)
    sd_e, sd_n, corr, sd_heading = 2.0, 0.5, 0.8, 0.3
    cov = [[sd_e**2, corr * sd_e * sd_n], [corr * sd_e * sd_n, sd_n**2]]
    rng = np.random.default_rng(seed)
    offset = np.zeros((len(truth), 3))
    offset[:, :2] = rng.multivariate_normal([0, 0], cov, len(truth))
    result = moved(truth, offset).assign(
        sd_e=sd_e, sd_n=sd_n, corr_en=corr, sd_heading_deg=sd_heading,
        heading_deg=truth["heading_deg"] + rng.normal(0, sd_heading, len(truth)),
    )  # fmt: skip
    found = compare(result, truth)
    count = len(truth)
    assert found.nees_horizontal == pytest.approx(2.0, abs=4 * 2 / np.sqrt(count))
    assert found.nees_heading == pytest.approx(1.0, abs=4 * np.sqrt(2 / count))
    assert found.nees_horizontal_inside_95 == pytest.approx(0.95, abs=0.02)
    assert found.nees_heading_inside_95 == pytest.approx(0.95, abs=0.02)
    vain = compare(result.assign(sd_e=sd_e / 2, sd_n=sd_n / 2), truth)
    assert vain.nees_horizontal == pytest.approx(8.0, rel=0.15)


def test_states_near_a_change_do_not_count() -> None:
    truth = drive(0.1)
    truth["state"] = np.where(truth["time"] < 50, "stop", "moving")
    late = truth.assign(state=np.where(truth["time"] < 50.8, "stop", "moving"))
    assert compare(late, truth).state_accuracy == 1.0
    later = truth.assign(state=np.where(truth["time"] < 56, "stop", "moving"))
    found = compare(later, truth)
    assert found.state_accuracy == pytest.approx(1 - 50 / 981, abs=2e-3)  # 51 to 56 of 98.1 s
    assert found.state_f1 is not None
    assert found.state_f1["stop"] < 1.0
    assert found.state_f1["moving"] < 1.0


def test_a_state_never_there_has_no_score_to_gain() -> None:
    truth = drive(0.1).assign(state="stop")
    found = compare(drive(0.1).assign(state="turn_arc"), truth)
    assert found.state_accuracy == 0.0
    assert found.state_f1 == {"stop": 0.0, "turn_arc": 0.0}


def test_truth_file_round_trip(tmp_path: Path) -> None:
    truth = drive(1.0).assign(state="stop", other=3.0)
    truth.loc[3, "lat"] = np.nan
    path = tmp_path / "truth.csv.gz"
    truth.to_csv(path, index=False)
    read = read_truth(path)
    assert list(read.columns) == ["time", "lat", "lon", "height", "heading_deg", "state"]
    assert len(read) == len(truth) - 1
    assert compare(drive(0.1), read).horizontal_max_m < 1e-4


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"lat": "latitude"}, "no column 'lat'.*nearest is 'latitude'"),
        ({"height": "alt"}, "no column 'height'"),
    ],
)
def test_truth_without_its_columns(tmp_path: Path, change: dict[str, str], part: str) -> None:
    path = tmp_path / "truth.csv"
    drive(1.0).rename(columns=change).to_csv(path, index=False)
    with pytest.raises(InputError, match=part):
        read_truth(path)


def test_truth_out_of_order(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    drive(1.0).iloc[::-1].to_csv(path, index=False)
    with pytest.raises(InputError, match="time goes backwards at line 3"):
        read_truth(path)


def test_trajectories_read_from_directory_or_file(tmp_path: Path) -> None:
    table = drive(0.5).assign(state="stop")
    table.to_parquet(tmp_path / "trajectory.parquet")
    table.to_csv(tmp_path / "other.csv", index=False)
    for path in (tmp_path, tmp_path / "other.csv"):
        read = read_trajectory(path)
        assert set(read["state"]) == {"stop"}
        np.testing.assert_allclose(read["lat"], table["lat"])


def test_truth_of_another_place_does_not_fit_but_a_far_result_does() -> None:
    """333 km away it is another run's; a result that is off by the size of the drive is judged."""
    with pytest.raises(InputError, match="truth lies 333 km from the result"):
        compare(drive(1.0), drive(1.0).assign(lat=lambda t: t["lat"] + 3.0))
    assert compare(moved(drive(1.0), np.array([9e3, 0, 0])), drive(1.0)).horizontal_rms_m > 8e3
