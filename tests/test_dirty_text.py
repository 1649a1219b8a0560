"""Dirty text read as the clean run is: to the bit, or to the resolution of the text.

One seed of small files; tools/dirty_text.py takes many, of every kind of vehicle.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from dirty_kinds import ACCEL, GYRO, KINDS, apart
from runs import VEHICLE, driven, saved

from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.reading import dirty_text
from graphnav.reading.dialect import dialect_of
from graphnav.reading.dirty_text import cells_of
from graphnav.reading.left_out import LeftOut
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle


def read(path: Path) -> Run:
    return read_run(path, load_vehicle(None, path))


def recorded(seed: int) -> pd.DataFrame:
    """A drive with fixes of whole 1e-7 deg, printed as a logger prints."""
    rng = np.random.default_rng(seed)
    table = driven(8, seed=seed).round(9)
    at = np.arange(len(table)) % 50 == 7
    lat, lon = 45 + 0.01 * rng.random(len(table)), 110 + 0.01 * rng.random(len(table))
    fix = {"gnss_lat": lat.round(7), "gnss_lon": lon.round(7), "gnss_height": 100.5}
    return table.assign(**{name: np.where(at, value, np.nan) for name, value in fix.items()})


@pytest.mark.parametrize("name", KINDS)
def test_dirty_text_reads_as_the_clean_run(tmp_path: Path, name: str) -> None:
    kind, table = KINDS[name], recorded(0)
    clean = read(saved(table, tmp_path))
    dirty = kind.make(table, np.random.default_rng(0))
    path = tmp_path / ("dirty.csv.gz" if kind.packed else "dirty.csv")
    path.write_bytes(dirty if isinstance(dirty, bytes) else dirty.encode())
    (tmp_path / "vehicle.toml").write_text(VEHICLE + kind.vehicle)
    again = read(path)
    assert apart(clean, again) <= kind.atol
    if kind.told:
        assert set(again.notes) - set(clean.notes)


@pytest.mark.parametrize("kind", ["comments", "damaged lines", "ISO times", "None"])
def test_a_text_taken_apart_block_by_block_reads_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    path = tmp_path / "dirty.csv"
    path.write_text(str(KINDS[kind].make(recorded(0), np.random.default_rng(0))))
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    whole = read(path)
    monkeypatch.setattr(dirty_text, "BLOCK", 2000)
    blocks = read(path)
    assert apart(whole, blocks) == 0
    assert blocks.notes == whole.notes
    dialect = dialect_of(path, path.read_bytes())
    with path.open() as file:
        sizes = [len(block.numbers) for block in cells_of(file, dialect, ["time"], "", LeftOut())]
    assert len(sizes) > 10 and max(sizes) < 100


def test_an_increment_before_a_loss_is_of_one_sample(tmp_path: Path) -> None:
    table = recorded(3)
    clean = read(saved(table.drop(index=range(200, 210)), tmp_path))
    table[GYRO] *= 0.02
    units = '[columns]\ngyro = { unit = "rad" }\n'
    again = read(saved(table.drop(index=range(200, 210)), tmp_path, VEHICLE + units))
    assert apart(clean, again) <= 1e-11


def test_accelerometers_at_times_of_their_own_lose_no_velocity(tmp_path: Path) -> None:
    table = recorded(1)
    late = table[["time", *ACCEL]].assign(time=table["time"] + 0.005)
    run = read(saved(pd.concat([table.drop(columns=ACCEL), late]).sort_values("time"), tmp_path))
    clean = read(saved(table, tmp_path))
    assert run.imu is not None and clean.imu is not None
    assert len(run.imu.time) == len(clean.imu.time) - 1
    gained = np.cumsum(run.imu.accel * run.imu.dt[:, None], axis=0)[-1]
    true = np.cumsum(clean.imu.accel[1:] * clean.imu.dt[1:, None], axis=0)[-1]
    np.testing.assert_allclose(gained, true, atol=0.02)
    assert any("rows of their own" in note for note in run.notes)


def test_parquet_with_timestamps(tmp_path: Path) -> None:
    table = recorded(0)
    clean = read(saved(table, tmp_path))
    moments = pd.Timestamp("2024-05-01") + pd.to_timedelta(table["time"], unit="s").dt.round("us")
    path = tmp_path / "run.parquet"
    table.assign(time=moments).to_parquet(path)
    assert apart(clean, read(path)) <= 1e-5


def test_a_dirty_truth_is_read_too(tmp_path: Path) -> None:
    truth = pd.DataFrame({"time": np.arange(0.0, 9.0), "lat": 45.5, "lon": 10.25, "height": 1.5,
                          "state": ["stop", "moving", ""] * 3})  # fmt: skip
    path = tmp_path / "truth.csv"
    path.write_text("# reference\n" + truth.iloc[::-1].sort_values("time").to_csv(
        index=False, sep=";", decimal=","))  # fmt: skip
    pd.testing.assert_frame_equal(
        read_truth(path).astype({"state": object}), truth.astype({"state": object})
    )


def test_a_number_among_iso_times_is_a_damaged_line(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    rows = [f"2024-05-01T12:00:{k % 60:02d}.{k // 60}00Z,45,10,1.5" for k in range(60)]
    path.write_text("\n".join(["time,lat,lon,height", "1037,45,10,1.5", *rows * 1]))
    with pytest.raises(InputError, match="line 2: time is '1037'"):
        read_truth(path)
