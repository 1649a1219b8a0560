"""A comparison as a table on the terminal."""

from rich.console import Console
from rich.table import Table

from graphnav.result.compare import Comparison

ROWS = (
    ("horizontal error, rms", "horizontal_rms_m", "m"),
    ("horizontal error, worst", "horizontal_max_m", "m"),
    ("horizontal error, end", "horizontal_end_m", "m"),
    ("worst per distance", "permille_of_distance", "permille"),
    ("distance", "distance_m", "m"),
    ("height error, rms", "height_rms_m", "m"),
    ("heading error, rms", "heading_rms_deg", "deg"),
    ("velocity error, rms", "velocity_rms_m_s", "m/s"),
    ("truth matched", "share_of_truth_matched", "%"),
    ("NEES position (2 is honest)", "nees_horizontal", ""),
    ("positions in their 95 % ellipse", "nees_horizontal_inside_95", "%"),
    ("NEES heading (1 is honest)", "nees_heading", ""),
    ("headings in their 95 % interval", "nees_heading_inside_95", "%"),
    ("states recognised", "state_accuracy", "%"),
)


def show(comparison: Comparison, name: str) -> None:
    """Print the table to stdout; what truth does not know is left out."""
    table = Table(title=f"{name} against truth", title_justify="left")
    table.add_column("")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for title, key, unit in ROWS:
        value = getattr(comparison, key)
        if value is not None:
            table.add_row(title, f"{100 * value:.1f}" if unit == "%" else f"{value:.3f}", unit)
    for state, f1 in (comparison.state_f1 or {}).items():
        table.add_row(f"  F1 {state}", f"{f1:.3f}", "")
    Console().print(table)
