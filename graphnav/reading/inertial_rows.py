"""Gyro and accelerometer samples side by side, whether they share their rows or not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    note: str | None = None


def inertial(samples: Samples) -> Inertial:
    """Both triads at the gyros' rows.

    Accelerometers on rows of their own are averaged over each interval of the gyros: their
    integral, interpolated, so that no velocity is lost. Raises `InputError` when a column is
    missing.
    """
    samples.need(GYRO + ACCEL, "an inertial sample")
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
        return Inertial(both, gyro[in_gyro], accel[in_accel], note)
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
    return Inertial(rows, gyro, force, note)


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
