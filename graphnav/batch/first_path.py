"""Where the iteration begins: dead reckoning with the calibrations of the vehicle file."""

import numpy as np

from factors import so3
from factors.calibration import GYRO_BIAS
from factors.displacement import E_Y
from factors.estimate import Estimate
from factors.preintegration import preintegrate
from graphnav.graph.densify import Path, densify
from graphnav.graph.motion import sums_of
from graphnav.graph.nodes import Nodes
from graphnav.graph.preparation import Prepared
from graphnav.inertial import reckoning
from graphnav.inertial.odometry import speed_at


def first_path(prep: Prepared, nodes: Nodes) -> tuple[Estimate, Path]:
    """Dead-reckoned states at the nodes and the dense path through them.

    Attitude from the gyro; motion from the odometer, without one from the accelerometer held along
    the vehicle's forward axis.
    """
    origin, start = prep.setup.alignment.origin, prep.setup.alignment.start
    calibration = np.tile(prep.setup.layout.prior, (len(nodes.segment_time), 1))
    calibration[:, prep.setup.layout.slices[GYRO_BIAS]] = prep.setup.alignment.gyro_bias
    bias = calibration[nodes.segment, prep.setup.layout.bias]
    pre = preintegrate(prep.sensed.inc, nodes.edge, bias, prep.setup.noise)
    R_bm = so3.exp(prep.setup.vehicle.odometer.mount_b)
    odometer = prep.sensed.run.odometer
    if odometer is None:
        R, v, p = reckoning.inertial_path(pre, start.R_nb, start.v_n, origin, R_bm)
    else:
        R = reckoning.attitudes(pre, start.R_nb, origin.Omega_n)
        v = (R @ R_bm @ E_Y) * speed_at(odometer, nodes.time)[:, None]
        blank = Estimate(R, v, v, np.zeros(len(R)), calibration)
        sums = sums_of(prep, nodes, pre, blank)
        ones = np.ones(len(pre.T))
        p = reckoning.odometer_path(R, sums, R_bm, prep.setup.vehicle.odometer.lever_b, ones)
    estimate = Estimate(R, v, p + start.p_n, np.zeros(len(R)), calibration)
    return estimate, densify(prep.sensed.inc, pre, nodes, estimate, origin)
