"""How loggers and spreadsheets write a table, for tools/dirty_text.py and its test."""

import csv
import gzip
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pandas as pd

from graphnav.common.run import Run

GYRO, ACCEL = ["gyro_x", "gyro_y", "gyro_z"], ["accel_x", "accel_y", "accel_z"]
FIX = ["gnss_lat", "gnss_lon", "gnss_height"]
SENSORS = ("imu", "odometer", "sides", "gnss", "heading", "rover", "accelerometer")
UNITS = {
    "time": "s",
    "gyro": "rad/s",
    "accel": "m/s^2",
    "odo": "m/s",
    "gnss": "deg",
    "wheel": "rad/s",
}
WEEK, DAY = 604800.0, 86400.0
Rng = np.random.Generator
Made = str | bytes


@dataclass(frozen=True)
class Kind:
    """One way to write a table that reads as the plain one does."""

    make: Callable[[pd.DataFrame, Rng], Made]
    atol: float = 0.0  # what the text resolves less than the plain one
    vehicle: str = ""  # to be added to the vehicle file
    needs: tuple[str, ...] = ()  # columns it is about
    told: bool = True
    packed: bool = False


def rounded(table: pd.DataFrame) -> pd.DataFrame:
    """As a logger prints: nine digits, positions in whole 1e-7 deg."""
    return table.round(9).assign(**{n: table[n].round(7) for n in FIX[:2] if n in table})


def apart(clean: Run, dirty: Run) -> float:
    """The largest difference between arrays of two runs' sensors; infinite where one lacks any."""
    largest = 0.0
    for sensor in SENSORS:
        one, other = getattr(clean, sensor), getattr(dirty, sensor)
        if (one is None) != (other is None):
            return np.inf
        for field in fields(one) if one is not None else ():
            a, b = getattr(one, field.name), getattr(other, field.name)
            if (a is None) != (b is None):
                return np.inf
            if isinstance(a, np.ndarray):
                if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
                    return np.inf
                largest = max(largest, float(np.nanmax(np.abs(a - b), initial=0.0)))
    return largest


def text(table: pd.DataFrame, **how: Any) -> str:
    """As pandas writes it."""
    return str(table.to_csv(index=False, **how))


def lines(table: pd.DataFrame) -> list[str]:
    """Header and rows."""
    return text(table).splitlines()


def _blanks(word: str) -> Kind:
    return Kind(lambda t, _: text(t, na_rep=word))


def _with_comments(t: pd.DataFrame, rng: Rng) -> str:
    found = ["# logger 3.1", "", *lines(t)]
    for at in sorted(rng.integers(4, len(found), 20), reverse=True):
        found.insert(at, "# marker, driver says: bump")
    return "\n".join(found)


def _damaged(t: pd.DataFrame, rng: Rng) -> str:
    """One line in two hundred is half a line or noise; it is not in the clean run."""
    found = lines(t)
    for at in sorted(rng.integers(2, len(found) - 1, len(found) // 200), reverse=True):
        found.insert(at, found[at][: rng.integers(1, 30)].replace(",", ";") + "\x00\ufffd")
    return "\n".join(found)


def _some_commas(t: pd.DataFrame, rng: Rng) -> str:
    return "\n".join(line + "," * (i > 0 and rng.random() < 0.3) for i, line in enumerate(lines(t)))


def _units(t: pd.DataFrame) -> str:
    row = ",".join(UNITS.get(name.split("_")[0], "1") for name in t)
    return text(t).replace("\n", f"\n{row}\n", 1)


def _own_rows(t: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    own = [name for name in names if name in t]
    there = t[own].notna().any(axis=1)
    return pd.concat([t.drop(columns=own), t.loc[there, ["time", *own]]])


def _late_rows(t: pd.DataFrame, rng: Rng) -> str:
    """Fixes on rows of their own, written up to 0.1 s late."""
    own = t.loc[t["gnss_lat"].notna(), ["time", *FIX]]
    written = pd.concat([t.drop(columns=FIX).assign(at=t["time"]),
                         own.assign(at=own["time"] + rng.uniform(0, 0.1))])  # fmt: skip
    return text(written.sort_values("at", kind="stable").drop(columns="at"))


def _since_start(t: pd.DataFrame) -> "pd.Series[float]":
    return t["time"] - t["time"].iloc[0]


def _at_night(form: str, atol: float, sep: str = ",") -> Kind:
    """Times written as `form` says, from four seconds before midnight on."""

    def make(t: pd.DataFrame, _: Rng) -> str:
        since = pd.to_timedelta((_since_start(t) * 1e6).round().astype(int), unit="us")
        moments = pd.Timestamp("2024-05-01T23:59:56") + since
        return text(t.assign(time=[f"{moment:{form}}" for moment in moments]), sep=sep)

    return Kind(make, atol)


def _begun_anew(t: pd.DataFrame, period: float) -> str:
    return text(t.assign(time=((_since_start(t) + period - 4) % period).round(6)))


def _twice(t: pd.DataFrame, rng: Rng) -> pd.DataFrame:
    return pd.concat([t, t.iloc[rng.integers(0, len(t), 50)]]).sort_values("time")


def _in_parts(t: pd.DataFrame) -> pd.DataFrame:
    return t.assign(**{name: (t[name] * 1e7).round() for name in FIX[:2]})


def _increments(gyro: str, accel: str) -> Kind:
    def make(t: pd.DataFrame, _: Rng) -> str:
        step = np.diff(t["time"])
        usual = np.median(step)
        step = np.concatenate([[usual], np.where(step > 1.5 * usual, usual, step)])
        return text(t.assign(**{name: t[name] * step for name in [*GYRO, *ACCEL]}))

    units = f'[columns]\ngyro = {{ unit = "{gyro}" }}\naccel = {{ unit = "{accel}" }}\n'
    return Kind(make, 1e-11, units, ("gyro_x",), told=False)


KINDS = {
    "semicolons": Kind(lambda t, _: text(t, sep=";")),
    "tabs": Kind(lambda t, _: text(t, sep="\t")),
    "decimal commas": Kind(lambda t, _: text(t, sep=";", decimal=",")),
    "decimal commas and tabs": Kind(lambda t, _: text(t, sep="\t", decimal=",")),
    "quoted decimal commas": Kind(lambda t, _: text(t, decimal=",")),
    "blanks between": Kind(lambda t, _: text(t, sep=" ", na_rep="nan")),
    "Excel's first line": Kind(lambda t, _: "sep=;\n" + text(t, sep=";")),
    "UTF-16": Kind(lambda t, _: text(t).encode("utf-16")),
    "UTF-16 without a mark": Kind(lambda t, _: text(t).encode("utf-16-le")),
    "UTF-8 with a mark": Kind(lambda t, _: text(t).encode("utf-8-sig"), told=False),
    "lines of old Macs": Kind(lambda t, _: text(t).replace("\n", "\r").encode(), told=False),
    "lines of Windows": Kind(lambda t, _: text(t, lineterminator="\r\n"), told=False),
    "every cell quoted": Kind(lambda t, _: text(t, quoting=csv.QUOTE_ALL), told=False),
    "blanks after commas": Kind(lambda t, _: text(t).replace(",", ", "), told=False),
    "gzip": Kind(lambda t, _: gzip.compress(text(t, sep=";", decimal=",").encode()), packed=True),
    "None": _blanks("None"),
    ".nan": _blanks(".nan"),
    "#N/A": _blanks("#N/A"),
    "-1.#IND": _blanks("-1.#IND"),
    "inf": _blanks("inf"),
    "comments": Kind(_with_comments),
    "header in a comment": Kind(lambda t, _: "# " + text(t)),
    "units under the header": Kind(lambda t, _: _units(t)),
    "trailing commas": Kind(lambda t, _: "\n".join(line + "," for line in lines(t))),
    "trailing commas of rows": Kind(
        lambda t, _: "\n".join([lines(t)[0], *(x + "," for x in lines(t)[1:])])
    ),
    "some trailing commas": Kind(_some_commas),
    "damaged lines": Kind(_damaged),
    "gyros on rows of their own": Kind(
        lambda t, _: text(_own_rows(t, GYRO).sort_values("time")), needs=("gyro_x", "accel_x")
    ),
    "one sensor after the other": Kind(lambda t, _: text(_own_rows(t, ACCEL)), needs=("accel_x",)),
    "rows twice": Kind(lambda t, rng: text(_twice(t, rng))),
    "late rows": Kind(_late_rows, needs=("gnss_lat",)),
    # clocks that stand at another value lose a float's last digits
    "week roll-over": Kind(lambda t, _: _begun_anew(t, WEEK), 1e-9),
    "midnight": Kind(lambda t, _: _begun_anew(t, DAY), 1e-9),
    "1e-7 deg": Kind(lambda t, _: text(_in_parts(t)), needs=("gnss_lat",)),
    "ISO times": _at_night("%Y-%m-%dT%H:%M:%S.%f", 5e-6),
    "ISO times in a zone": _at_night("%Y-%m-%d %H:%M:%S.%f+02:00", 5e-6),
    "ISO times to commas": _at_night("%Y-%m-%d %H:%M:%S,%f", 5e-6, sep=";"),
    "ISO times run together": _at_night("%Y%m%dT%H%M%S.%fZ", 5e-6),
    "times of the day": _at_night("%H:%M:%S.%f", 1e-9),
    "increments": _increments("rad", "m/s"),
    "increments by name": _increments("rad/sample", "m/s/sample"),
    # two and three of them at once
    "Excel's text in UTF-16": Kind(
        lambda t, _: text(t, sep=";", decimal=",", na_rep="#N/A").encode("utf-16")
    ),
    "tabs and comments": Kind(lambda t, rng: _with_comments(t, rng).replace(",", "\t")),
    "roll-over, 1e-7 deg, .nan": Kind(
        lambda t, _: _begun_anew(_in_parts(t), WEEK).replace(",,", ",.nan,"), 1e-9,
        needs=("gnss_lat",),
    ),
    "own rows and None": Kind(
        lambda t, _: text(_own_rows(t, GYRO).sort_values("time")).replace(",,", ",None,"),
        needs=("gyro_x", "accel_x"),
    ),
    "twice with quoted commas": Kind(lambda t, rng: text(_twice(t, rng), decimal=",")),
}  # fmt: skip
