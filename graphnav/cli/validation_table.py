"""What withheld fixes say of a path, as a table on the terminal."""

from typing import Any

from rich.console import Console
from rich.table import Table

COLUMNS = (
    ("withheld", "block_s", "{:g} s"),
    ("blocks", "blocks", "{}"),
    ("fixes", "fixes", "{}"),
    ("off, rms", "found_m", "{:.2f} m"),
    ("worst", "worst_m", "{:.2f} m"),
    ("promised", "promised_m", "{:.2f} m"),
    ("path", "path_m", "{:.2f} m"),
    ("ratio", "promised_over_found", "{:.2f}"),
)


def show(blocks: list[dict[str, Any]], name: str) -> None:
    """Print the table to stdout: a line for every block length."""
    table = Table(title=f"{name}: the path at withheld fixes", title_justify="left")
    for title, _, _ in COLUMNS:
        table.add_column(title, justify="right")
    table.add_column("in 95 %", justify="right")
    for row in blocks:
        cells = [form.format(row[key]) for _, key, form in COLUMNS]
        table.add_row(*cells, f"{100 * row['inside_95']:.0f} %")
    Console().print(table)
