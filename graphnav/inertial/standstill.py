"""Where the vehicle stands: spans in which the odometer does not count and the IMU is quiet."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from factors.preintegration import Increments
from graphnav.common.earth import Origin
from graphnav.common.run import Array, Gnss, Odometer
from graphnav.inertial.odometry import heard, speed_at

Mask = NDArray[np.bool_]

WINDOW_S = 1.0
SHORTEST_S = 1.0
BEGINS_S = 0.7  # of the run's start: a rest that begins later is no standing start
REACH_S = 0.2  # beyond its samples an odometer's silence means nothing
SPEED_SLACK, SPEED_DRIFT = 0.3, 0.01  # m/s and m/s^2, of a speed reckoned from the IMU alone
MOST_SLACK = 1.5  # m/s; a speed known worse than this tells no stop from a crawl
BRAKING_S, BRAKING_SLACK = 2.0, 2.5  # s before a rest, m/s of braking the IMU may miss there
FIXED_SPEED, FIXED_SIGMAS = 1.0, 3.0  # m/s and deviations by which fixes contradict a rest
# without an odometer the IMU alone must be this still: m/s^2 and rad/s, standard deviations
QUIET_FORCE, QUIET_RATE, SLOW_RATE = 0.06, 0.004, 0.01


def standing(inc: Increments, odometer: Odometer | None) -> Mask:
    """Whether the vehicle stands during each increment, (M,).

    With an odometer its silence names the candidates, and the quietness usual among them decides;
    an odometer that reads zero while the vehicle creeps is thus overruled by the IMU.
    """
    shake, turn, slow, silent = quietness(inc, odometer)
    unheard = (shake < QUIET_FORCE) & (turn < QUIET_RATE) & slow
    if odometer is None:
        quiet = unheard
    else:
        silent = silent | _before_the_odometer(inc, odometer, unheard)
        if not silent.any():
            return silent
        quiet = silent & (shake < 4 * np.median(shake[silent]) + 1e-3)
        quiet &= turn < 4 * np.median(turn[silent]) + 1e-6
        found = spans(_long_enough(quiet, np.diff(inc.edge)), inc.edge)
        quiet &= within(inc, braked(found, inc, odometer))
    return _long_enough(quiet, np.diff(inc.edge))


def _before_the_odometer(inc: Increments, odometer: Odometer, quiet: Mask) -> Mask:
    """A quiet beginning of the run, over before the odometer is heard: a standing start."""
    early = inc.edge[1:] < odometer.time[0] - REACH_S
    begun = np.logical_and.accumulate(quiet & early)
    return np.asarray(begun & (begun.sum() * np.diff(inc.edge).mean() > SHORTEST_S))


def quietness(inc: Increments, odometer: Odometer | None) -> tuple[Array, Array, Mask, Mask]:
    """How quiet it is about each increment: deviation of force [m/s^2] and of rate [rad/s], whether
    it turns slowly, whether the odometer (if any) shows no motion; (M,) each, over `WINDOW_S`.
    """
    dt = np.diff(inc.edge)
    width = max(3, round(WINDOW_S / float(np.median(dt))))
    force, rate = inc.velocity / dt[:, None], inc.rotation / dt[:, None]
    slow = np.linalg.norm(uniform_filter1d(rate, width, axis=0), axis=1) < SLOW_RATE
    silent = np.zeros(len(dt), bool) if odometer is None else _odometer_silent(inc, odometer)
    return _deviation(force, width), _deviation(rate, width), slow, silent


def spans(mask: Mask, edge: Array) -> Array:
    """Runs of True as (K, 2) start and end times, s."""
    change = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.stack([edge[np.flatnonzero(change == 1)], edge[np.flatnonzero(change == -1)]], -1)


def believable(rests: Array, time: Array, speed: Array) -> Array:
    """The rests (K, 2) s at which a reckoned speed (n,) m/s at `time` may have been zero.

    Without an odometer a smooth ride at constant speed is as quiet as a stop. The first rest, when
    the run begins with it, is believed; each later one only while the speed reckoned since the last
    believed rest is small against its own drift. A stop missed costs little, a false one ruins all.
    """
    kept: list[Array] = []
    for rest in rests:
        if not kept:
            if rest[0] - time[0] < BEGINS_S:
                kept.append(rest)
            continue
        since = float(rest[0] - kept[-1][1])
        gained = np.interp(rest, time, speed) - np.interp(kept[-1][1], time, speed)
        slack = SPEED_SLACK + SPEED_DRIFT * since
        if slack < MOST_SLACK and np.abs(gained).max() < slack:
            kept.append(rest)
    return np.array(kept).reshape(-1, 2)


def braked(rests: Array, inc: Increments, odometer: Odometer) -> Array:
    """The rests (K, 2) s before which the IMU slows as the odometer does: a locked wheel is none.

    Gravity along the vehicle is taken from the rest itself.
    """
    kept = []
    forward = np.concatenate([[0.0], np.cumsum(inc.velocity[:, 1])])
    for start, end in rests:
        before = max(start - BRAKING_S, inc.edge[0])
        v_before, v_start, v_end = np.interp([before, start, end], inc.edge, forward)
        gravity = (v_end - v_start) / (end - start)
        slowed = v_start - v_before - gravity * (start - before)
        if abs(slowed + float(speed_at(odometer, np.array(before)))) < BRAKING_SLACK:
            kept.append((start, end))
    return np.array(kept).reshape(-1, 2)


def unmoved(rests: Array, gnss: Gnss) -> Array:
    """The rests (K, 2) s that fixes do not contradict by moving along."""
    kept = []
    lat, lon, height = np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg), gnss.height
    fixes_n = Origin(float(lat[0]), float(lon[0]), float(height[0])).local(lat, lon, height)
    for start, end in rests:
        on = np.flatnonzero((gnss.time >= start - 0.5) & (gnss.time <= end + 0.5))
        few = max(1, len(on) // 4)
        if len(on) >= 2:
            away = np.median(fixes_n[on[-few:], :2], 0) - np.median(fixes_n[on[:few], :2], 0)
            moved = float(np.linalg.norm(away))
            sd = float(np.median(gnss.sd_enu[on, :2]))
            if moved > FIXED_SPEED * (end - start) and moved > FIXED_SIGMAS * np.sqrt(2) * sd:
                continue
        kept.append((start, end))
    return np.array(kept).reshape(-1, 2)


def rocking(inc: Increments, rests: Array, gyro: float) -> Array:
    """One sigma of the body's angle about its mean while it stands, by axis, (3,) rad.

    The gyro's angle with its trend taken off: an idling engine shakes, wind and people rock. What
    the gyro's own random walk (`gyro` rad/sqrt(s)) leaves of that, T/15 of its square, is not the
    vehicle's. The median over the rests.
    """
    found = []
    inc_dt = float(np.diff(inc.edge).mean())
    for start, end in rests:
        on = (inc.edge[:-1] >= start) & (inc.edge[1:] <= end)
        angle = np.cumsum(inc.rotation[on][: round(60 / inc_dt)], 0)
        if len(angle) > 10:
            t = np.linspace(-1, 1, len(angle))
            angle = angle - angle.mean(0)
            trend = t[:, None] * (t @ angle) / (t @ t)
            own = gyro**2 * inc_dt * len(angle) / 15
            found.append(np.sqrt(np.maximum((angle - trend).var(0) - own, 0.1 * own)))
    return np.median(found, 0) if found else np.zeros(3)


def within(inc: Increments, rests: Array) -> Mask:
    """Whether each increment lies in one of the rests, (M,)."""
    mask = np.zeros(len(inc.edge) - 1, bool)
    for start, end in rests:
        mask |= (inc.edge[:-1] >= start - 1e-9) & (inc.edge[1:] <= end + 1e-9)
    return mask


def _deviation(x: Array, width: int) -> Array:
    """Standard deviation of a vector (M, 3) over a centred window, norm over axes, (M,)."""
    centred = x - x.mean(0)
    mean = uniform_filter1d(centred, width, axis=0)
    square = uniform_filter1d(centred**2, width, axis=0)
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0).sum(1)))


def _odometer_silent(inc: Increments, odometer: Odometer) -> Mask:
    """Whether the odometer shows no motion within half a window of each increment."""
    half = WINDOW_S / 2
    mid = 0.5 * (inc.edge[1:] + inc.edge[:-1])
    distance = np.interp(mid + half, odometer.time, odometer.distance) - np.interp(
        mid - half, odometer.time, odometer.distance
    )
    covered = heard(odometer.time, mid, mid, REACH_S)
    # one count may fall at rest (rocking); a noisy speed counts as zero below 5 cm/s
    limit = max(1.01 * odometer.pulse, 0.05 * WINDOW_S)
    return np.asarray(covered & (np.abs(distance) <= limit))


def _long_enough(mask: Mask, dt: Array) -> Mask:
    """Drop runs shorter than `SHORTEST_S`."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    out = mask.copy()
    for a, b in zip(change[::2], change[1::2], strict=True):
        if dt[a:b].sum() < SHORTEST_S:
            out[a:b] = False
    return out
