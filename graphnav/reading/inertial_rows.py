"""Gyro and accelerometer samples side by side, whether they share their rows or not."""

from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from graphnav.common.earth import G_STANDARD
from graphnav.reading.columns import ACCEL, GYRO
from graphnav.reading.dialect import MOST_DAMAGED
from graphnav.reading.samples import Rows, Samples

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inertial:
    """Inertial samples at the gyros' rows."""

    rows: Rows  # (M,)
    gyro: Array  # (M, 3) as recorded
    accel: Array  # (M, 3)
    sensed: tuple[bool, ...] = (True,) * 6  # gyro and accel x, y, z as recorded
    notes: tuple[str, ...] = ()


def inertial(samples: Samples, axes: Array) -> Inertial:
    """Both triads at the gyros' rows; `axes` (3, 3) turns what was recorded into b.

    Accelerometers on rows of their own are averaged over each interval of the gyros: their
    integral, interpolated, so that no velocity is lost. Raises `InputError` when a column is
    missing.
    """
    samples.need((_upright(axes),), "the heading")
    blind = _blind(samples, axes)
    samples.need(tuple(name for name in GYRO + ACCEL if name not in blind), "an inertial sample")
    there = replace(samples, columns=samples.columns | _stand_ins(samples, axes, blind))
    found = _side_by_side(there)
    sensed = tuple(name not in blind for name in GYRO + ACCEL)
    return replace(found, sensed=sensed, notes=(*_blind_noted(blind), *found.notes))


def _blind_noted(blind: tuple[str, ...]) -> list[str]:
    """What was not recorded, and what takes its place."""
    if not blind:
        return []
    if any(name in ACCEL for name in blind):
        instead = "the vehicle is taken to be level on the whole, within what roads slope"
    else:
        instead = "roll and pitch rest on the accelerometers"
    return [f"{', '.join(blind)} not recorded: {instead}"]


def _blind(samples: Samples, axes: Array) -> tuple[str, ...]:
    """Axes that were not recorded, left out or written as zero throughout: gyros about level axes,
    accelerometers.
    """
    like = {k for k in GYRO + ACCEL if get_close_matches(k, samples.ignored)}
    others = [name for name in GYRO + ACCEL if name not in (_upright(axes), *like)]
    return tuple(k for k in others if not np.nan_to_num(samples.columns.get(k, np.zeros(1))).any())


def _upright(axes: Array) -> str:
    """The gyro that turns with the vehicle's heading."""
    return GYRO[int(np.abs(axes[2]).argmax())]


def _stand_ins(samples: Samples, axes: Array, blind: tuple[str, ...]) -> dict[str, Array]:
    """What a level vehicle shows that neither turns nor gains speed, on the rows of the upright
    gyro.
    """
    if not blind:
        return {}
    none = 0.0 * samples.columns[_upright(axes)]
    force = dict(zip(ACCEL, G_STANDARD * axes[2], strict=True))
    return {name: none + force.get(name, 0.0) for name in blind}


def _side_by_side(samples: Samples) -> Inertial:
    """Both triads, whether they share their rows or not."""
    gyro_rows, gyro = samples.group(GYRO, "a gyro sample")
    accel_rows, accel = samples.group(ACCEL, "an accelerometer sample")
    if len(gyro_rows) == len(accel_rows) and (gyro_rows == accel_rows).all():
        return Inertial(gyro_rows, gyro, accel)
    both, in_gyro, in_accel = np.intersect1d(
        gyro_rows, accel_rows, assume_unique=True, return_indices=True
    )
    alone = max(len(gyro_rows), len(accel_rows)) - len(both)
    if alone <= MOST_DAMAGED * len(both):
        note = f"{alone} inertial samples hold gyros or accelerometers alone: left out"
        return Inertial(both, gyro[in_gyro], accel[in_accel], notes=(note,))
    time = samples.clock - samples.clock[0]
    inside = (gyro_rows >= accel_rows[:1].min(initial=len(time))) & (
        gyro_rows <= accel_rows[-1:].max(initial=-1) + 1
    )
    rows, gyro = gyro_rows[inside], gyro[inside]
    force = _means(time[rows], time[accel_rows], accel) if len(rows) > 1 else gyro
    note = (
        "gyros and accelerometers come on rows of their own: the accelerometers are averaged over "
        "the gyros' intervals"
    )
    return Inertial(rows, gyro, force, notes=(note,))


def _means(time: Array, own: Array, values: Array) -> Array:
    """Means over the intervals that end at `time` (M,) of means (K, 3) over those ending at
    `own`.
    """
    if len(own) < 2:
        return np.broadcast_to(values, (len(time), 3)).copy()
    step = np.diff(own, prepend=own[0] - np.median(np.diff(own)))
    edges = np.append(own[0] - step[0], own)
    integral = np.vstack([np.zeros(3), np.cumsum(values * step[:, None], axis=0)])
    starts = np.concatenate([[time[0] - np.median(np.diff(time))], time[:-1]])
    # at the ends intervals reach beyond the accelerometers: their mean over what there is
    starts = np.clip(starts, edges[0], edges[-2])
    ends = np.clip(time, starts + 1e-9, np.maximum(edges[-1], starts + 1e-9))
    gained = [np.interp(ends, edges, c) - np.interp(starts, edges, c) for c in integral.T]
    return np.asarray(np.stack(gained, -1) / (ends - starts)[:, None])
