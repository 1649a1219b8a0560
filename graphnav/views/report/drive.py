"""Figures of the drive: where it went, which states, how fast, how far from truth."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graphnav.result import palette
from graphnav.result.result_directory import (
    Results,
    columns,
    errors_against_truth,
    state_spans,
    thin,
)
from graphnav.views.report import svg

if TYPE_CHECKING:
    from pandas import DataFrame, Series

Array = NDArray[np.float64]

PATH_POINTS = 6000
SINCE_START = "time since start [s]"


def trajectory(results: Results) -> str:
    """East against north, coloured by state, with dead reckoning, truth and fixes."""
    from matplotlib.collections import LineCollection

    span = np.ptp(results.p_n[:, :2], axis=0)
    height = float(np.clip(0.72 * svg.WIDTH * (span[1] + 1) / (span[0] + 1), 3.6, 6.0))
    figure, (axes,) = svg.figure([height], right=2.0)
    others = (
        (results.dead_reckoning, "dead reckoning", palette.DEAD_RECKONING, "-", 1.0),
        (results.truth, "truth", svg.INK, "--", 1.0),
    )
    for table, label, colour, dashes, width in others:
        if table is not None:
            e, n = columns(table, "e", "n")[thin(len(table), PATH_POINTS)].T
            axes.plot(e, n, dashes, color=colour, lw=width, label=label, zorder=1.5)
    if results.gnss is not None:
        e, n = columns(results.gnss, "e", "n")[thin(len(results.gnss), 1000)].T
        axes.plot(e, n, ".", color=palette.GNSS, ms=3, label="GNSS", zorder=1.6)
    share = min(1.0, PATH_POINTS / len(results.time))
    lines: dict[str, list[Array]] = {}
    for state, first, last in state_spans(results):
        count = last - first + 1
        rows = first + thin(count, max(2, round(count * share)))
        lines.setdefault(state, []).append(results.p_n[rows, :2])
    for state in palette.in_order(lines):
        drawn = LineCollection(lines[state], colors=palette.motion(state), linewidths=2.0)
        drawn.set_label(palette.motion_label(state))
        drawn.set_zorder(2.0)
        axes.add_collection(drawn)
    for row, mark, label in ((0, "o", "start"), (-1, "s", "end")):
        axes.plot(*results.p_n[row, :2], mark, color=svg.INK, ms=5, label=label, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.set(xlabel="east [m]", ylabel="north [m]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.01))
    return svg.text(figure, "Trajectory, coloured by motion state")


def timeline(results: Results) -> str:
    """Lanes over time: recognised states, true states, slip events."""
    lanes = [("recognised", *_lane(results, results.states["state"], results.states))]
    if results.truth is not None and "state" in results.truth:
        names = results.truth["state"].fillna("").astype(str).to_numpy()
        first = np.flatnonzero(np.append(True, names[1:] != names[:-1]))
        at = columns(results.truth, "time")[:, 0] - results.clock_start
        widths = np.append(at[first[1:]], at[-1]) - at[first]
        colours = [palette.motion(s) for s in names[first]]
        lanes.append(("true", np.stack([at[first], widths], -1), colours))
    if results.events is not None:
        for kind, events in results.events.groupby("kind", sort=True):
            spans, _ = _lane(results, events["kind"], events)
            # an event of a second would be thinner than a pixel
            spans[:, 1] = np.maximum(spans[:, 1], 0.0015 * np.ptp(results.time))
            name = palette.event_label(str(kind)).lower()
            lanes.append((name, spans, [palette.event(str(kind))] * len(events)))
    figure, (axes,) = svg.figure([0.24 * len(lanes) + 0.1])
    for k, (_, spans, colours) in enumerate(lanes):
        axes.broken_barh(spans.tolist(), (k - 0.38, 0.76), facecolors=colours)
    axes.set_yticks(range(len(lanes)), [name for name, *_ in lanes])
    axes.set(ylim=(len(lanes) - 0.5, -0.5), xlabel=SINCE_START, xlim=limits(results))
    axes.grid(False)
    return svg.text(figure, "Motion states over time")


def _lane(results: Results, names: "Series[str]", table: "DataFrame") -> tuple[Array, list[str]]:
    start, end = columns(table, "start", "end").T
    spans = np.stack([start - results.clock_start, end - start], -1)
    return spans, [palette.motion(str(name)) for name in names]


def limits(results: Results) -> tuple[float, float]:
    """The run from end to end on the time axis."""
    start, end = results.time[[0, -1]] - results.clock_start
    return float(start), float(end)


def velocity(results: Results) -> str:
    """Vehicle-frame velocity against the raw and the corrected odometer."""
    figure, (forward, lateral, vertical) = svg.figure([1.9, 1.0, 1.0])
    if results.odometer is not None:
        at, raw, v_x, v_y = columns(results.odometer, "time", "raw_speed", "v_x", "v_y").T
        at = at - results.clock_start
        forward.plot(
            *svg.envelope(at, raw), color=palette.ODOMETER_RAW, lw=0.8, label="odometer, raw"
        )
        corrected: dict[str, Any] = {
            "color": palette.ODOMETER,
            "lw": 2.2,
            "label": "odometer, corrected",
        }
        forward.plot(*svg.envelope(at, v_y), **corrected)
        lateral.plot(*svg.envelope(at, v_x), **corrected)
    time = results.time - results.clock_start
    for axes, k, name in (
        (lateral, 0, "lateral"),
        (forward, 1, "forward"),
        (vertical, 2, "vertical"),
    ):
        value = columns(results.trajectory, f"v_{'xyz'[k]}")[:, 0]
        drawn: dict[str, Any] = {"color": palette.AXES[2] if k == 1 else palette.AXES[0], "lw": 0.9}
        axes.plot(*svg.envelope(time, value), **drawn, label="smoothed")
        axes.set_ylabel(f"{name}\n[m/s]")
    forward.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    svg.share_time([forward, lateral, vertical], limits(results), SINCE_START)
    return svg.text(figure, "Velocity in the vehicle frame")


def errors(results: Results) -> str | None:
    """Smoothed minus truth with 3-sigma bands; None without truth."""
    table = errors_against_truth(results)
    if table is None or table.empty:
        return None
    rows = [("east", "e", "m"), ("north", "n", "m"), ("up", "u", "m")]
    if "heading_deg" in table:
        rows.append(("heading", "heading_deg", "deg"))
    figure, axes = svg.figure([1.0] * len(rows))
    time = columns(table, "time")[:, 0] - results.clock_start
    for k, (name, column, unit) in enumerate(rows):
        value, sd = columns(table, column, f"sd_{column}").T
        svg.band(axes[k], time, value, sd, (*palette.AXES, "#9b5de5")[k])
        axes[k].set_ylabel(f"{name}\n[{unit}]")
    svg.share_time(axes, limits(results), SINCE_START)
    return svg.text(figure, "Error against truth")
