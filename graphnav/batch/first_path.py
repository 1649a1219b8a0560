"""Where the iteration begins: dead reckoning with the calibrations of the vehicle file, drawn by
the fixes where there are any.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from factors import so3
from factors.calibration import GYRO_BIAS
from factors.estimate import Estimate
from factors.mounting import E_Y
from factors.preintegration import Preintegrated, preintegrate
from graphnav.common.run import Array
from graphnav.graph.densify import Path, densify
from graphnav.graph.motion import sums_of
from graphnav.graph.nodes import Nodes
from graphnav.graph.preparation import Prepared
from graphnav.inertial import reckoning
from graphnav.inertial.odometer_steps import speed_at
from graphnav.inertial.pace import pace

BESIDE = 5  # fixes of which the median draws: two wild ones in a row do not
# s that the median takes where the odometer alone leads from fix to fix: twice what bursts last, as
# an iteration that begins inside one has nothing that draws it out
BURST_S = 60.0


@dataclass(frozen=True)
class FirstPath:
    """States at the nodes, the dense path through them and plain dead reckoning beside it."""

    estimate: Estimate
    path: Path
    reckoned: Path


def first_path(prep: Prepared, nodes: Nodes) -> FirstPath:
    """Attitude from the gyro; motion from the odometer, without one at the fixes' pace or, without
    either, from the accelerometer held along the vehicle's forward axis.

    With fixes the heading follows what the reckoned path wants against them, and what is then left
    between path and fixes is taken off it, straight across gaps.
    """
    origin = prep.setup.alignment.origin
    calibration = np.tile(prep.setup.layout.prior, (len(nodes.segment_time), 1))
    calibration[:, prep.setup.layout.slices[GYRO_BIAS]] = prep.setup.alignment.gyro_bias
    errors = prep.setup.layout.imu_errors_of(calibration)[nodes.segment]
    pre = preintegrate(prep.sensed.inc, nodes.edge, errors, prep.setup.noise)

    def dense(estimate: Estimate) -> Path:
        return densify(prep.sensed.inc, pre, nodes, estimate, origin)

    wander = prep.setup.alignment.path
    plain = _reckoned(prep, nodes, pre, calibration, np.zeros(len(nodes.time)))
    if prep.sensed.gnss is None:
        path = dense(plain)
        return FirstPath(plain, path, path)
    if wander is not None:
        turn = np.interp(nodes.time, wander.time, wander.turn)
        drawn = _drawn(prep, nodes, _reckoned(prep, nodes, pre, calibration, turn))
    else:
        drawn = _drawn(prep, nodes, plain)
    return FirstPath(drawn, dense(drawn), dense(plain))


def _reckoned(
    prep: Prepared, nodes: Nodes, pre: Preintegrated, calibration: Array, turn: Array
) -> Estimate:
    """Dead reckoning, its heading turned to the left by `turn` (N,) rad."""
    start, vehicle = prep.setup.alignment.start, prep.setup.vehicle
    origin, odometer = prep.setup.alignment.origin, prep.sensed.run.odometer
    R_bm = so3.exp(vehicle.odometer.mount_b)
    speed = pace(prep.sensed.run, nodes.time)
    if speed is None:
        R, v, p = reckoning.inertial_path(pre, start.R_nb, start.v_n, origin, R_bm)
        return Estimate(R, v, p + start.p_n, np.zeros(len(R)), calibration)
    about_up = np.stack([np.zeros_like(turn), np.zeros_like(turn), turn], -1)
    R = so3.exp(about_up) @ reckoning.attitudes(pre, start.R_nb, origin.Omega_n)
    if odometer is None:
        v = (R @ R_bm @ E_Y) * speed[:, None]
        steps = 0.5 * (v[1:] + v[:-1]) * np.diff(nodes.time)[:, None]
        p = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, 0)])
    else:
        v = (R @ R_bm @ E_Y) * speed_at(odometer, nodes.time)[:, None]
        blank = Estimate(R, v, v, np.zeros(len(R)), calibration)
        sums = sums_of(prep, nodes, pre, blank)
        lever, ones = vehicle.odometer.lever_b, np.ones(len(pre.T))
        p = reckoning.odometer_path(R, sums, R_bm, lever, ones)
    return Estimate(R, v, p + start.p_n, np.zeros(len(R)), calibration)


def _drawn(prep: Prepared, nodes: Nodes, at: Estimate) -> Estimate:
    """A path moved on to the fixes by the running median of what lies between."""
    gnss = prep.sensed.gnss
    assert gnss is not None
    inside = (gnss.time >= nodes.time[0]) & (gnss.time <= nodes.time[-1])
    time, fixes_n = gnss.time[inside], prep.sensed.fixes_n[inside]
    if not len(time):
        return at
    there = np.stack([np.interp(time, nodes.time, x) for x in at.p_n.T], -1)
    between = median_filter(fixes_n - there, (min(_beside(prep), len(time)), 1), mode="nearest")
    moved = np.stack([np.interp(nodes.time, time, x) for x in between.T], -1)
    return Estimate(at.R_nb, at.v_n, at.p_n + moved, at.phase, at.calibration)


def _beside(prep: Prepared) -> int:
    """How many fixes draw a path together."""
    run, gnss = prep.sensed.run, prep.sensed.gnss
    if run.felt or run.odometer is None or gnss is None or len(gnss.time) < 2:
        return BESIDE
    return max(BESIDE, round(BURST_S / float(np.median(np.diff(gnss.time)))))
