"""The run in space: paths, fixes, uncertainty ellipses and the moving vehicle, in metres of n."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from factors import so3
from graphnav.result import palette
from graphnav.result.result_directory import Results, columns, state_spans, thin
from graphnav.views.recording.entry import SERIES_LIMIT, STRIP_LIMIT, Entry, over_time, static

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]

ELLIPSES = 60  # along the whole path: they stay apart
ELLIPSE_SHARE = 0.02  # of the extent of the run: the size of the largest one when drawn
SIGMAS = 3.0
VEHICLE_HALF = [1.4, 2.8, 1.0]  # m, right forward up: a marker, not the real vehicle


def entries(results: Results) -> list[Entry]:
    """Everything below `/world`."""
    return [
        *_smoothed(results),
        *_line("/world/dead_reckoning", results.dead_reckoning, palette.DEAD_RECKONING, 1.2),
        *_line("/world/truth", results.truth, palette.TRUTH, 0.7),
        *_line("/world/incremental", results.causal, palette.CAUSAL, 1.0),
        *_fixes(results),
        *_ellipses(results),
        *_vehicle(results),
    ]


def coloured_strips(results: Results) -> tuple[list[NDArray[np.intp]], NDArray[np.uint32]]:
    """Trajectory rows of one strip per motion state, thinned for drawing, and their colours."""
    spans = state_spans(results)
    share = min(1.0, STRIP_LIMIT / len(results.time))
    rows = [a + thin(b - a + 1, max(2, round((b - a + 1) * share))) for _, a, b in spans]
    colours = [palette.rgba32(palette.motion(state)) for state, _, _ in spans]
    return rows, np.array(colours, np.uint32)


def _smoothed(results: Results) -> list[Entry]:
    import rerun as rr

    rows, colours = coloured_strips(results)
    strips = [results.p_n[r] for r in rows]
    drawn = rr.LineStrips3D(strips, colors=colours, radii=rr.Radius.ui_points(2.2))
    return static("/world/smoothed", drawn)


def _line(entity: str, table: "DataFrame | None", colour: str, width: float) -> list[Entry]:
    import rerun as rr

    if table is None:
        return []
    p_n = columns(table, "e", "n", "u")[thin(len(table), STRIP_LIMIT)]
    p_n = p_n[np.isfinite(p_n).all(1)]
    colours = np.array([palette.rgba32(colour)], np.uint32)
    return static(entity, rr.LineStrips3D([p_n], colors=colours, radii=rr.Radius.ui_points(width)))


def fix_colours(gnss: "DataFrame") -> NDArray[np.uint32]:
    """One colour per fix: down-weighted ones (weight below one half) stand out."""
    weight = gnss["weight"].to_numpy(float) if "weight" in gnss else np.ones(len(gnss))
    used, bad = palette.rgba32(palette.GNSS), palette.rgba32(palette.DOWN_WEIGHTED)
    return np.where(weight < 0.5, bad, used).astype(np.uint32)


def _fixes(results: Results) -> list[Entry]:
    import rerun as rr

    if results.gnss is None:
        return []
    gnss = results.gnss.iloc[thin(len(results.gnss), STRIP_LIMIT)]
    p_n = columns(gnss, "e", "n", "u")
    points = rr.Points3D(p_n, colors=fix_colours(gnss), radii=rr.Radius.ui_points(1.3))
    return static("/world/gnss", points)


def exaggeration(results: Results) -> float:
    """How many times larger than 3 sigma the ellipses are drawn: 1, 2, 5, 10, 20, 50, ..."""
    extent = float(np.ptp(results.p_n[:, :2], axis=0).max())
    largest = SIGMAS * float(np.nanmax(columns(results.trajectory, "sd_e", "sd_n", "sd_u")))
    if not largest > 0.0 or not extent > 0.0:
        return 1.0
    steps = [a * 10.0**b for b in range(5) for a in (1, 2, 5)]
    return max([s for s in steps if s * largest <= ELLIPSE_SHARE * extent], default=1.0)


def covariances(results: Results, rows: NDArray[np.intp]) -> Array:
    """Position covariances (M, 3, 3) m^2 in n; `corr_en` couples east and north when it is told."""
    table = results.trajectory.iloc[rows]
    sd = np.nan_to_num(columns(table, "sd_e", "sd_n", "sd_u"))
    P = sd[:, :, None] ** 2 * np.eye(3)
    if "corr_en" in table:
        P[:, 0, 1] = P[:, 1, 0] = (
            np.nan_to_num(columns(table, "corr_en")[:, 0]) * sd[:, 0] * sd[:, 1]
        )
    return P


def _ellipses(results: Results) -> list[Entry]:
    import rerun as rr

    rows = _apart(results)
    variances, axes = np.linalg.eigh(covariances(results, rows))
    axes = axes * np.sign(np.linalg.det(axes))[:, None, None]  # rotations, not reflections
    half_sizes = SIGMAS * exaggeration(results) * np.sqrt(np.clip(variances, 0.0, None))
    drawn = rr.Ellipsoids3D(
        centers=results.p_n[rows],
        half_sizes=half_sizes,
        quaternions=so3.quaternion(axes),
        colors=np.array([palette.rgba32("#c8ccd4", 110)], np.uint32),
        line_radii=rr.Radius.ui_points(0.6),
        fill_mode="MajorWireframe",
    )
    return static("/world/ellipses_3sigma", drawn)


def _apart(results: Results) -> NDArray[np.intp]:
    """Trajectory rows at even distances along the path."""
    steps = np.linalg.norm(np.diff(results.p_n, axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    marks = np.linspace(0.0, distance[-1], ELLIPSES)
    return np.unique(np.minimum(np.searchsorted(distance, marks), len(distance) - 1))


def _vehicle(results: Results) -> list[Entry]:
    import rerun as rr

    rows = thin(len(results.time), SERIES_LIMIT)
    moving = rr.Transform3D.columns(
        translation=results.p_n[rows], quaternion=so3.quaternion(results.R_nb[rows])
    )
    colour = np.array([palette.rgba32("#f2f4f8")], np.uint32)
    # in screen points, so that the vehicle is seen in the overview too
    dot = rr.Points3D([[0.0, 0.0, 0.0]], colors=colour, radii=rr.Radius.ui_points(4.0))
    box = rr.Boxes3D(half_sizes=[VEHICLE_HALF], colors=colour, radii=rr.Radius.ui_points(1.0))
    time = results.time[rows] - results.clock_start
    return [
        over_time("/world/vehicle", time, moving),
        *static("/world/vehicle", rr.TransformAxes3D(6.0), box, dot),
    ]
