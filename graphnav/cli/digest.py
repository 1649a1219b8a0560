"""A finished result in a few lines for the terminal."""

import json
from pathlib import Path
from typing import Any

from graphnav.common.errors import RejectedError
from graphnav.result.quality import Quality, in_one_line

SHOWN = 6  # warnings before the rest are left to summary.json


def digest(directory: Path) -> str:
    """What `summary.json` in `directory` says first: how far to rely on it, then the rest."""
    summary = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    lines = [*_quality(summary["quality"]), f"wrote {directory}"]
    lines += [*_driven(summary), *_accuracy(summary)]
    warnings = summary.get("warnings", [])
    lines += [f"- {warning}" for warning in warnings[:SHOWN]]
    if warnings[SHOWN:]:
        lines.append(f"- and {len(warnings) - SHOWN} more in summary.json")
    return "\n".join(lines)


def raise_if_rejected(run: Path, quality: Quality) -> None:
    """RejectedError with the likeliest cause and cure, when the result is rejected."""
    if quality.grade == "rejected":
        said = "; ".join([*quality.why[:1], *quality.remedy[:1]])
        raise RejectedError(f"{run}: rejected (written all the same): {said}")


def _quality(quality: dict[str, Any]) -> list[str]:
    """The line that comes first, what else speaks against the result, and the cures."""
    return [
        in_one_line(quality),
        *(f"  and {why}" for why in quality["why"][1:]),
        *(f"  try: {remedy}" for remedy in quality["remedy"]),
    ]


def _driven(summary: dict[str, Any]) -> list[str]:
    distance, duration = summary.get("distance_m"), summary.get("duration_s")
    if distance is None or duration is None:
        return []
    seconds = sum(summary.get("stages", {}).values())
    return [f"{distance / 1000:.2f} km in {duration / 60:.1f} min, smoothed in {seconds:.1f} s"]


def _accuracy(summary: dict[str, Any]) -> list[str]:
    found = summary.get("comparison") or {}
    if "horizontal_rms_m" not in found:
        return []
    line = (
        f"against truth: {found['horizontal_rms_m']:.2f} m rms, {found['horizontal_max_m']:.2f} m "
        f"at worst, {found['horizontal_end_m']:.2f} m at the end"
    )
    if found.get("permille_of_distance") is not None:
        line += f", {found['permille_of_distance']:.2f} permille of the distance"
    return [line]
