"""Fixes as receivers and loggers write them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import driven, saved

from graphnav.common.run import Gnss
from graphnav.reading.fixes import BLIND_SD
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle

DEG_M = 1 / 111_120
SD = ["gnss_sd_e", "gnss_sd_n", "gnss_sd_u"]
Change = Callable[[pd.DataFrame], pd.DataFrame]


def read(tmp_path: Path, change: Change, scatter: float = 0.02) -> tuple[Gnss, str]:
    """Fixes of a vehicle that drives north at 10 m/s, with a change; and the notes on them."""
    tmp_path.mkdir(exist_ok=True)
    table, rng = driven(), np.random.default_rng(1)
    noise = scatter * rng.normal(size=(len(table), 2)) * DEG_M
    table["gnss_lat"] = 45.0 + 10 * table["time"] * DEG_M + noise[:, 0]
    table["gnss_lon"] = 179.9999 + np.sqrt(2) * noise[:, 1]
    table["gnss_height"] = 100.0 + scatter * rng.normal(size=len(table))
    table[SD] = max(scatter, 0.01)
    path = saved(change(table), tmp_path)
    run = read_run(path, load_vehicle(None, path))
    assert run.gnss is not None
    return run.gnss, "\n".join(run.notes)


def test_good_fixes_are_left_as_they_are(tmp_path: Path) -> None:
    found, notes = read(tmp_path, lambda t: t)
    assert len(found.time) == len(driven())
    assert notes == ""


@pytest.mark.parametrize("value", [0.0, 9999.0, 999.9, np.nan])
def test_a_deviation_that_says_unknown(tmp_path: Path, value: float) -> None:
    def some(t: pd.DataFrame) -> pd.DataFrame:
        t.loc[::2, SD] = value
        return t

    found, notes = read(tmp_path, some)
    assert set(np.round(found.sd_enu[:, 0], 3)) == {5.0, 0.02}
    assert "5 m assumed" in notes


def test_fixes_that_scatter_beyond_their_deviation(tmp_path: Path) -> None:
    found, notes = read(tmp_path, lambda t: t.assign(**dict.fromkeys(SD, 0.003)), scatter=1.5)
    np.testing.assert_allclose(np.median(found.sd_enu, axis=0), 1.5, rtol=0.4)
    assert "the scatter counts" in notes


def test_a_run_none_of_whose_fixes_can_be_is_one_without(tmp_path: Path) -> None:
    table = driven()
    north = np.where(np.arange(len(table)) % 2, 1.0, -1.0)  # two places, half each, far apart
    fixes = {"gnss_lat": 45.0 + north, "gnss_lon": 10.0, "gnss_height": 100.0}
    path = saved(table.assign(**fixes), tmp_path)
    run = read_run(path, load_vehicle(None, path))
    assert run.gnss is None
    assert any("3000 GNSS fixes are where no vehicle" in note for note in run.notes)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_fixes_without_a_height_count_horizontally(tmp_path: Path, value: float) -> None:
    def flat(t: pd.DataFrame) -> pd.DataFrame:
        t.loc[10:19, "gnss_height"] = value
        return t

    found, notes = read(tmp_path, flat)
    assert (found.sd_enu[10:20, 2] == BLIND_SD).all() and (found.sd_enu[:, :2] < 1).all()
    np.testing.assert_allclose(found.height, 100.0, atol=0.2)
    assert "10 of" in notes and "horizontally" in notes
    none, _ = read(tmp_path / "none", lambda t: t.drop(columns="gnss_height"))
    assert (none.sd_enu[:, 2] == BLIND_SD).all()


def test_absurd_fixes_are_left_out(tmp_path: Path) -> None:
    def wild(t: pd.DataFrame) -> pd.DataFrame:
        t.loc[3, "gnss_lat"], t.loc[5, "gnss_lat"] = -45.0, 4500.0
        return t

    found, notes = read(tmp_path, wild)
    assert len(found.time) == len(driven()) - 2
    assert "no vehicle can get to" in notes and "no sample" in notes


def test_the_180th_meridian(tmp_path: Path) -> None:
    def across(t: pd.DataFrame) -> pd.DataFrame:
        lon = t["gnss_lon"] + 3 * t["time"] * DEG_M
        return t.assign(gnss_lon=(lon + 180) % 360 - 180)

    found, _ = read(tmp_path, across)
    assert np.ptp(found.lon_deg) < 0.01


def test_a_receiver_that_repeats_itself_counts_once(tmp_path: Path) -> None:
    def held(t: pd.DataFrame) -> pd.DataFrame:
        place = ["gnss_lat", "gnss_lon", "gnss_height"]
        t.loc[t.index % 4 != 0, place] = np.nan
        return t.assign(**{c: t[c].ffill() for c in place})

    found, notes = read(tmp_path, held)
    assert len(found.time) == -(-len(driven()) // 4)
    assert "repeat the fix before" in notes
