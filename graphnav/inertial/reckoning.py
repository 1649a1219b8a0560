"""Dead reckoning: attitude from the gyro, motion from the odometer or, without one, the IMU."""

import numpy as np

from factors import so3
from factors.displacement import OdometerSums
from factors.inertial import predict
from factors.mounting import E_Y
from factors.preintegration import Preintegrated
from graphnav.common.earth import Origin
from graphnav.common.run import Array


def attitudes(pre: Preintegrated, R_0: Array, Omega_n: Array) -> Array:
    """Attitude of every node from the first one and the gyro, Earth rate removed, (N, 3, 3)."""
    R = np.empty((len(pre.T) + 1, 3, 3))
    R[0] = R_0
    turn = so3.exp(-Omega_n * pre.T[:, None])
    for i in range(len(pre.T)):
        R[i + 1] = turn[i] @ R[i] @ pre.dR[i]
    return so3.orthonormalised(R)


def odometer_path(
    R: Array, sums: OdometerSums, R_bm: Array, lever_b: Array, factor: Array
) -> Array:
    """Positions of the IMU at the nodes from odometer displacements, first node at zero, (N, 3).

    `factor` (n,) what the odometer is multiplied with in each interval.
    """
    steps = so3.mv(R[:-1], sums.distance @ (R_bm @ E_Y)) * factor[:, None]
    swing = R @ lever_b  # the odometer point seen from the IMU
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, 0)])
    return np.asarray(path - (swing - swing[0]))


def inertial_path(
    pre: Preintegrated, R_0: Array, v_0: Array, origin: Origin, R_bm: Array, held: bool = True
) -> tuple[Array, Array, Array]:
    """Attitude, velocity, position at the nodes from the IMU alone.

    `held` keeps the velocity along the vehicle's forward axis after every interval (D1): a first
    guess for runs without an odometer; False is pure inertial navigation.
    """
    R, v, p = [R_0], [v_0], [np.zeros(3)]
    for i in range(len(pre.T)):
        g = origin.gravity(p[-1] + 0.5 * pre.T[i] * v[-1])
        R_j, v_j, p_j = predict(pre, i, R[-1], v[-1], p[-1], g, origin.Omega_n)
        if held:
            forward = R_j @ R_bm @ E_Y
            v_j = forward * float(forward @ v_j)
            p_j = p[-1] + 0.5 * pre.T[i] * (v[-1] + v_j)
        R.append(R_j)
        v.append(v_j)
        p.append(p_j)
    return so3.orthonormalised(np.array(R)), np.array(v), np.array(p)
