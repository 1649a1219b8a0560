"""Small run files for tests, and where the shared ones lie."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
GRAVITY = 9.8
VEHICLE = """
[vehicle]
kind = "wheeled"
[imu]
grade = "tactical"
[start]
lat = 45.0
lon = 10.0
height = 100.0
heading_deg = 30.0
"""
PULSES = VEHICLE + '[odometer]\ncolumn = "odo_pulses"\nmetres_per_pulse = 0.02\n'


def shared(name: str) -> Path:
    """The run file of a shared data set; the test is skipped where there is none."""
    found = sorted((SHARED / name).glob("run.csv*"))
    if not found:
        pytest.skip(f"shared data set {name} is not here ({SHARED})")
    return found[0]


def driven(seconds: float = 60.0, rate: float = 50.0, seed: int = 0) -> pd.DataFrame:
    """A drive in SI, right-forward-up: 10 s of rest, then speed changes and bends on flat ground.

    Odometer speed at 5 Hz, blank between.
    """
    time = np.arange(1, round(seconds * rate) + 1) / rate
    moving = np.clip((time - 10) / 5, 0, 1)
    speed = moving * (10 + 2 * np.sin(time))
    w_z = moving * 0.3 * np.sin(time / 3)
    noise = np.random.default_rng(seed).normal(size=(len(time), 6))
    gain = np.gradient(speed, time)
    return pd.DataFrame(
        {
            "time": time,
            "gyro_x": 1e-4 * noise[:, 0],
            "gyro_y": 1e-4 * noise[:, 1],
            "gyro_z": w_z + 1e-4 * noise[:, 2],
            "accel_x": -speed * w_z + 1e-3 * noise[:, 3],
            "accel_y": gain + 1e-3 * noise[:, 4],
            "accel_z": GRAVITY + 1e-3 * noise[:, 5],
            "odo_speed": np.where(np.arange(len(time)) % round(rate / 5) == 0, speed, np.nan),
        }
    )


def fixes(table: pd.DataFrame, every: int = 50) -> pd.DataFrame:
    """The table with a fix in every `every`-th row."""
    at = np.arange(len(table)) % every == 0
    return table.assign(
        **{
            name: np.where(at, value, np.nan)
            for name, value in {"gnss_lat": 45.0, "gnss_lon": 10.0, "gnss_height": 100.0}.items()
        }
    )


def saved(table: pd.DataFrame, directory: Path, vehicle: str = VEHICLE) -> Path:
    """`run.csv` and `vehicle.toml` in `directory`; the path of the run."""
    (directory / "vehicle.toml").write_text(vehicle, encoding="utf-8")
    path = directory / "run.csv"
    table.to_csv(path, index=False)
    return path
