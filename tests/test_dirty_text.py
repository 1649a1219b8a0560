"""Dirty text read as the clean run is: to the bit, or to the resolution of the text."""

import gzip
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
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

SEEDS = range(5)
GYRO, ACCEL = ["gyro_x", "gyro_y", "gyro_z"], ["accel_x", "accel_y", "accel_z"]
Dirty = Callable[[pd.DataFrame, np.random.Generator], Any]


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


def assert_same(a: Run, b: Run, atol: float = 0.0) -> None:
    """Every array of every sensor alike."""
    for sensor in ("imu", "odometer", "gnss"):
        one, other = getattr(a, sensor), getattr(b, sensor)
        for field in fields(one):
            if getattr(one, field.name) is None:
                continue
            np.testing.assert_allclose(
                getattr(other, field.name), getattr(one, field.name), rtol=0, atol=atol
            )


def text(table: pd.DataFrame, **how: Any) -> str:
    return str(table.to_csv(index=False, **how))


def lines(table: pd.DataFrame) -> list[str]:
    return text(table).splitlines()


def blanks(word: str) -> Dirty:
    return lambda t, _: text(t, na_rep=word)


def with_comments(t: pd.DataFrame, rng: np.random.Generator) -> str:
    found = ["# logger 3.1", "", *lines(t)]
    for at in sorted(rng.integers(4, len(found), 20), reverse=True):
        found.insert(at, "# marker, driver says: bump")
    return "\n".join(found)


def damaged(t: pd.DataFrame, rng: np.random.Generator) -> str:
    """One line in two hundred is half a line or noise; it is not in the clean run."""
    found = lines(t)
    for at in sorted(rng.integers(2, len(found) - 1, len(found) // 200), reverse=True):
        found.insert(at, found[at][: rng.integers(1, 30)].replace(",", ";") + "\x00\ufffd")
    return "\n".join(found)


def some_commas(t: pd.DataFrame, rng: np.random.Generator) -> str:
    return "\n".join(line + "," * (i > 0 and rng.random() < 0.3) for i, line in enumerate(lines(t)))


def rows_of_their_own(t: pd.DataFrame, _: np.random.Generator) -> str:
    return text(pd.concat([t.drop(columns=GYRO), t[["time", *GYRO]]]).sort_values("time"))


def sensor_after_sensor(t: pd.DataFrame, _: np.random.Generator) -> str:
    return text(pd.concat([t.drop(columns=ACCEL), t[["time", *ACCEL]]]))


def late_rows(t: pd.DataFrame, rng: np.random.Generator) -> str:
    """Fixes on rows of their own, written up to 0.1 s late."""
    fix = ["gnss_lat", "gnss_lon", "gnss_height"]
    own = t.loc[t["gnss_lat"].notna(), ["time", *fix]]
    written = pd.concat([t.drop(columns=fix).assign(at=t["time"]),
                         own.assign(at=own["time"] + rng.uniform(0, 0.1))])  # fmt: skip
    return text(written.sort_values("at", kind="stable").drop(columns="at"))


def at_night(t: pd.DataFrame, form: str) -> str:
    """Times written as `form` says, from four seconds before midnight on."""
    moments = pd.Timestamp("2024-05-01T23:59:56") + pd.to_timedelta(
        (t["time"] * 1e6).round().astype(int), unit="us"
    )
    return text(t.assign(time=[f"{moment:{form}}" for moment in moments]))


def begun_anew(t: pd.DataFrame, period: float) -> str:
    return text(t.assign(time=((t["time"] + period - 4) % period).round(6)))


def twice(t: pd.DataFrame, rng: np.random.Generator) -> str:
    again = t.iloc[rng.integers(0, len(t), 50)]
    return text(pd.concat([t, again]).sort_values("time"))


def in_whole_parts(t: pd.DataFrame, _: np.random.Generator) -> str:
    return text(t.assign(**{n: (t[n] * 1e7).round() for n in ("gnss_lat", "gnss_lon")}))


UNITS = "\ns,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2,m/s,deg,deg,m\n"
KINDS: dict[str, Dirty] = {
    "semicolons": lambda t, _: text(t, sep=";"),
    "tabs": lambda t, _: text(t, sep="\t"),
    "decimal commas": lambda t, _: text(t, sep=";", decimal=","),
    "decimal commas and tabs": lambda t, _: text(t, sep="\t", decimal=","),
    "quoted decimal commas": lambda t, _: text(t, decimal=","),
    "blanks between": lambda t, _: text(t, sep=" ", na_rep="nan"),
    "Excel's first line": lambda t, _: "sep=;\n" + text(t, sep=";"),
    "UTF-16": lambda t, _: text(t).encode("utf-16"),
    "UTF-16 without a mark": lambda t, _: text(t).encode("utf-16-le"),
    "UTF-8 with a mark": lambda t, _: text(t).encode("utf-8-sig"),
    "lines of old Macs": lambda t, _: text(t).replace("\n", "\r").encode(),
    "gzip": lambda t, _: gzip.compress(text(t, sep=";", decimal=",").encode()),
    "None": blanks("None"),
    ".nan": blanks(".nan"),
    "#N/A": blanks("#N/A"),
    "-1.#IND": blanks("-1.#IND"),
    "inf": blanks("inf"),
    "comments": with_comments,
    "header in a comment": lambda t, _: "# " + text(t),
    "units under the header": lambda t, _: text(t).replace("\n", UNITS, 1),
    "trailing commas": lambda t, _: "\n".join(line + "," for line in lines(t)),
    "trailing commas of rows": lambda t, _: "\n".join(
        [lines(t)[0], *(x + "," for x in lines(t)[1:])]
    ),
    "some trailing commas": some_commas,
    "damaged lines": damaged,
    "gyros on rows of their own": rows_of_their_own,
    "one sensor after the other": sensor_after_sensor,
    "rows twice": twice,
    "late rows": late_rows,
    "week roll-over": lambda t, _: begun_anew(t, 604800),
    "midnight": lambda t, _: begun_anew(t, 86400),
    "1e-7 deg": in_whole_parts,
    "ISO times": lambda t, _: at_night(t, "%Y-%m-%dT%H:%M:%S.%f"),
    "ISO times in a zone": lambda t, _: at_night(t, "%Y-%m-%d %H:%M:%S.%f+02:00"),
    "times of the day": lambda t, _: at_night(t, "%H:%M:%S.%f"),
    # two and three of them at once
    "Excel's text in UTF-16": lambda t, _: text(t, sep=";", decimal=",", na_rep="#N/A").encode(
        "utf-16"
    ),
    "tabs and comments": lambda t, rng: with_comments(t, rng).replace(",", "\t"),
    "roll-over, 1e-7 deg, .nan": lambda t, rng: begun_anew(
        t.assign(**{n: (t[n] * 1e7).round() for n in ("gnss_lat", "gnss_lon")}), 604800
    ).replace(",,", ",.nan,"),
    "own rows and None": lambda t, rng: rows_of_their_own(t, rng).replace(",,", ",None,"),
    "twice with quoted commas": lambda t, rng: text(
        pd.concat([t, t.iloc[rng.integers(0, len(t), 50)]]).sort_values("time"), decimal=","
    ),
}
# clocks that stand at another value lose a float's last digits
TO_THE_CLOCKS_RESOLUTION = {"week roll-over": 1e-9, "roll-over, 1e-7 deg, .nan": 1e-9,
                            "midnight": 1e-9, "times of the day": 1e-9,
                            "ISO times": 5e-6, "ISO times in a zone": 5e-6}  # fmt: skip
UNTOLD = {"UTF-8 with a mark", "lines of old Macs"}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_dirty_text_reads_as_the_clean_run(tmp_path: Path, kind: str, seed: int) -> None:
    table = recorded(seed)
    clean = read(saved(table, tmp_path))
    dirty = KINDS[kind](table, np.random.default_rng(seed))
    packed = kind == "gzip"
    path = tmp_path / ("dirty.csv.gz" if packed else "dirty.csv")
    path.write_bytes(dirty if isinstance(dirty, bytes) else dirty.encode())
    again = read(path)
    assert_same(clean, again, TO_THE_CLOCKS_RESOLUTION.get(kind, 0.0))
    if kind not in UNTOLD:
        assert set(again.notes) - set(clean.notes)


@pytest.mark.parametrize("seed", SEEDS[:1])
@pytest.mark.parametrize("kind", ["comments", "damaged lines", "ISO times", "None"])
def test_a_text_taken_apart_block_by_block_reads_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, seed: int
) -> None:
    path = tmp_path / "dirty.csv"
    path.write_text(str(KINDS[kind](recorded(seed), np.random.default_rng(seed))))
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    whole = read(path)
    monkeypatch.setattr(dirty_text, "BLOCK", 2000)
    blocks = read(path)
    assert_same(whole, blocks)
    assert blocks.notes == whole.notes
    dialect = dialect_of(path, path.read_bytes())
    with path.open() as file:
        sizes = [len(block.numbers) for block in cells_of(file, dialect, ["time"], "", LeftOut())]
    assert len(sizes) > 10 and max(sizes) < 100


def test_increments_become_rates(tmp_path: Path) -> None:
    table = recorded(3)
    clean = read(saved(table, tmp_path))
    gained = table.copy()
    gained[GYRO + ACCEL] *= 0.02
    for gyro, accel in (("rad", "m/s"), ("rad/sample", "m/s/sample")):
        units = f'[columns]\ngyro = {{ unit = "{gyro}" }}\naccel = {{ unit = "{accel}" }}\n'
        again = read(saved(gained, tmp_path, VEHICLE + units))
        assert_same(clean, again, 1e-11)


def test_an_increment_before_a_loss_is_of_one_sample(tmp_path: Path) -> None:
    table = recorded(3)
    clean = read(saved(table.drop(index=range(200, 210)), tmp_path))
    table[GYRO] *= 0.02
    units = '[columns]\ngyro = { unit = "rad" }\n'
    again = read(saved(table.drop(index=range(200, 210)), tmp_path, VEHICLE + units))
    assert_same(clean, again, 1e-11)


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
    assert_same(clean, read(path), 1e-5)


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
