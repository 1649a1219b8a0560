"""The vehicle frame m in the body b: how the IMU sits in the vehicle."""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.block import Array

E_X, E_Y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])  # of m: right, forward


@dataclass(frozen=True)
class Mounting:
    """The vehicle frame in the body: `R_bm = Exp([pitch, roll, heading])`, roll fixed."""

    R_bm: Array  # (n, 3, 3)
    jacobian: Array  # (n, 3, 2) right perturbation of R_bm per pitch and heading


def mounting(pitch_heading: Array, roll: float) -> Mounting:
    """Mounting rotations of (n, 2) pitch and heading angles [rad] (B2)."""
    vector = np.stack(
        [pitch_heading[:, 0], np.full(len(pitch_heading), roll), pitch_heading[:, 1]], -1
    )
    return Mounting(so3.exp(vector), so3.right_jacobian(vector)[:, :, [0, 2]])
