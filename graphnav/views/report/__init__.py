"""`report.html`: one self-contained page about a run, no scripts, light and dark and on paper.

Made from the results alone by `graphnav report DIR`. Figures are SVG by matplotlib (see `svg`),
the page is a Jinja template with escaping on.
"""

from importlib.resources import files
from pathlib import Path
from typing import Any

import graphnav
from graphnav.common.replacing import whole
from graphnav.result.quality import in_one_line
from graphnav.result.result_directory import Results
from graphnav.views.report import drive, quality, svg, tables


def write(results: Results, path: Path) -> None:
    """Write the page; `path` is never half a file."""
    with whole(path) as part:
        part.write_text(page(results), encoding="utf-8")


def page(results: Results) -> str:
    """The whole report as HTML."""
    from jinja2 import Environment, StrictUndefined

    source = files("graphnav.views.report").joinpath("template.html").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=False)
    return environment.from_string(source).render(_content(results))


def _content(results: Results) -> dict[str, Any]:
    summary = results.summary
    shown = tables.events(results)
    return {
        "run": results.title,
        "vehicle": summary.get("vehicle", "vehicle"),
        "version": graphnav.__version__,
        "clock_start": f"{results.clock_start:g}",
        "quality": results.quality,
        "relied": in_one_line(results.quality) if results.quality else "",
        "validated": (results.validation or {}).get("said", ""),
        "headline": tables.headline(results),
        "verdicts": summary.get("verdicts") or [],
        "warnings": summary.get("warnings") or [],
        "figures": _figures(results),
        "calibration": tables.calibration(results),
        "states": tables.states(results),
        "events": shown,
        "events_left": 0 if results.events is None else len(results.events) - len(shown),
        "stages": tables.stages(results),
    }


def _figures(results: Results) -> list[dict[str, str]]:
    """Heading, drawing and caption of every figure there is data for."""
    with svg.styled():
        drawn = (
            ("Trajectory", drive.trajectory(results), "Metres east and north of the run's origin."),
            ("Motion states", drive.timeline(results), "Colours as in the trajectory."),
            ("Velocity", drive.velocity(results), "At the IMU, in the vehicle frame. Gaps in the "
             "corrected odometer: discarded, the inertial sensors bridge them."),
            ("Error against truth", drive.errors(results), "Smoothed minus truth; band: ±3σ."),
            ("Calibration over time", quality.curves(results), "Band: ±3σ. Dotted: prior."),
            ("Factors by motion state", quality.factors(results), "Coloured: estimate ± 3σ. "
             "Grey: prior ± 3σ."),
            ("Residuals", quality.residuals(results), "In units of their standard deviation; line: "
             "the normal density. Values beyond 6σ are in the outer bins."),
        )  # fmt: skip
    return [{"heading": h, "svg": s, "caption": c} for h, s, c in drawn if s is not None]
