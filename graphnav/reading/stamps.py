"""Stamps as they are read: times written as text, and counters of seconds that begin anew.

Plain numbers are read like any column in `table_file`, `time` with its unit in `samples`; rows are
brought into the order of their stamps in `row_order`. When an IMU's samples were taken, as far as
late stamps tell, is found in `inertial/sample_clock`.
"""

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from graphnav.reading.cell_words import DATED, OF_DAY, trimmed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# seconds after which clocks begin anew: GNSS week, day, half a day, hour, and counters of 32 bits
PERIODS = {"a week": 604800.0, "a day": 86400.0, "half a day": 43200.0, "an hour": 3600.0,
           "32 bits of ms": 2**32 * 1e-3, "32 bits of us": 2**32 * 1e-6}  # fmt: skip
ACROSS_S = 60.0  # the longest gap over which a clock that begins anew is followed


def times_of(words: pa.Array) -> tuple[Array, Mask, str] | None:
    """Times written as text in seconds (N,), which cells are none (N,), and what to say.

    ISO 8601 becomes seconds since 1970 (UTC), a time of day seconds since midnight. None where
    most cells are neither.
    """
    import pandas as pd

    words = pc.fill_null(trimmed(words), "")
    words = pc.replace_substring(words, ",", ".")
    series = pd.Series(words.to_pandas())
    if _share(words, DATED) > 0.5:
        zone = (
            "as they say" if _share(words, r".*(Z|UTC|[+-]\d{2}:?\d{2})") > 0.5 else "taken as UTC"
        )
        dated = series.where(series.str.fullmatch(DATED))  # of a bare year pandas makes a date too
        moments = pd.to_datetime(dated, format="ISO8601", utc=True, errors="coerce")
        since = (moments - pd.Timestamp(0, tz="UTC")).dt
        note = f"times are ISO 8601, {zone}: read as seconds since 1970"
    elif _share(words, OF_DAY) > 0.5:
        since = pd.to_timedelta(series, errors="coerce").dt
        note = "times are of the day: read as seconds since midnight"
    else:
        return None
    seconds = _seconds(since)
    return seconds, np.isnan(seconds), note


def _seconds(since: "pd.core.indexes.accessors.TimedeltaProperties") -> Array:  # type: ignore[name-defined]  # noqa: F821
    """Whole seconds and their fraction, so that nothing is rounded twice."""
    whole = since.days.to_numpy(float) * 86400.0 + since.seconds.to_numpy(float)
    parts = since.microseconds.to_numpy(float) * 1e3 + since.nanoseconds.to_numpy(float)
    return np.asarray(whole + parts * 1e-9)


def _share(words: pa.Array, pattern: str) -> float:
    fits = pc.match_substring_regex(words, f"^({pattern})$")
    return float(pc.mean(pc.cast(fits, pa.float64())).as_py() or 0.0)


def unrolled(clock: Array) -> tuple[Array, str | None]:
    """A clock (N,) s that begins anew after a known period, counted on; and what to say of it.

    Only where the last time before lies at the period's end and the next at its beginning.
    """
    back = np.flatnonzero(np.diff(clock) < 0)
    if not len(back) or clock.min() < 0:
        return clock, None
    for name, period in PERIODS.items():
        across = back[(clock[back] > period - ACROSS_S) & (clock[back + 1] < ACROSS_S)]
        step = clock[across + 1] + period - clock[across]
        across = across[(step > 0) & (step < ACROSS_S)]
        if len(across) and clock.max() <= period:
            turns = np.zeros(len(clock))
            turns[across + 1] = period
            note = (
                f"the clock begins anew after {clock[across[0]]:.15g} ({name}): "
                f"{period:.15g} s are added from there on"
            )
            return clock + np.cumsum(turns), note
    return clock, None
