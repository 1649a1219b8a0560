"""What standing still says: no velocity, no displacement and no rotation between two nodes.

    r = [Log(R_i^T R_j) / s_R,  v_j / s_v,  (p_j - p_i) / s_p]

Together with the inertial factor this levels, finds the gyro bias and, for gyros good enough, the
heading from the Earth's rotation. Rows may be doubted one by one: a turntable takes the rotation
about the vertical and leaves the rest, a lift takes the vertical.
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import (
    NODE_DIM,
    POSITION,
    ROTATION,
    VELOCITY,
    Array,
    Block,
    Scope,
    Term,
    whitened,
)
from factors.estimate import Estimate

AXES = ("theta_x", "theta_y", "theta_z", "v_e", "v_n", "v_u", "p_e", "p_n", "p_u")


@dataclass(frozen=True)
class StandstillNoise:
    """How still a standing vehicle is, one sigma over an interval."""

    rotation: Array  # (3,) rad, body axes
    velocity: Array  # (3,) or (n, 3) m/s, axes of n
    position: Array  # (3,) or (n, 3) m, axes of n


def standstill(noise: StandstillNoise, scope: Scope, x: Estimate) -> Block:
    """Standstill factors over intervals: 9 rows, whitened."""
    node, n = scope.node, len(scope.node)
    E = so3.transpose(x.R_nb[node]) @ x.R_nb[node + 1]
    angle = so3.log(E)
    moved = x.p_n[node + 1] - x.p_n[node]
    residual = np.concatenate([angle, x.v_n[node + 1], moved], axis=1)
    J_i, J_j = np.zeros((n, 9, NODE_DIM)), np.zeros((n, 9, NODE_DIM))
    Jr = so3.right_jacobian_inverse(angle)
    J_i[:, ROTATION, ROTATION], J_j[:, ROTATION, ROTATION] = -Jr @ so3.transpose(E), Jr
    J_j[:, VELOCITY, VELOCITY] = np.eye(3)
    J_i[:, POSITION, POSITION], J_j[:, POSITION, POSITION] = -np.eye(3), np.eye(3)
    parts = (noise.rotation, noise.velocity, noise.position)
    sigma = np.concatenate([np.broadcast_to(s, (n, 3)) for s in parts], axis=1)
    terms = Term("x", node, J_i), Term("x", node + 1, J_j)
    return whitened(kinds.STANDSTILL, AXES, scope.time, residual, sigma, terms)
