"""The figures against truth that recording and report begin with, as they are read."""

from collections.abc import Mapping
from typing import Any

FIGURES = (
    ("horizontal_rms_m", "horizontal error, RMS", "{:.2f} m"),
    ("horizontal_max_m", "horizontal error, largest", "{:.2f} m"),
    ("horizontal_end_m", "horizontal error at the end", "{:.2f} m"),
    ("permille_of_distance", "of the distance", "{:.3f} ‰"),
    ("heading_rms_deg", "heading error, RMS", "{:.4f}°"),
)


def against_truth(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """`(label, value)` of what a summary has of them."""
    found = {**summary, **(summary.get("comparison") or {})}
    return [
        (label, how.format(found[key])) for key, label, how in FIGURES if is_number(found.get(key))
    ]


def is_number(value: Any) -> bool:
    """Whether a value of a summary is one."""
    return isinstance(value, int | float) and not isinstance(value, bool)
