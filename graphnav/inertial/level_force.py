"""What accelerometers would feel on a level vehicle: for those that were not recorded."""

from dataclasses import replace

import numpy as np

from factors import so3
from graphnav.common.earth import G_STANDARD
from graphnav.common.run import Array, Run
from graphnav.inertial.pace import pace


def felt_when_level(run: Run, mount_b: Array) -> Run:
    """The run with gravity and the force of its own driving, by its pace and its gyro, in the place
    of accelerometers that were not recorded: `f_m = [-v w_z, dv/dt, g]`.

    `mount_b` (3,) rad, the rotation vector b <- m. What roads slope is not in it, nor what odometer
    or fixes do not tell.
    """
    imu, unfelt = run.imu, ~np.array(run.sensed[3:])
    if imu is None or not unfelt.any():
        return run
    force_m = np.tile([0.0, 0.0, G_STANDARD], (len(imu.time), 1))
    R_bm = so3.exp(mount_b)
    heard = run.odometer or run.gnss
    if heard is not None:
        speed = pace(run, np.clip(imu.time, heard.time[0], heard.time[-1]))
        if speed is not None:
            force_m[:, 0] = -speed * (imu.gyro @ R_bm[:, 2])
            force_m[:, 1] = np.gradient(speed, imu.time)
    accel = imu.accel.copy()
    accel[:, unfelt] = (force_m @ R_bm.T)[:, unfelt]
    return replace(run, imu=replace(imu, accel=accel))
