"""The layout a recording opens with. Views exist only for entities that were logged."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from graphnav.result import palette
from graphnav.result.result_directory import Results
from graphnav.views.recording import curves
from graphnav.views.recording.entry import TIMELINE, Entry
from graphnav.views.recording.map import zoom

if TYPE_CHECKING:
    import rerun.blueprint as rrb

# Linked time axes ignore their own range and obey this view, which has no public name (rerun 0.41,
# re_viewer_context::GLOBAL_VIEW_ID). Should it change, plots open on a 60 s window: no harm done.
GLOBAL_VIEW = "view/5c0dca6a-e63f-9cf7-f657-2602590474cc"

WINDOW = 800.0  # pixels: height the rows are shared for
STACKED = 4  # plots one above the other; more go in two columns


def layout(results: Results, entries: list[Entry]) -> "rrb.Blueprint":
    """3D views and plots side by side above the motion-state timeline, all on one time axis."""
    import rerun.blueprint as rrb

    logged = {entry.entity for entry in entries}
    upper = rrb.Horizontal(_space(results), _plots(entries, logged), column_shares=[5, 6])
    lanes = sum(entity.startswith("/state/") for entity in logged)
    share = min(0.5, (58 + 38 * lanes) / WINDOW)
    lower = rrb.StateTimelineView(
        origin="/state", name="Motion state", time_view=rrb.TimeAxis(link="LinkToGlobal")
    )
    return _linked_blueprint()(
        rrb.Vertical(upper, lower, row_shares=[1 - share, share]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def _linked_blueprint() -> "type[rrb.Blueprint]":
    import rerun as rr
    import rerun.blueprint as rrb

    class Linked(rrb.Blueprint):
        """A blueprint whose shared time axis shows the whole run."""

        def _log_to_stream(self, stream: rr.RecordingStream) -> None:
            super()._log_to_stream(stream)
            everything = rr.TimeRange(
                start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()
            )
            stream.log(f"{GLOBAL_VIEW}/TimeAxis", rrb.TimeAxis(view_range=everything))

    return Linked


def _space(results: Results) -> "rrb.Tabs":
    """Overview, follow, map; the map last and hidden, for it asks tile servers for the place."""
    import rerun.blueprint as rrb

    low, high = results.p_n.min(0), results.p_n.max(0)
    centre = (low + high) / 2
    size = max(float(np.max(high - low)), 20.0)
    above = rrb.EyeControls3D(
        position=centre + size * np.array([0.0, -0.5, 1.25]),
        look_target=centre,
        eye_up=[0.0, 0.0, 1.0],
        kind="Orbital",
    )
    behind = rrb.EyeControls3D(
        position=[0.0, -22.0, 11.0],
        look_target=[0.0, 6.0, 0.0],
        eye_up=[0.0, 0.0, 1.0],
        kind="Orbital",
    )
    overview = rrb.Spatial3DView(
        origin="/world",
        name="Overview",
        eye_controls=above,
        line_grid=False,
        overrides={"/world/incremental": rrb.EntityBehavior(visible=False)},
    )
    follow = rrb.Spatial3DView(
        origin="/world/vehicle",
        contents=["+ /world/**", "- /world/ellipses_3sigma"],
        name="Follow",
        eye_controls=behind,
    )
    chart = rrb.MapView(origin="/map", name="Map (asks tile servers)", zoom=zoom(results))
    return rrb.Tabs(overview, follow, chart, active_tab=0, name="Space")


def _plots(entries: list[Entry], logged: set[str]) -> "rrb.Tabs":
    import rerun.blueprint as rrb

    tabs: list[Any] = [_stack("Velocity", "/velocity", logged, units="m/s")]
    tabs += _stacks("Error against truth", "/error", entries, logged)
    tabs += _calibration(entries, logged)
    tabs += _residuals(logged)
    if "/summary" in logged:
        tabs.append(rrb.TextDocumentView(origin="/summary", name="Summary"))
    return rrb.Tabs(*tabs, active_tab=0, name="Plots")


def children(parent: str, logged: Iterable[str]) -> list[str]:
    """Direct children of an entity, in the order that reads best, unknown ones last by name."""
    depth = parent.count("/") + 2
    found = {"/".join(e.split("/")[:depth]) for e in logged if e.startswith(parent + "/")}
    known = [
        "forward",
        "lateral",
        "vertical",
        "east",
        "north",
        "up",
        *"xyz",
        *palette.MOTION,
        *curves.TITLE,
    ]
    rank = {name: k for k, name in enumerate(known)}
    return sorted(found, key=lambda e: (rank.get(e.rsplit("/")[-1], len(rank)), e))


def _plot(origin: str, name: str, y_range: tuple[float, float] | None = None) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=rrb.ScalarAxis(range=y_range) if y_range else None,
        plot_legend=rrb.Corner2D.RightTop,
    )


def _stack(name: str, parent: str, logged: set[str], units: str) -> Any:
    import rerun.blueprint as rrb

    plots = [
        _plot(e, f"{e.rsplit('/')[-1].capitalize()} [{units}]") for e in children(parent, logged)
    ]
    return rrb.Vertical(*plots, name=name, row_shares=[2.0] + [1.0] * (len(plots) - 1))


def _stacks(name: str, parent: str, entries: list[Entry], logged: set[str]) -> list[Any]:
    """One tab of stacked banded plots, or none when nothing of it was logged."""
    import rerun.blueprint as rrb

    ranges = {e.entity: e.y_range for e in entries if e.y_range}
    found = children(parent, logged)
    plots = [_plot(e, curves.label(e.rsplit("/")[-1]), ranges[e]) for e in found]
    columns = 1 if len(plots) <= STACKED else 2
    return [rrb.Grid(*plots, name=name, grid_columns=columns)] if plots else []


def _calibration(entries: list[Entry], logged: set[str]) -> list[Any]:
    import rerun.blueprint as rrb

    tabs: list[Any] = []
    for entity in children("/calibration", logged):
        tabs += _stacks(curves.title(entity.rsplit("/")[-1]), entity, entries, logged)
    return [rrb.Tabs(*tabs, name="Calibration")] if tabs else []


def _residuals(logged: set[str]) -> list[Any]:
    import rerun.blueprint as rrb

    plots = [
        _plot(e, f"{e.rsplit('/')[-1].capitalize()} residuals [σ]")
        for e in children("/residuals", logged)
    ]
    if "/weights/velocity" in logged:
        plots.append(_plot("/weights", "Robust weights", (-0.05, 1.05)))
    return [rrb.Vertical(*plots, name="Residuals")] if plots else []
