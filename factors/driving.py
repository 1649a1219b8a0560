"""How a vehicle gains speed between two nodes, where no accelerometer tells.

With `v_b = R^T v_n` at both nodes, u the change of it that is expected, velocity in the body a
Wiener process about that, and M the mean of the gyro-integrated rotation since node i,

    r_v = (v_bj - v_bi - u) / s_v
    r_p = (R_i^T (p_j - p_i) - T M (v_bi + v_bj) / 2) / s_p.

Given both ends, a Wiener process leads by the mean of its ends, off by `s_v T / sqrt(12)` whatever
they are (the area of a Brownian bridge), so the rows are independent; M makes bends and rocking
exact for a steady speed. Gravity does not enter: in the body no slope is a change of speed.
Source: prior of white noise on acceleration, Barfoot 2017, 3.4, told in the body.
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

AXES = ("v_x", "v_y", "v_z", "p_x", "p_y", "p_z")


@dataclass(frozen=True)
class ExpectedDriving:
    """What is expected over n intervals, in the axes of the body."""

    T: Array  # (n,) s
    change: Array  # (n, 3) m/s, u
    turn: Array  # (n, 3, 3) M
    sigma_v: Array  # (n, 3) m/s; very large leaves a row out
    sigma_p: Array  # (n, 3) m


def driving(expected: ExpectedDriving, scope: Scope, x: Estimate) -> Block:
    """Driving factors over intervals: 6 rows [v, p], whitened."""
    i, n = scope.node, len(scope.node)
    to_i, to_j = so3.transpose(x.R_nb[i]), so3.transpose(x.R_nb[i + 1])
    v_i, v_j = so3.mv(to_i, x.v_n[i]), so3.mv(to_j, x.v_n[i + 1])
    moved, half = so3.mv(to_i, x.p_n[i + 1] - x.p_n[i]), 0.5 * expected.T[:, None, None]
    led = half * expected.turn
    residual = np.concatenate([v_j - v_i - expected.change, moved - so3.mv(led, v_i + v_j)], axis=1)
    J_i, J_j = np.zeros((n, 6, NODE_DIM)), np.zeros((n, 6, NODE_DIM))
    J_i[:, :3, ROTATION], J_j[:, :3, ROTATION] = -so3.skew(v_i), so3.skew(v_j)
    J_i[:, :3, VELOCITY], J_j[:, :3, VELOCITY] = -to_i, to_j
    J_i[:, 3:, ROTATION] = so3.skew(moved) - led @ so3.skew(v_i)
    J_j[:, 3:, ROTATION] = -led @ so3.skew(v_j)
    J_i[:, 3:, VELOCITY], J_j[:, 3:, VELOCITY] = -led @ to_i, -led @ to_j
    J_i[:, 3:, POSITION], J_j[:, 3:, POSITION] = -to_i, to_i
    sigma = np.concatenate([expected.sigma_v, expected.sigma_p], axis=1)
    terms = (Term("x", i, J_i), Term("x", i + 1, J_j))
    return whitened(kinds.DRIVING, AXES, scope.time, residual, sigma, terms)
