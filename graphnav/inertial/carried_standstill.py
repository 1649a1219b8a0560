"""Where a vehicle at standstill is carried: a ferry, a lift, a crawl that the wheel sensor misses.

The running gear says nothing of such motion. Fixes that move along contradict it horizontally; the
accelerometers contradict it where a pause between two quiet spans changes the velocity. What is
contradicted is not held at zero; the rest is.
"""

import numpy as np
from numpy.typing import ArrayLike

from factors import so3
from factors.preintegration import Increments, InertialNoise, preintegrate
from graphnav.common.earth import Origin
from graphnav.common.run import Array, Gnss
from graphnav.inertial.standstill_evidence import Mask, within

WINDOW_S = 20.0  # of fixes that show a speed
FIXED_SPEED, FIXED_SIGMAS = 1.0, 3.0  # m/s and deviations by which fixes contradict a standstill
CREPT_SIGMAS, CREPT_SPEED = 6.0, 0.05  # the same over a whole stop of the gear
STEADY = 0.25  # share of the fixes that must lie in the middle half of the way
FEWEST_FIXES = 4
PAUSE_S = 20.0  # between quiet spans, over which a change of velocity is reckoned
LEVEL_S = 20.0  # of a standstill that levels
HORIZONTAL, VERTICAL = 0, 1  # columns
# m/s and m/s^2: velocity two standstills may differ by, over the pause between them
SLACK, DRIFT = 0.08, np.array([0.03, 0.02])
MOST_TURN = 0.1  # rad in a pause; with more the accelerometers' biases turn into the horizontal
UNKNOWN = 1e6  # m/s


def moved_along(gear_stops: Array, gnss: Gnss) -> Array:
    """Spans (K, 4) in the stops (S, 2) s in which fixes travel, as `carried_in` has them."""
    found = list[tuple[float, float, float, float]]()
    for start, end in gear_stops.tolist():
        for until in [*np.arange(start + WINDOW_S / 2, end, 1.0).tolist(), end]:
            found += travels(gnss, start, until)
        found += creeps(gnss, start, end)
    return np.array(found, dtype=np.float64).reshape(-1, 4)


def travels(gnss: Gnss, start: float, until: float) -> list[tuple[float, float, float, float]]:
    """The window before `until`, in a stop of the gear since `start`, if fixes travel in it."""
    since = max(start, until - WINDOW_S)
    moves = _moved(gnss, (since, until), FIXED_SIGMAS, FIXED_SPEED)
    return [(since, until, 1.0, 0.0)] if moves else []


def creeps(gnss: Gnss, start: float, until: float) -> list[tuple[float, float, float, float]]:
    """The whole stop, if fixes move steadily in it, however slowly."""
    moves = _moved(gnss, (start, until), CREPT_SIGMAS, CREPT_SPEED)
    return [(start, until, 1.0, 0.0)] if moves else []


def carried_in(edge: Array, spans: Array) -> Mask:
    """Whether each increment between `edge` (M + 1,) s is carried horizontally, vertically, (M, 2).

    `spans` (K, 4): start, end [s] and whether horizontally and vertically.
    """
    out = np.zeros((len(edge) - 1, 2), bool)
    for start, end, *along in spans.tolist():
        out |= within(edge, np.array([[start, end]]))[:, None] & (np.array(along) > 0)
    return out


def _moved(
    gnss: Gnss,
    span: tuple[float, float],
    sigmas: float,
    speed: float,
) -> bool:
    """Whether the fixes of a span travel by more than deviations and a speed allow.

    Steadily: multipath sets them aside at once.
    """
    on = slice(*np.searchsorted(gnss.time, [span[0], span[1] + 1e-9]))
    t = gnss.time[on]
    third = len(t) // 3
    if len(t) < FEWEST_FIXES or t[-1] - t[0] < WINDOW_S / 4:
        return False
    lat, lon, height = np.deg2rad(gnss.lat_deg[on]), np.deg2rad(gnss.lon_deg[on]), gnss.height[on]
    at = Origin(float(lat[0]), float(lon[0]), float(height[0])).local(lat, lon, height)[:, :2]
    begin, end = slice(0, third), slice(len(t) - third, None)
    first = np.median(at[begin], 0)
    away = np.median(at[end], 0) - first
    moved = float(np.linalg.norm(away))
    lasted = float(np.median(t[end]) - np.median(t[begin]))
    sd = float(np.median(gnss.sd_enu[on, :2]))
    if moved < speed * lasted or moved < sigmas * np.sqrt(2) * sd:
        return False
    gone = (at - first) @ away / moved**2
    return bool(np.mean((gone > 0.25) & (gone < 0.75)) > STEADY)


def velocity_gained(inc: Increments, span: Array, until: float) -> tuple[Array, Array, float]:
    """Velocity gained since a standstill (start, end) s [m/s], upward direction, turn [rad].

    In the body frame of that standstill, from what it showed of gravity and biases. The turn of
    the body against the Earth's axis is left out: for seconds only.
    """
    a, b, end = np.searchsorted(inc.edge, [max(span[0], span[1] - LEVEL_S), span[1], until])
    T = inc.edge[b] - inc.edge[a]
    force, rate = inc.velocity[a:b].sum(0) / T, inc.rotation[a:b].sum(0) / T
    on = slice(int(b), int(end))
    pause = Increments(
        inc.edge[b : end + 1],
        inc.rotation[on],
        inc.velocity[on],
        inc.position[on],
        inc.jump[on],
    )
    nodes = np.array([0, end - b])
    errors = np.append(rate, np.zeros(9))[None]
    pre = preintegrate(pause, nodes, errors, InertialNoise(1.0, 1.0))
    turn = float(np.linalg.norm(so3.log(pre.dR)))
    return pre.dv[0] - force * pre.T[0], force / np.linalg.norm(force), turn


def moving_standstills(inc: Increments, standstills: Array, gear_stops: ArrayLike) -> Array:
    """Spans of the standstills (K, 2) s that move against others of their stop of the gear: start,
    end [s] and whether along the horizontal and the vertical, (L, 4).

    Pauses of up to `PAUSE_S` tell. Of the velocities in a stop of the gear the one that is returned
    to, and lasts, is zero: nothing but standstill is returned to exactly. A span reaches from the
    standstill before to the one after.
    """
    found = []
    for start, end in np.asarray(gear_stops, dtype=np.float64):
        inside = standstills[
            (standstills[:, 0] >= start - 1e-6) & (standstills[:, 1] <= end + 1e-6)
        ]
        gaps = np.flatnonzero(inside[1:, 0] - inside[:-1, 1] > PAUSE_S) + 1
        for group in np.split(inside, gaps):
            moving = _moving(inc, group)
            before = np.append(start, group[:-1, 1]) if len(group) else group[:, 0]
            after = np.append(group[1:, 0], end) if len(group) else group[:, 1]
            for k in np.flatnonzero(moving.any(1)):
                found.append((before[k], after[k], *moving[k]))
    return np.array(found, dtype=np.float64).reshape(-1, 4)


def _moving(inc: Increments, group: Array) -> Mask:
    """Whether each of some standstills (K, 2) s moves, horizontally and vertically, (K, 2)."""
    if len(group) < 2:
        return np.zeros((len(group), 2), bool)
    v, blur, up = [np.zeros(3)], [np.zeros(2)], np.array([0.0, 0.0, 1.0])
    for span, until in zip(group[:-1], group[1:, 0], strict=True):
        gained, up, turn = velocity_gained(inc, span, float(until))
        lost = DRIFT * (until - span[1]) + (UNKNOWN * (turn > MOST_TURN), 0.0)
        v.append(v[-1] + gained)
        blur.append(blur[-1] + lost)
    apart = np.array(v)[:, None] - np.array(v)
    along = apart @ up
    across = np.linalg.norm(apart - along[:, :, None] * up, axis=2)
    allowed = SLACK + np.abs(np.array(blur)[:, None] - np.array(blur))
    same = np.stack([across, np.abs(along)], -1) < allowed
    both = same.all(2)
    lasting = both @ (group[:, 1] - group[:, 0])
    return np.asarray(~same[int((lasting * both.sum(1) ** 2).argmax())])
