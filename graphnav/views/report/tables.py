"""The report's tables and sentences, as plain rows for the template."""

import math
from typing import Any

from graphnav.result import palette
from graphnav.result.result_directory import Curve, Results
from graphnav.views.headline import against_truth, is_number
from graphnav.views.recording.curves import label, title
from graphnav.views.report.quality import unit

EVENT_ROWS = 200  # the rest is in events.csv


def headline(results: Results) -> list[tuple[str, str]]:
    """`(label, value)` of the numbers at the top."""
    summary = results.summary
    out = []
    if is_number(summary.get("distance_m")):
        out.append(("distance", f"{summary['distance_m'] / 1000:.2f} km"))
    if is_number(summary.get("duration_s")):
        out.append(("duration", f"{summary['duration_s']:.0f} s"))
    return out + against_truth(summary)


def states(results: Results) -> list[dict[str, str]]:
    """Per motion state: how often, how long, which share of the run."""
    length = results.states["end"] - results.states["start"]
    total = float(length.sum()) or 1.0
    grouped = length.groupby(results.states["state"])
    counts, seconds = grouped.count(), grouped.sum()
    return [
        {
            "colour": palette.motion(state),
            "name": palette.motion_label(state),
            "count": str(int(counts[state])),
            "seconds": f"{seconds[state]:.1f}",
            "share": f"{100 * seconds[state] / total:.1f} %",
        }
        for state in palette.in_order(results.states["state"].astype(str))
    ]


def events(results: Results) -> list[dict[str, str]]:
    """Slip events in order of time, at most `EVENT_ROWS`."""
    if results.events is None:
        return []
    rows = results.events.sort_values("start").head(EVENT_ROWS).to_dict("records")
    return [
        {
            "colour": palette.event(str(row["kind"])),
            "name": palette.event_label(str(row["kind"])),
            "start": f"{row['start'] - results.clock_start:.1f}",
            "length": f"{row['end'] - row['start']:.1f}",
            "axis": str(row.get("axis", "")),
            "peak": _figures(row["peak_velocity"], 2) if "peak_velocity" in row else "",
        }
        for row in rows
    ]


def calibration(results: Results) -> list[dict[str, str]]:
    """Every component: prior, value (first to last when it moves), 3 sigma, observable or not."""
    return [
        _component(curve, k)
        for curve in results.calibration.values()
        for k in range(len(curve.components))
    ]


def _component(curve: Curve, k: int) -> dict[str, str]:
    first, last, sd = curve.value[0, k], curve.value[-1, k], curve.sd[-1, k]
    moved = not curve.constant and len(curve.time) > 1
    name = title(curve.name)
    if len(curve.components) > 1:
        name += f", {label(curve.components[k]).lower()}"
    prior, prior_sd = curve.prior[k], curve.prior_sd[k]
    value = f"{_to(first, sd)} to {_to(last, sd)}" if moved else _to(first, sd)
    return {
        "name": name,
        "unit": unit(curve).strip("[]"),
        "prior": f"{_figures(prior)} ± {_figures(3 * prior_sd, 2)}" if prior == prior else "none",
        "value": value,
        "sd": f"± {_figures(3 * sd, 2)}",
        "observable": "yes" if curve.observable[k] else "no",
    }


def _to(value: float, sd: float) -> str:
    """A number to the second figure of its 3 sigma."""
    if not 0.0 < 3.0 * sd < math.inf:
        return _figures(value)
    decimals = max(0, 1 - math.floor(math.log10(3.0 * sd)))
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"  # + 0.0: no minus before zero


def _figures(value: float, count: int = 5) -> str:
    """A number with `count` significant figures, no exponent for everyday sizes."""
    return f"{value:.{count}g}"


def stages(results: Results) -> list[tuple[str, str]]:
    """Seconds spent by stage, memory, and what the solver says of itself."""
    summary = results.summary
    out = [
        (name.replace("_", " "), f"{s:.2f} s") for name, s in (summary.get("stages") or {}).items()
    ]
    if is_number(summary.get("peak_memory_mb")):
        out.append(("peak memory", f"{summary['peak_memory_mb']:.0f} MB"))
    solver = summary.get("solver") or {}
    plain = {k: v for k, v in solver.items() if isinstance(v, str | int | float)}
    return out + [(f"solver: {k.replace('_', ' ')}", _shown(v)) for k, v in plain.items()]


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return _figures(value) if isinstance(value, float) else str(value)
