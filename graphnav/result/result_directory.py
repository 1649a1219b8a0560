"""A result directory read back: all that recordings, reports and exports are made from."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from factors import so3
from graphnav.common.angles import rotation_of_angles, wrapped
from graphnav.common.earth import Origin
from graphnav.common.errors import InputError
from graphnav.result.writing import restore

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]
Index = NDArray[np.intp]

TRAJECTORY_COLUMNS = [
    "time", "lat", "lon", "height", "e", "n", "u", "v_e", "v_n", "v_u", "v_x", "v_y", "v_z",
    "roll_deg", "pitch_deg", "heading_deg", "sd_e", "sd_n", "sd_u", "sd_v_e", "sd_v_n", "sd_v_u",
    "sd_roll_deg", "sd_pitch_deg", "sd_heading_deg", "state",
]  # fmt: skip
STATE_COLUMNS = ["start", "end", "state"]
RUN_AGAIN = "run `graphnav smooth` again"


@dataclass(frozen=True, eq=False)
class Curve:
    """One calibration quantity: K components at T times (T = 1 when constant), 1-sigma `sd`."""

    name: str
    unit: str
    components: tuple[str, ...]
    constant: bool
    time: Array  # (T,) s, the file's clock
    value: Array  # (T, K)
    sd: Array  # (T, K)
    prior: Array  # (K,), NaN where none
    prior_sd: Array  # (K,)
    observable: tuple[bool, ...]

    def at(self, time: Array) -> tuple[Array, Array]:
        """Value and sd held or interpolated at `time` (N,): two (N, K)."""
        pairs = ((self.value[:, k], self.sd[:, k]) for k in range(len(self.components)))
        both = [(np.interp(time, self.time, v), np.interp(time, self.time, s)) for v, s in pairs]
        return np.stack([v for v, _ in both], -1), np.stack([s for _, s in both], -1)


@dataclass(frozen=True, eq=False)
class Results:
    """One result directory. Times are on the run file's own clock; absent tables are None."""

    directory: Path
    trajectory: "DataFrame"
    states: "DataFrame"  # start, end, state (+ probability)
    summary: dict[str, Any]
    calibration: dict[str, Curve]
    events: "DataFrame | None" = None
    odometer: "DataFrame | None" = None
    dead_reckoning: "DataFrame | None" = None
    gnss: "DataFrame | None" = None
    truth: "DataFrame | None" = None
    residuals: "DataFrame | None" = None
    causal: "DataFrame | None" = None
    validation: dict[str, Any] | None = None  # what `graphnav validate` found

    @cached_property
    def time(self) -> Array:
        """Trajectory times (N,) s, the file's clock."""
        return columns(self.trajectory, "time")[:, 0]

    @cached_property
    def clock_start(self) -> float:
        """The file's clock where recordings and reports put 0."""
        starts = columns(self.states, "start")[:1, 0]
        return float(min([self.time[0], *starts]))

    @cached_property
    def title(self) -> str:
        """The run in a few words that tell it from others: its folder and file, `folder/run`.

        A rejected one is marked, wherever it is named.
        """
        run = Path(str(self.summary.get("run", self.directory.name)))
        folder = run.parent.name or self.directory.resolve().parent.name
        mark = " REJECTED" * (self.quality.get("grade") == "rejected")
        return f"{folder}/{run.name.split('.')[0]}{mark}"

    @property
    def quality(self) -> dict[str, Any]:
        """How far the result can be relied on; empty in results of before it was judged."""
        return dict(self.summary.get("quality") or {})

    @cached_property
    def origin(self) -> Origin:
        """Frame n; the first trajectory row says where it lies when the summary does not."""
        origin = self.summary.get("origin")
        if origin:
            return Origin(
                np.radians(origin["lat"]), np.radians(origin["lon"]), float(origin["height"])
            )
        lat, lon, height, *p_n = columns(self.trajectory, "lat", "lon", "height", "e", "n", "u")[0]
        first = Origin(np.radians(lat), np.radians(lon), float(height))
        back = first.geodetic(-np.array(p_n))
        return Origin(float(back[0]), float(back[1]), float(back[2]))

    @cached_property
    def p_n(self) -> Array:
        """Positions of the IMU (N, 3) m, ENU."""
        return columns(self.trajectory, "e", "n", "u")

    @cached_property
    def R_nb(self) -> Array:
        """Attitude (N, 3, 3) in n; the file tells angles in the level frame on the spot."""
        angles = np.radians(columns(self.trajectory, "roll_deg", "pitch_deg", "heading_deg"))
        return np.asarray(
            so3.transpose(self.origin.level_axes(self.p_n)) @ rotation_of_angles(*angles.T)
        )


def columns(frame: "DataFrame", *names: str) -> Array:
    """Columns of a table as float64 (N, K)."""
    return np.asarray(frame[list(names)].to_numpy(dtype=np.float64))


def thin(count: int, limit: int) -> Index:
    """At most about `limit` evenly spaced indices into `count` rows, both ends included."""
    if count <= limit:
        return np.arange(count)
    return np.unique(np.rint(np.linspace(0, count - 1, limit)).astype(np.intp))


def state_spans(results: Results) -> list[tuple[str, int, int]]:
    """`(state, first, last)` trajectory rows of each state; neighbours share a row: lines join."""
    edges = np.searchsorted(results.time, columns(results.states, "start", "end"))
    last = len(results.time) - 1
    spans = zip(results.states["state"], edges[:, 0], edges[:, 1], strict=True)
    joined = ((str(s), min(int(a), last), min(int(b), last)) for s, a, b in spans)
    return [span for span in joined if span[2] > span[1]]


def errors_against_truth(results: Results) -> "DataFrame | None":
    """Smoothed minus truth at the truth's own times inside the run, with the solution's sd.

    Columns `time e n u horizontal sd_e sd_n sd_u` and, when truth knows it, `heading_deg
    sd_heading_deg`; None without truth.
    """
    if results.truth is None:
        return None
    import pandas as pd

    inside = results.truth["time"].between(results.time[0], results.time[-1])
    truth = results.truth[inside]
    time = columns(truth, "time")[:, 0]

    def smoothed(name: str) -> Array:
        return np.interp(time, results.time, columns(results.trajectory, name)[:, 0])

    out = {"time": time} | {k: smoothed(k) - columns(truth, k)[:, 0] for k in "enu"}
    out["horizontal"] = np.hypot(out["e"], out["n"])
    out |= {f"sd_{k}": smoothed(f"sd_{k}") for k in "enu"}
    if "heading_deg" in truth:
        unwrapped = np.unwrap(columns(results.trajectory, "heading_deg")[:, 0], period=360.0)
        heading = np.interp(time, results.time, unwrapped) - columns(truth, "heading_deg")[:, 0]
        out["heading_deg"] = wrapped(heading, 360.0)
        out["sd_heading_deg"] = smoothed("sd_heading_deg")
    return pd.DataFrame(out)


def load(directory: Path) -> Results:
    """Read a result directory; one that a killed run left under another name is put back first.

    Raises InputError when the directory, or one of the four files every result has, is missing or
    is not what graphnav writes.
    """
    restore(directory)
    if not directory.is_dir():
        raise InputError(
            f"{directory}: no such directory; give the directory `graphnav smooth` wrote"
        )
    return Results(
        directory=directory,
        trajectory=_table(directory / "trajectory.parquet", TRAJECTORY_COLUMNS),
        states=_table(directory / "states.csv", STATE_COLUMNS),
        summary=_json(directory / "summary.json"),
        calibration=_curves(directory / "calibration.json"),
        events=_optional(directory / "events.csv", ["start", "end", "kind"]),
        odometer=_optional(directory / "odometer.parquet", ["time", "raw_speed", "v_x", "v_y"]),
        dead_reckoning=_optional(directory / "dead_reckoning.parquet", ["time", "e", "n", "u"]),
        gnss=_optional(directory / "gnss.parquet", ["time", "e", "n", "u"]),
        truth=_optional(directory / "truth.parquet", ["time", "e", "n", "u"]),
        residuals=_optional(directory / "residuals.parquet", ["time", "kind", "axis", "value"]),
        causal=_optional(directory / "trajectory_causal.parquet", ["time", "e", "n", "u"]),
        validation=_json(kept) if (kept := directory / "validation.json").exists() else None,
    )


def _optional(path: Path, needed: list[str]) -> "DataFrame | None":
    """The table, or None when the file is absent or holds no rows."""
    if not path.exists():
        return None
    table = _table(path, needed, empty_is_fault=False)
    return table if len(table) else None


def _table(path: Path, needed: list[str], *, empty_is_fault: bool = True) -> "DataFrame":
    import pandas as pd

    if not path.exists():
        raise InputError(f"{path}: missing; {path.parent} is no result directory, {RUN_AGAIN}")
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    except (ValueError, OSError) as fault:
        raise InputError(f"{path}: not readable ({_first_line(fault)}); {RUN_AGAIN}") from fault
    lacking = [name for name in needed if name not in table]
    if lacking:
        raise InputError(f"{path}: lacks column {', '.join(lacking)}; {RUN_AGAIN}")
    if empty_is_fault and table.empty:
        raise InputError(f"{path}: holds no rows; {RUN_AGAIN}")
    return table


def _json(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise InputError(f"{path}: missing; {path.parent} is no result directory, {RUN_AGAIN}")
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as fault:
        raise InputError(f"{path}: not readable ({_first_line(fault)}); {RUN_AGAIN}") from fault
    return content


def _curves(path: Path) -> dict[str, Curve]:
    try:
        return {name: _curve(name, entry) for name, entry in _json(path).items()}
    except (KeyError, TypeError, ValueError) as fault:
        raise InputError(f"{path}: incomplete ({_first_line(fault)}); {RUN_AGAIN}") from fault


def _curve(name: str, entry: dict[str, Any]) -> Curve:
    components = tuple(str(c) for c in entry["components"])
    shape = (-1, len(components))
    absent = [None] * len(components)
    return Curve(
        name=name,
        unit=str(entry["unit"]),
        components=components,
        constant=bool(entry["constant"]),
        time=np.asarray(entry["time"], float).reshape(-1),
        value=np.asarray(entry["value"], float).reshape(shape),
        sd=np.asarray(entry["sd"], float).reshape(shape),
        prior=np.asarray(entry.get("prior") or absent, float).reshape(-1),
        prior_sd=np.asarray(entry.get("prior_sd") or absent, float).reshape(-1),
        observable=tuple(bool(o) for o in entry.get("observable") or [True] * len(components)),
    )


def _first_line(fault: Exception) -> str:
    return (str(fault).splitlines() or [type(fault).__name__])[0]
