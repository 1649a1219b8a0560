"""`graphnav smooth` as users call it, and what it wrote."""

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import forked
import numpy as np
import pandas as pd

from graphnav.common.earth import Origin

PATIENCE_S = 600.0
REJECTED = 3  # exit status of a result that is written and not to be relied on


@dataclass(frozen=True)
class Result:
    """What a result directory holds, as far as tools hold it against truth."""

    trajectory: pd.DataFrame
    causal: pd.DataFrame | None
    summary: dict[str, Any]

    @property
    def origin(self) -> Origin:
        """Of `e n u`."""
        at = self.summary["origin"]
        return Origin(np.deg2rad(at["lat"]), np.deg2rad(at["lon"]), at["height"])


class NoResult(Exception):
    """The command's own line."""


def smoothed(run: Path, vehicle: Path, *options: str) -> Result:
    """Smooth a run; raises NoResult where nothing is written."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "result"
        words = ["smooth", run, "--vehicle", vehicle, "--out", out, "--no-rrd", *options]
        forked.warm()
        done = forked.start(list(map(str, words))).ended(PATIENCE_S)
        if done.status not in (0, REJECTED):
            last = done.error.strip().splitlines()[-1:] or ["nothing said"]
            raise NoResult(f"exit {done.status}: {last[0]}")
        causal = out / "trajectory_causal.parquet"
        return Result(
            pd.read_parquet(out / "trajectory.parquet"),
            pd.read_parquet(causal) if causal.exists() else None,
            json.loads((out / "summary.json").read_text()),
        )
