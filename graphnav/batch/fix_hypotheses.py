"""Mistakes about the start, the fixes and their antenna, as changes that would undo them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from graphnav.batch.doubts import distance
from graphnav.batch.hypothesis import Hypothesis, Undone, said
from graphnav.common.angles import wrapped
from graphnav.common.run import Array, Gnss, Run
from graphnav.inertial.alignment import ANOTHER_PLACE
from graphnav.reading.plausibility import FAR_M, away_m
from graphnav.reading.vehicle import Vehicle
from graphnav.result.solved import Solved, start_heading_deg


def of_start(vehicle: Vehicle) -> list[Hypothesis]:
    """The stated position or heading is wrong."""
    found = []
    if vehicle.start.has_position:

        def nowhere(run: Run, vehicle: Vehicle) -> Undone:
            return run, _unplaced(vehicle)

        cure = said(ANOTHER_PLACE)
        found.append(Hypothesis(nowhere, lambda solved: _away(solved, vehicle), cure))
    stated = vehicle.start.heading_deg
    if stated is None:
        return found

    def headless(run: Run, vehicle: Vehicle) -> Undone:
        start = vehicle.start.model_copy(update={"heading_deg": None})
        return run, vehicle.model_copy(update={"start": start})

    def off(solved: Solved) -> str:
        wrong = float(wrapped(stated - start_heading_deg(solved), 360.0))
        return f"the heading stated in [start] is wrong by {wrong:.0f} deg"

    def right(solved: Solved) -> str:
        return f"leave out [start] heading_deg, or state {start_heading_deg(solved):.1f}"

    return [*found, Hypothesis(headless, off, right)]


def _unplaced(vehicle: Vehicle) -> Vehicle:
    """The vehicle without a stated position."""
    start = vehicle.start.model_copy(update={"lat": None, "lon": None})
    return vehicle.model_copy(update={"start": start})


def _away(solved: Solved, vehicle: Vehicle) -> str:
    """How far the stated position is from where the fixes put the start."""
    at = vehicle.start
    lat, lon = np.deg2rad([at.lat or 0.0, at.lon or 0.0])
    off = solved.origin.local(lat, lon, np.asarray(0.0)) - solved.path.p_n[0]
    away = distance(float(np.hypot(*off[:2])))
    return f"[start] is {away} from the fixes"


def of_fixes(run: Run, vehicle: Vehicle) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Signs, order and unit of the fixes' coordinates: the changes that bring fixes from far away
    to [start], and the others."""
    assert run.gnss is not None
    here: list[Hypothesis] = []
    others: list[Hypothesis] = []
    far = _far(run.gnss, vehicle)
    for change, why, cure in _changes(run.gnss):
        nearer = far and not _far(change(run.gnss), vehicle)
        (here if nearer else others).append(_with_fixes(change, why, cure))
    return here, others


Change = Callable[[Gnss], Gnss]


def _changes(gnss: Gnss) -> list[tuple[Change, str, str]]:
    """What may have happened to the coordinates, undone; and words for it."""
    found: list[tuple[Change, str, str]] = [
        (lambda g: replace(g, lon_deg=-g.lon_deg),
         "the longitude of the fixes has lost its sign (west is negative)",
         "longitude without its sign? give gnss_lon its sign"),
        (lambda g: replace(g, lat_deg=-g.lat_deg),
         "the latitude of the fixes has lost its sign (south is negative)",
         "latitude without its sign? give gnss_lat its sign"),
        (lambda g: replace(g, lat_deg=_of_minutes(g.lat_deg), lon_deg=_of_minutes(g.lon_deg)),
         "the fixes' decimals are minutes: ddmm.mmmm taken for degrees",
         "gnss_lat, gnss_lon in degrees: dd + mm.mmmm / 60"),
    ]  # fmt: skip
    if np.all(np.abs(gnss.lon_deg) < 90):
        found.append(
            (lambda g: replace(g, lat_deg=g.lon_deg, lon_deg=g.lat_deg),
             "latitude and longitude of the fixes are exchanged",
             "exchange gnss_lat and gnss_lon under [columns]")
        )  # fmt: skip
    return found


def _with_fixes(change: Change, why: str, cure: str) -> Hypothesis:
    def undo(run: Run, vehicle: Vehicle) -> Undone:
        assert run.gnss is not None
        return replace(run, gnss=change(run.gnss)), _unplaced(vehicle)

    return Hypothesis(undo, said(why), said(cure))


def _far(gnss: Gnss, vehicle: Vehicle) -> bool:
    """Whether the fixes lie far from a stated start."""
    at = vehicle.start
    if at.lat is None or at.lon is None:
        return False
    lat, lon = np.median([gnss.lat_deg, gnss.lon_deg], axis=1)
    return away_m(at.lat, at.lon, lat, lon) > FAR_M


def _of_minutes(deg: Array) -> Array:
    """Degrees of degrees and hundredths that are minutes."""
    whole = np.trunc(deg)
    return np.asarray(whole + (deg - whole) / 0.6)


def of_antenna(vehicle: Vehicle) -> list[Hypothesis]:
    """Sign and unit of the antenna's lever arm."""
    stated = vehicle.gnss.lever_arm
    if stated is None or not any(stated):
        return []

    def with_lever(by: float) -> Callable[[Run, Vehicle], Undone]:
        def undo(run: Run, vehicle: Vehicle) -> Undone:
            lever = tuple(by * x for x in vehicle.gnss.lever_arm or ())
            spec = vehicle.gnss.model_copy(update={"lever_arm": lever})
            return run, vehicle.model_copy(update={"gnss": spec})

        return undo

    return [
        Hypothesis(with_lever(-1.0), said("the antenna's lever arm has the wrong sign"),
                   said("[gnss] lever_arm goes from the IMU to the antenna: right, forward, up")),
        Hypothesis(with_lever(0.01), said("the antenna's lever arm is 100 times too long"),
                   said("[gnss] lever_arm is in metres, not in centimetres")),
    ]  # fmt: skip
