"""Jumps of the recording's clock: all sensors fall silent at once, and nothing happened meanwhile.

After a stall of the host the samples that waited follow at once, and it is none. A pause of the
recorder looks the same in the stamps. What was driven tells them apart: across a
pause of s seconds a vehicle at v goes on by about v s, across a jump of the clock by nothing. A
counter shows that, and so do fixes.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from graphnav.common.earth import Origin
from graphnav.common.run import Array, Odometer, Run
from graphnav.inertial.encoder import counted_anew

LEAST_S, STEPS = 0.3, 5.0  # s and sampling steps: a shorter silence is that of lost samples
MOST = 20  # silences that are looked at, the longest
BESIDE_S = 1.0  # to either side that tell the speed
DRIVING = 1.0  # m/s: slower, and nothing tells a pause from a jump
COUNTS, PACE = 3.0, 0.1  # counts, and share of the way between, that a counter may be off
BRAKES = 3.0  # m/s^2 in the step that was seen
PAIRS = 4  # of fixes, the nearest before and after
SIGMAS, BENDS = 3.0, 0.05  # of a fix, and share of the way that a chord is shorter in a bend
APART = 2.0  # times what may be off: pause and jump have to differ by so much


def without_jumps(run: Run) -> Run:
    """The run with jumps of its clock taken back, and told, where what was driven shows them."""
    assert run.imu is not None
    gone = np.diff(run.imu.time)
    step = float(np.median(gone))
    silent = np.flatnonzero(gone > max(LEAST_S, STEPS * step))
    silent = np.sort(silent[np.argsort(-gone[silent])][:MOST])
    for at in silent[::-1].tolist():  # from the end: times before stay as they are
        start, end = float(run.imu.time[at]), float(run.imu.time[at + 1])
        jump = end - start - step
        if _caught_up(run.imu.time[at:], jump, step):
            continue
        if _heard(run, start, end) or not _nothing_happened(run, start, end, jump):
            continue
        note = (
            f"the clock jumps by {jump:.3g} s after {run.clock_start + start:.3f}: the vehicle did "
            "not drive on meanwhile, as what it counted or its fixes show; taken off all later "
            "times, also in the results"
        )
        run = _set_back(run, end, jump, note)
    return run


def _caught_up(time: Array, jump: float, step: float) -> bool:
    """Whether the samples after a silence, the first of the times (n,) s, came faster until they
    were on time again: the host stalled, neither the recorder nor its clock.
    """
    ahead = time[1 : 2 + round(2 * jump / step)]
    late = ahead - time[0] - step * np.arange(1, len(ahead) + 1)
    return float(late.min()) < jump / 2


def _sensors(run: Run) -> dict[str, Array]:
    """Stamps of every sensor of a run."""
    found = {field.name: getattr(run, field.name) for field in fields(run)}
    return {name: sensor.time for name, sensor in found.items() if hasattr(sensor, "time")}


def _heard(run: Run, start: float, end: float) -> bool:
    """Whether any sensor spoke within a span."""
    return any(((t > start) & (t < end)).any() for t in _sensors(run).values())


def _nothing_happened(run: Run, start: float, end: float, jump: float) -> bool:
    """Whether what was driven across a silence is that of a jump, and nothing says otherwise."""
    shown = [
        verdict
        for verdict in (_counted(run, start, end, jump), _fixed(run, start, end, jump))
        if verdict is not None
    ]
    return bool(shown) and all(shown)


def _counted(run: Run, start: float, end: float, jump: float) -> bool | None:
    """What a counter says; None where it says nothing."""
    odometer = run.odometer
    if odometer is None or odometer.pulse == 0 or (speed := _speed(odometer, start, end)) is None:
        return None
    j = int(np.searchsorted(odometer.time, end))
    went = abs(float(odometer.distance[j] - odometer.distance[j - 1]))
    between = float(odometer.time[j] - odometer.time[j - 1]) - jump
    off = COUNTS * odometer.pulse + PACE * speed * between + BRAKES * between**2 / 2
    return _verdict(went - speed * between, speed * jump, off)


def _fixed(run: Run, start: float, end: float, jump: float) -> bool | None:
    """What the fixes say; None where they say nothing."""
    gnss = run.gnss
    if gnss is None:
        return None
    j = int(np.searchsorted(gnss.time, end))
    pairs = np.arange(min(PAIRS, j, len(gnss.time) - j))
    if len(pairs) < PAIRS:
        return None
    after, before = j + pairs, j - 1 - pairs
    lat, lon = np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg)
    origin = Origin(float(lat[j]), float(lon[j]), float(gnss.height[j]))
    p_n = origin.local(lat, lon, gnss.height)[:, :2]
    went = np.linalg.norm(p_n[after] - p_n[before], axis=1)
    between = gnss.time[after] - gnss.time[before] - jump
    speed = None if run.odometer is None else _speed(run.odometer, start, end)
    if speed is None:
        own = [
            float(np.linalg.norm(p_n[k[0]] - p_n[k[-1]]) / np.ptp(gnss.time[k]))
            for k in (before, after)
        ]
        speed = float(np.mean(own))
        if min(own) < DRIVING:
            return None
    sd = float(np.median(gnss.sd_enu[np.concatenate([before, after]), :2]))
    off = SIGMAS * sd / np.sqrt(PAIRS / 2) + BENDS * speed * float(np.median(between))
    return _verdict(float(np.median(went - speed * between)), speed * jump, off)


def _verdict(beyond: float, pause: float, off: float) -> bool | None:
    """True for a jump, False for a pause; `beyond` m more were driven than a jump explains."""
    if pause < APART * off:
        return None
    return abs(beyond) < off


def _speed(odometer: Odometer, start: float, end: float) -> float | None:
    """Mean speed to either side of a silence, m/s; None where it does not drive on both sides."""
    sides = [
        (odometer.time > start - BESIDE_S) & (odometer.time <= start),
        (odometer.time > end) & (odometer.time <= end + BESIDE_S),
    ]
    if not all(side.any() for side in sides):
        return None
    speeds = [float(np.median(odometer.speed[side])) for side in sides]
    if min(speeds) < DRIVING and max(speeds) > -DRIVING:
        return None
    return abs(float(np.mean(speeds)))


def _set_back(run: Run, end: float, jump: float, note: str) -> Run:
    """The run with `jump` s taken off the times from `end` on."""
    moved: dict[str, Any] = {}
    for name, time in _sensors(run).items():
        sensor = replace(getattr(run, name), time=np.where(time >= end, time - jump, time))
        moved[name] = counted_anew(sensor) if isinstance(sensor, Odometer) else sensor
    if run.imu is not None:
        imu = moved["imu"]
        at = int(np.searchsorted(run.imu.time, end))
        dt = imu.dt.copy()
        dt[at] = imu.time[at] - imu.time[at - 1]
        moved["imu"] = replace(imu, dt=dt)
    return replace(run, **moved, end=run.end - jump, notes=(*run.notes, note))
