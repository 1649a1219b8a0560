"""Plotted series: velocity against the odometer, errors against truth, residuals, weights."""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from graphnav.result import palette
from graphnav.result.result_directory import Results, columns, errors_against_truth, thin
from graphnav.views.recording.entry import SERIES_LIMIT, Entry, over_time, part, static

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]

MARKS = 2000  # down-weighted marks of one kind: points draw slowly
VELOCITY = {"forward": "v_y", "lateral": "v_x", "vertical": "v_z"}


def entries(results: Results) -> list[Entry]:
    """Everything below `/velocity`, `/error`, `/residuals` and `/weights`."""
    return [*_velocity(results), *_errors(results), *_residuals(results), *_weights(results)]


def _lines(
    entity: str,
    time: Array,
    values: Array,
    names: list[str],
    colours: list[str],
    *,
    keep: Literal["MinMax", "Min"] = "MinMax",
    width: float = 1.3,
) -> list[Entry]:
    """Lines over time, (N,) and (N, K). The default aggregation would hide single spikes."""
    import rerun as rr

    style = rr.SeriesLines(
        names=names,
        colors=np.array([palette.rgba32(c) for c in colours], np.uint32),
        aggregation_policy=keep,
        widths=[width] * len(names),
    )
    rows = thin(len(time), SERIES_LIMIT)
    content = rr.Scalars.columns(scalars=values[rows])
    return [*static(entity, style), over_time(entity, time[rows], content)]


def _velocity(results: Results) -> list[Entry]:
    time = results.time - results.clock_start
    out: list[Entry] = []
    if results.odometer is not None:
        odometer_time = columns(results.odometer, "time")[:, 0] - results.clock_start
        for which, column, name, colour, width in (
            ("forward/odometer_raw", "raw_speed", "odometer, raw", palette.ODOMETER_RAW, 1.0),
            ("forward/odometer", "v_y", "odometer, corrected", palette.ODOMETER, 2.4),
            ("lateral/odometer", "v_x", "odometer, corrected", palette.ODOMETER, 2.4),
        ):
            value = columns(results.odometer, column)
            out += _lines(f"/velocity/{which}", odometer_time, value, [name], [colour], width=width)
    for which, column in VELOCITY.items():
        colour = palette.AXES["xyz".index(column[-1])]
        value = columns(results.trajectory, column)
        label = f"{column} smoothed [m/s]"
        out += _lines(f"/velocity/{which}/smoothed", time, value, [label], [colour])
    return out


def _errors(results: Results) -> list[Entry]:
    errors = errors_against_truth(results)
    if errors is None or errors.empty:
        return []
    errors = errors.iloc[thin(len(errors), SERIES_LIMIT)]
    time = columns(errors, "time")[:, 0] - results.clock_start
    out: list[Entry] = []
    for k, axis in enumerate(("east", "north", "up")):
        name = f"{axis} error [m], ±3σ"
        value, sd = columns(errors, axis[0], f"sd_{axis[0]}").T
        out += band(f"/error/{axis}", time, value, sd, name, palette.AXES[k])
    if "heading_deg" in errors:
        value, sd = columns(errors, "heading_deg", "sd_heading_deg").T
        out += band("/error/heading", time, value, sd, "heading error [deg], ±3σ", "#9b5de5")
    return out


def band(entity: str, time: Array, value: Array, sd: Array, name: str, colour: str) -> list[Entry]:
    """A line with its 3-sigma band, (N,) each, broken at NaN.

    rerun draws one standard deviation, hence the 3.
    """
    import rerun as rr

    style = rr.Measurements.from_fields(
        names=name, colors=np.array([palette.rgba32(colour)], np.uint32)
    )
    variances = (3.0 * np.nan_to_num(sd)) ** 2
    drawn = over_time(entity, time, rr.Measurements.columns(values=value, variances=variances))
    return [*static(entity, style), replace(drawn, y_range=_range(value, sd))]


def _range(value: Array, sd: Array) -> tuple[float, float]:
    """Shows every value and the usual width of the band; a band blown up somewhere may run out."""
    value, sd = value[np.isfinite(value)], np.nan_to_num(sd)
    if not len(value):
        return -1.0, 1.0
    usual = min(4.0 * float(sd.max()), 10.0 * float(np.median(sd)) + float(np.ptp(value)))
    low, high = float(value.min()) - usual, float(value.max()) + usual
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _residuals(results: Results) -> list[Entry]:
    if results.residuals is None:
        return []
    out: list[Entry] = []
    for kind, of_kind in results.residuals.groupby("kind", sort=True):
        for k, (axis, table) in enumerate(of_kind.groupby("axis", sort=False)):
            colour = (*palette.AXES, "#9b5de5", "#e69f00", "#12b5bd")[k % 6]
            time, value = columns(table.iloc[_spikes(table)], "time", "value").T
            time = time - results.clock_start
            name = f"{kind} {axis} [σ]"
            out += _lines(
                f"/residuals/{part(kind)}/{part(axis)}", time, value[:, None], [name], [colour]
            )
        out += _marks(results, str(kind), of_kind)
    return out


def _spikes(table: "DataFrame") -> NDArray[np.intp]:
    """Rows to plot: all, or of each stretch the largest and the smallest value."""
    count = len(table)
    if count <= SERIES_LIMIT:
        return np.arange(count)
    value = columns(table, "value")[:, 0]
    cells = np.arange(count) * (SERIES_LIMIT // 2) // count
    by_value = np.lexsort((value, cells))
    starts = np.searchsorted(cells, np.unique(cells))
    ends = np.append(starts[1:], count) - 1
    return np.unique(np.concatenate([by_value[starts], by_value[ends]]))


def _marks(results: Results, kind: str, table: "DataFrame") -> list[Entry]:
    """Points where the robust loss turned a measurement down (weight below one half)."""
    import rerun as rr

    if "weight" not in table:
        return []
    down = table[table["weight"] < 0.5].nsmallest(MARKS, "weight").sort_values("time")
    if down.empty:
        return []
    entity = f"/residuals/{part(kind)}/down_weighted"
    style = rr.SeriesPoints(
        names="down-weighted",
        colors=np.array([palette.rgba32(palette.DOWN_WEIGHTED)], np.uint32),
        markers="Cross",
        marker_sizes=3.5,
    )
    time, value = columns(down, "time", "value").T
    content = rr.Scalars.columns(scalars=value)
    return [*static(entity, style), over_time(entity, time - results.clock_start, content)]


def _weights(results: Results) -> list[Entry]:
    names = [name for name in ("w_x", "w_y", "w_z") if name in results.trajectory]
    if not names:
        return []
    time = results.time - results.clock_start
    values = columns(results.trajectory, *names)
    if np.isnan(values).all():
        return []
    colours = [palette.AXES["xyz".index(name[-1])] for name in names]
    return _lines("/weights/velocity", time, values, names, colours, keep="Min")
