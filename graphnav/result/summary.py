"""summary.json and calibration.json of a solved run."""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graphnav.common.errors import SolutionError
from graphnav.result.quality import Quality
from graphnav.result.solved import Calibrated, Solved

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True)
class Judged:
    """A solved run with all that is said about it."""

    solved: Solved
    quality: Quality
    findings: list[str]  # about what was read
    verdicts: list[str]  # about the solution


def calibration(solved: Solved) -> dict[str, Any]:
    """calibration.json."""
    return {c.name: _as_dict(c, solved.run.clock_start) for c in solved.calibrated}


def _as_dict(c: Calibrated, clock: float) -> dict[str, Any]:
    return {
        "unit": c.unit,
        "components": list(c.components),
        "constant": c.constant,
        "time": np.round(c.time + clock, 3).tolist(),
        "value": c.value.tolist(),
        "sd": c.sd.tolist(),
        "prior": c.prior.tolist(),
        "prior_sd": c.prior_sd.tolist(),
        "observable": c.observable,
    }


def summary(
    judged: Judged,
    table: "DataFrame",
    slips: int,
    comparison: dict[str, Any] | None,
) -> dict[str, Any]:
    """summary.json, stages left out."""
    solved = judged.solved
    origin = solved.origin
    step = np.diff(table[["e", "n", "u"]].to_numpy(), axis=0)
    quiet = np.hypot(table["v_e"], table["v_n"]).to_numpy()[1:] > 0.02
    found = {
        "graphnav": 1,
        "quality": judged.quality.as_dict(),
        "run": str(solved.run.path),
        "vehicle": solved.vehicle.body.name or solved.vehicle.kind,
        "kind": solved.vehicle.kind,
        "origin": {
            "lat": float(np.rad2deg(origin.lat)),
            "lon": float(np.rad2deg(origin.lon)),
            "height": origin.height,
        },
        "duration_s": float(solved.path.time[-1] - solved.path.time[0]),
        "distance_m": float(np.linalg.norm(step, axis=1)[quiet].sum()),
        "states": {
            name: {"count": count, "seconds": round(seconds, 3)}
            for name, (count, seconds) in solved.timeline.totals().items()
        },
        "events": slips,
        "solver": solved.solver,
        "residuals": _residuals(solved),
        "warnings": judged.findings,
        "verdicts": judged.verdicts,
    }
    if comparison is not None:
        found["comparison"] = comparison
        # interface.md names these at the top
        found |= {k: comparison[k] for k in PROMISED}
    return found


PROMISED = (
    "horizontal_rms_m",
    "horizontal_max_m",
    "horizontal_end_m",
    "permille_of_distance",
    "heading_rms_deg",
    "nees_horizontal",
)


def _residuals(solved: Solved) -> dict[str, Any]:
    """Root mean square of the whitened residuals and share of doubted rows, by factor kind."""
    found = {}
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        if len(block.time):
            found[block.kind] = {
                "count": len(block.time),
                "rms": float(np.sqrt(np.mean(weight * block.residual**2))),
                "doubted": float(np.mean(weight < 0.5)),
            }
    return found


def write_json(path: Path, content: dict[str, Any]) -> None:
    """A file that other programs can read. Raises SolutionError where it would hold NaN."""
    name = _no_number(content)
    if name is not None:
        raise SolutionError(
            f"{name.lstrip('.')} of {path.name} came out as no number: what the sensors hold, or "
            "their stated noise, is far out of proportion; check units and figures in the vehicle "
            "file (graphnav check tells more)"
        )
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def _no_number(value: Any, name: str = "") -> str | None:
    """The name of the first value that is NaN or infinite; None where there is none."""
    if isinstance(value, float):
        return None if math.isfinite(value) else name
    inside: Iterable[tuple[Any, Any]] = value.items() if isinstance(value, dict) else ()
    inside = enumerate(value) if isinstance(value, list | tuple) else inside
    return next((n for key, each in inside if (n := _no_number(each, f"{name}.{key}"))), None)
