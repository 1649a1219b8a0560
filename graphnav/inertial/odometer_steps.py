"""The odometer on the grid of the inertial increments: its steps, and their sums between nodes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import so3
from factors.block import Index
from factors.displacement import OdometerSums
from factors.preintegration import (
    GYRO,
    GYRO_SCALE,
    Increments,
    Preintegrated,
    corrected,
    interval_of_increment,
)
from graphnav.common.run import Array, Odometer

REACH_S = 0.1  # beyond its samples an odometer says nothing
SILENT_S, SILENT = 0.5, 3.0  # s and usual intervals between samples: longer, and it was silent
RATE_S = 0.1  # half the baseline over which the odometer's speed is differenced


def distance_at(odometer: Odometer, time: Array) -> Array:
    """Cumulative distance at times (linear between samples, held outside), m."""
    return np.interp(time, odometer.time, odometer.distance)


def speed_at(odometer: Odometer, time: Array, half: float = RATE_S) -> Array:
    """Odometer speed differenced over `2 half` seconds, less at its ends, m/s; zero outside."""
    first, last = odometer.time[0], odometer.time[-1]
    ahead, behind = np.clip(time + half, first, last), np.clip(time - half, first, last)
    gained = distance_at(odometer, ahead) - distance_at(odometer, behind)
    span = ahead - behind
    return gained / np.where(span > 0, span, np.inf)


def heard(samples: Array, start: Array, end: Array, reach: float = REACH_S) -> NDArray[np.bool_]:
    """Which of the spans `start` to `end` (n,) s a sensor's samples at times (m,) s cover.

    `reach` s to either side of its samples it is still believed.
    """
    gone = np.diff(samples)
    silent = np.flatnonzero(gone > max(SILENT_S, SILENT * float(np.median(gone))))
    inside = (start >= samples[0] - reach) & (end <= samples[-1] + reach)
    for k in silent:
        inside &= (end <= samples[k] + reach) | (start >= samples[k + 1] - reach)
    return np.asarray(inside)


@dataclass(frozen=True)
class OdometerSteps:
    """What the odometer and the gyro say about each increment."""

    distance: Array  # (M,) m
    rate: Array  # (M,) m/s, change of the distance per second of delay
    yaw: Array  # (M,) rad, Earth rate and bias removed
    delay: float  # s, taken off the odometer's stamps


def odometer_steps(
    true: Increments, odometer: Odometer, delay: float, earth_z: Array
) -> OdometerSteps:
    """Distance and yaw steps of increments free of their errors, the odometer's stamps late by
    `delay` s; `earth_z` (M,) rad/s.
    """
    distance = np.diff(distance_at(odometer, true.edge + delay))
    rate = np.diff(speed_at(odometer, true.edge + delay))
    yaw = true.rotation[:, 2] - earth_z * np.diff(true.edge)
    return OdometerSteps(distance, rate, yaw, delay)


def turned_to_middles(inc: Increments, pre: Preintegrated, nodes: Index) -> Array:
    """Gyro-integrated rotation from the node before to the middle of every increment (M, 3, 3)."""
    errors = pre.errors[interval_of_increment(nodes)]
    return np.asarray(pre.C[:-1] @ so3.exp(0.5 * corrected(inc, errors).rotation))


def odometer_sums(
    inc: Increments, pre: Preintegrated, nodes: Index, steps: OdometerSteps, earth_b: Array
) -> OdometerSums:
    """Sum the steps along the gyro-integrated rotation between nodes (B4).

    `earth_b` (n, 3) rad/s, the Earth's rotation in the body at the start of each interval.
    """
    first = nodes[:-1]
    start = inc.edge[first][interval_of_increment(nodes)]
    mid = 0.5 * (inc.edge[1:] + inc.edge[:-1]) - start
    C = turned_to_middles(inc, pre, nodes)
    sensed = np.add.reduceat(inc.rotation, first) / pre.T[:, None]

    def total(weight: Array) -> Array:
        return np.add.reduceat(C * weight[:, None, None], first, axis=0)

    # the axes of the middle of the interval: half the total rotation is close enough
    half = so3.exp(0.5 * so3.log(pre.dR))
    return OdometerSums(
        distance=total(steps.distance),
        distance_rate=total(steps.rate),
        distance_late=total(steps.distance * mid),
        turn=total(steps.yaw),
        turn_abs=total(np.abs(steps.yaw) * np.sign(steps.distance)),
        bend=total(steps.distance * steps.yaw / np.diff(inc.edge)),
        R_mid=half,
        delay=steps.delay,
        # the gyro turns with the Earth, the displacement is told on it: the Earth's rate acts as a
        # bias of the integrated rotation
        rate=sensed,
        drift=pre.errors[:, GYRO] + pre.errors[:, GYRO_SCALE] * sensed - earth_b,
    )
