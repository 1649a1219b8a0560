"""A plausible result directory of a tracked vehicle, made in one pass from the file contract."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from graphnav.common.earth import Origin

CLOCK_START = 1200.0
TURNS = (
    "turn_arc",
    "turn_pivot",
    "turn_separated",
    "turn_separated_low",
    "turn_pivot_low",
    "turn_large",
)
FORWARD = dict(zip(TURNS, (0.8688, 1.0, 0.91, 0.92, 1.0, 1.0), strict=True))
REQUIRED = ("trajectory.parquet", "states.csv", "calibration.json", "summary.json")


def timeline(duration: float, rng: np.random.Generator) -> pd.DataFrame:
    """Stop, straight, a turn of one kind, straight, ...: gap-free."""
    rows, start = [("stop", min(30.0, duration / 4))], 0.0
    k = 0
    while sum(d for _, d in rows) < duration:
        straight = "straight_low" if k % 3 == 2 else "straight_high"
        rows.append((straight, float(rng.uniform(8, 40))))
        rows.append((TURNS[k % len(TURNS)], float(rng.uniform(3, 12))))
        if k % 5 == 4:
            rows.append(("stop", float(rng.uniform(5, 20))))
        k += 1
    out = []
    for state, length in rows:
        end = min(start + length, duration)
        if end > start:
            out.append((CLOCK_START + start, CLOCK_START + end, state))
        start = end
    return pd.DataFrame(out, columns=["start", "end", "state"])


def write(directory: Path, duration: float = 4000.0, rate: float = 10.0, seed: int = 1) -> Path:
    """Write every file of the contract; times are on a clock that starts at CLOCK_START."""
    rng = np.random.default_rng(seed)
    directory.mkdir(parents=True)
    states = timeline(duration, rng)
    time = CLOCK_START + np.arange(round(duration * rate) + 1) / rate
    row = np.clip(np.searchsorted(states["end"], time), 0, len(states) - 1)
    state = states["state"].to_numpy()[row]
    trajectory, p_n = _trajectory(time, state, rate, rng)
    trajectory.to_parquet(directory / "trajectory.parquet")
    states.assign(probability=rng.uniform(0.7, 1, len(states)).round(3)).to_csv(
        directory / "states.csv", index=False
    )
    _side_tables(directory, trajectory, p_n, states, rng)
    (directory / "calibration.json").write_text(json.dumps(_calibration(time, rng)))
    (directory / "summary.json").write_text(json.dumps(_summary(states, duration)))
    return directory


def _trajectory(
    time: np.ndarray, state: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[pd.DataFrame, np.ndarray]:
    smooth = np.ones(max(3, int(2 * rate))) / max(3, int(2 * rate))
    speed = np.select(
        [state == "stop", np.char.find(state.astype(str), "low") >= 0], [0.0, 4.0], 9.0
    )
    v_y = np.convolve(speed, smooth, "same")
    turning = np.char.startswith(state.astype(str), "turn")
    sign = np.sign(np.sin((time - time[0]) / 120.0))
    yaw_rate = np.convolve(np.where(turning, 0.12 * sign, 0.0), smooth, "same")
    heading = np.radians(98.3) - np.cumsum(yaw_rate) / rate
    v_x = np.where(turning, -0.8 * yaw_rate, 0.0)
    v_z = 0.02 * np.sin(time)
    v_e = v_y * np.sin(heading) + v_x * np.cos(heading)
    v_n = v_y * np.cos(heading) - v_x * np.sin(heading)
    p_n = np.cumsum(np.stack([v_e, v_n, v_z], -1), 0) / rate
    lat, lon, height = Origin(np.radians(40.12), np.radians(116.23), 60.0).geodetic(p_n)
    share = (time - time[0]) / (time[-1] - time[0])
    sd = 0.1 + 2.0 * np.sqrt(share * (1 - share))
    table = {"time": time, "lat": np.degrees(lat), "lon": np.degrees(lon), "height": height}
    table |= {k: p_n[:, i] for i, k in enumerate("enu")}
    table |= {"v_e": v_e, "v_n": v_n, "v_u": v_z, "v_x": v_x, "v_y": v_y, "v_z": v_z}
    table |= {"roll_deg": 2 * np.sin(time / 9), "pitch_deg": 1.5 * np.cos(time / 13)}
    table |= {"heading_deg": np.degrees(heading) % 360.0}
    table |= {"sd_e": 1.4 * sd, "sd_n": sd, "sd_u": 0.6 * sd}
    table |= {f"sd_v_{k}": np.full(len(time), 0.01) for k in "enu"}
    table |= {f"sd_{k}_deg": np.full(len(time), s) for k, s in (("roll", 0.004), ("pitch", 0.004))}
    table |= {"sd_heading_deg": 0.01 + 0.02 * share, "corr_en": 0.6 * np.sin(time / 400)}
    weight = np.where(rng.uniform(size=len(time)) < 0.02, rng.uniform(size=len(time)), 1.0)
    table |= {"w_x": weight, "w_y": np.where(turning, np.nan, weight), "w_z": np.ones(len(time))}
    return pd.DataFrame(table | {"state": state}), p_n


def _side_tables(
    directory: Path,
    trajectory: pd.DataFrame,
    p_n: np.ndarray,
    states: pd.DataFrame,
    rng: np.random.Generator,
) -> None:
    time = trajectory["time"].to_numpy()
    share = ((time - time[0]) / (time[-1] - time[0]))[:, None]

    def place(name: str, at: np.ndarray, offset: np.ndarray, **more: object) -> None:
        columns = {k: p_n[at, i] + offset[:, i] for i, k in enumerate("enu")}
        pd.DataFrame({"time": time[at], **columns, **more}).to_parquet(
            directory / f"{name}.parquet"
        )

    every = np.arange(len(time))
    place("dead_reckoning", every, share * np.array([90.0, -50.0, 5.0]))
    walk = np.cumsum(rng.normal(size=p_n.shape), 0) * 0.004
    truth = {"state": trajectory["state"], "heading_deg": trajectory["heading_deg"] + 0.008}
    place("truth", every, walk, **{k: v.to_numpy() for k, v in truth.items()})
    fixes = every[:: max(1, len(every) // 200)]
    bad = (np.arange(len(fixes)) > 80) & (np.arange(len(fixes)) < 90)
    noise = rng.normal(size=(len(fixes), 3)) * 2 + bad[:, None] * np.array([30.0, 20.0, 0.0])
    sd = {f"sd_{k}": np.full(len(fixes), 2.0) for k in "enu"}
    place("gnss", fixes, noise, **sd, weight=np.where(bad, 0.05, 1.0))
    late = rng.normal(size=p_n.shape) * 0.02 + 0.5 * walk
    heading = trajectory["heading_deg"].to_numpy()
    one = {"sd_e": np.full(len(time), 3.0), "sd_n": np.full(len(time), 2.0)}
    place(
        "trajectory_causal",
        every,
        late,
        heading_deg=heading,
        **one,
        latency_ms=np.full(len(time), 12.0),
    )
    _odometer(directory, trajectory)
    _events_and_residuals(directory, time, states, rng)


def _odometer(directory: Path, trajectory: pd.DataFrame) -> None:
    v_y, turning = trajectory["v_y"], trajectory["state"].str.startswith("turn")
    pivot = trajectory["state"].str.contains("pivot|large")
    raw = v_y * np.where(turning, 1.12, np.where(trajectory["state"] == "straight_low", 1.42, 1.0))
    odometer = {
        "time": trajectory["time"],
        "raw_speed": raw,
        "v_x": trajectory["v_x"],
        "v_y": v_y + 0.02,
    }
    frame = pd.DataFrame(odometer)
    frame.loc[pivot, ["v_x", "v_y"]] = np.nan
    frame.to_parquet(directory / "odometer.parquet")


def _events_and_residuals(
    directory: Path, time: np.ndarray, states: pd.DataFrame, rng: np.random.Generator
) -> None:
    starts = states["start"].to_numpy()[3::11]
    kinds = np.array(["side_slip", "hop", "wheel_spin", "wheel_lock"])[np.arange(len(starts)) % 4]
    axes = np.array(["x", "z", "y", "y"])[np.arange(len(starts)) % 4]
    events = {"start": starts, "end": starts + 1.5, "kind": kinds, "axis": axes}
    peak = rng.uniform(0.1, 0.9, len(starts))
    pd.DataFrame(events | {"peak_velocity": peak}).to_csv(directory / "events.csv", index=False)
    nodes = time[:: max(1, round(1.0 / (time[1] - time[0])))]
    rows = [("odometer", a) for a in "xyz"] + [("inertial", a) for a in ("e", "n", "u", "heading")]
    parts = []
    for kind, axis in rows:
        value = rng.normal(size=len(nodes))
        outlier = rng.uniform(size=len(nodes)) < 0.004
        value[outlier] *= 9
        weight = np.where(outlier, 0.08, 1.0)
        parts.append(
            pd.DataFrame(
                {"time": nodes, "kind": kind, "axis": axis, "value": value, "weight": weight}
            )
        )
    pd.concat(parts).sort_values("time", ignore_index=True).to_parquet(
        directory / "residuals.parquet"
    )


def _entry(
    unit: str, components: list[str], value: list[float], sd: list[float]
) -> dict[str, object]:
    seen = [True] * len(components)
    return {
        "unit": unit, "components": components, "constant": True, "time": [CLOCK_START],
        "value": [value], "sd": [sd], "prior": value, "prior_sd": [4 * s for s in sd],
        "observable": seen,
    }  # fmt: skip


def _calibration(time: np.ndarray, rng: np.random.Generator) -> dict[str, object]:
    minutes = np.arange(time[0], time[-1] + 60, 60.0)
    drift = 1.002 + 0.0048 * (minutes - minutes[0]) / (minutes[-1] - minutes[0])
    scale = _entry("1", ["scale"], [1.0], [0.005]) | {
        "constant": False, "time": minutes.tolist(), "value": drift[:, None].tolist(),
        "sd": np.full((len(minutes), 1), 0.0004).tolist(),
    }  # fmt: skip
    walk = np.cumsum(rng.normal(size=(len(minutes), 3)), 0) * 0.0008
    gyro = _entry("deg/h", ["x", "y", "z"], [0.0] * 3, [0.02] * 3) | {
        "constant": False, "time": minutes.tolist(), "value": walk.tolist(),
        "sd": np.full((len(minutes), 3), 0.006).tolist(),
    }  # fmt: skip
    lever = _entry("m", ["x", "y", "z"], [0.30, -1.0, 0.8], [0.02, 0.03, 0.5])
    lever["observable"] = [True, True, False]
    turns = list(TURNS)
    return {
        "gyro_bias_deg_h": gyro,
        "accel_bias_mg": _entry("mg", ["x", "y", "z"], [0.02, -0.03, 0.05], [0.01] * 3),
        "odometer_scale": scale,
        "mounting_deg": _entry("deg", ["pitch", "heading"], [0.21, -0.34], [0.005, 0.004]),
        "lever_arm_m": lever,
        "forward_factor": _entry("1", turns, list(FORWARD.values()), [0.01] * len(turns)),
        "kappa": _entry("1", turns, [0.22, 0.3, 0.25, 0.25, 0.3, 0.2], [0.03] * len(turns)),
    }


def _summary(states: pd.DataFrame, duration: float) -> dict[str, object]:
    seconds = (states["end"] - states["start"]).groupby(states["state"]).agg(["count", "sum"])
    return {
        "run": "run-001", "vehicle": "tracked",
        "quality": {
            "grade": "doubtful", "why": ["the heading stated in [start] is 3 deg off"],
            "remedy": ["leave out [start] heading_deg"], "heading_sd_deg": 0.02,
            "position_sd_m": {"median": 0.8, "worst": 2.1, "at_s": 1834.0},
        },
        "origin": {"lat": 40.12, "lon": 116.23, "height": 60.0},
        "duration_s": duration, "distance_m": 7.1 * duration,
        "states": {s: {"count": int(c), "seconds": float(t)} for s, c, t in seconds.itertuples()},
        "solver": {"method": "batch", "iterations": 4, "converged": True},
        "stages": {"read": 0.6, "increments": 0.4, "dead_reckoning": 0.2, "solve": 9.1},
        "peak_memory_mb": 512.0,
        "residuals": {"odometer": {"count": 12000, "rms": 1.02}, "inertial": {"rms": 0.98}},
        "warnings": ["lever arm z not observable: it stayed at its prior"],
        "verdicts": ["odometer scale drifted 4.8 permille", "GNSS disagreed 1640-1800 s"],
        "comparison": {"horizontal_rms_m": 0.61, "horizontal_max_m": 1.9, "horizontal_end_m": 0.4,
                       "permille_of_distance": 0.02, "heading_rms_deg": 0.009, "nees": 2.7},
    }  # fmt: skip
