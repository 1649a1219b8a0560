"""Figures as SVG that lives inside the page: text stays text, ink follows the page's theme.

matplotlib rather than a JavaScript plotter: the page holds no scripts, prints as it looks, and
stays near 1 MB where an embedded plotly.js alone is 4 MB. Its import costs 0.3-0.7 s, a figure
0.03-0.1 s.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# colours no plot uses; the page replaces them by its own
INK, FAINT, GRID = "#010203", "#010204", "#010205"
THEMED = {INK: "var(--ink)", FAINT: "var(--faint)", GRID: "var(--grid)"}
WIDTH = 8.6  # inches: the text column of the page
POINTS = 1500  # of one plotted line: two for every pixel of the column

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "graphnav",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.1,
    "path.simplify_threshold": 0.3,
}


@contextmanager
def styled() -> Iterator[None]:
    """The style of the report, for the figures made inside; global settings are left alone."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        yield


def figure(
    heights: list[float],
    across: int = 1,
    left: float = 0.8,
    right: float = 0.3,
    gap: float = 0.12,
    top: float = 0.32,
) -> "tuple[Figure, list[Axes]]":
    """Panels in rows of the given heights, all in inches, with margins set by hand.

    matplotlib's own layout engines double the drawing time and leave time axes unaligned from one
    figure to the next.
    """
    from matplotlib.figure import Figure

    bottom, rows = 0.45, len(heights)
    height = sum(heights) + gap * (rows - 1) + top + bottom
    drawn = Figure(figsize=(WIDTH, height))
    spacing = {"hspace": gap * rows / sum(heights), "wspace": 0.16}
    edges = {"left": left / WIDTH, "right": 1 - right / WIDTH}
    edges |= {"bottom": bottom / height, "top": 1 - top / height}
    axes = drawn.subplots(rows, across, squeeze=False, height_ratios=heights, gridspec_kw=spacing)
    drawn.subplots_adjust(**edges)
    return drawn, list(axes.reshape(-1))


def share_time(axes: "list[Axes]", limits: tuple[float, float], label: str) -> None:
    """One time axis for panels above each other: ticks on all, numbers on the last."""
    for panel in axes:
        panel.set_xlim(limits)
        panel.tick_params(labelbottom=panel is axes[-1])
    axes[-1].set_xlabel(label)
    for panel in axes:
        panel.yaxis.set_label_coords(-0.065, 0.5)


def text(drawn: "Figure", title: str) -> str:
    """The figure as an `<svg>` element; `title` is what a screen reader says."""
    out = io.StringIO()
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    drawn.savefig(out, format="svg", transparent=True, metadata=nothing)
    svg = out.getvalue()
    svg = svg[svg.index("<svg") :]
    for colour, themed in THEMED.items():
        svg = svg.replace(colour, themed)
    return svg.replace("<svg", f'<svg role="img" aria-label="{title}"', 1)


def envelope(time: Array, value: Array, points: int = POINTS) -> tuple[Array, Array]:
    """A long line drawn by the smallest and largest value of each stretch; gaps (NaN) stay."""
    if len(time) <= 2 * points:
        return time, value
    cells = np.array_split(np.arange(len(time)), points)
    starts = np.array([c[0] for c in cells])
    low = np.fmin.reduceat(value, starts)
    high = np.fmax.reduceat(value, starts)
    return np.repeat(time[starts], 2), np.stack([low, high], -1).reshape(-1)


def band(axes: "Axes", time: Array, value: Array, sd: Array, colour: str, **line: Any) -> None:
    """A line with its 3-sigma band."""
    rows = np.unique(np.linspace(0, len(time) - 1, min(len(time), POINTS)).astype(int))
    low, high = value - 3 * sd, value + 3 * sd
    axes.fill_between(time[rows], low[rows], high[rows], color=colour, alpha=0.2, linewidth=0)
    axes.plot(*envelope(time, value), color=colour, **line)
