"""Prior on one node: attitude, velocity and position known with standard deviations.

r = W [Log(R_0^T R), v - v_0, p - p_0]
"""

from dataclasses import dataclass

import numpy as np

from factors import kinds, so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Array, Block, Term
from factors.estimate import Estimate

AXES = ("theta_e", "theta_n", "theta_u", "v_e", "v_n", "v_u", "p_e", "p_n", "p_u")


@dataclass(frozen=True)
class InitialState:
    """A node's state known beforehand; attitude error in n (tilt east, tilt north, heading)."""

    R_nb: Array  # (3, 3)
    v_n: Array  # (3,)
    p_n: Array  # (3,)
    sd: Array  # (9,) rad, m/s, m


def initial_state(known: InitialState, time: float, x: Estimate) -> Block:
    """The prior as a block on node 0, at `time` s."""
    R, v, p = x.R_nb[0], x.v_n[0], x.p_n[0]
    theta_n = so3.log(R @ known.R_nb.T)
    residual = np.concatenate([theta_n, v - known.v_n, p - known.p_n]) / known.sd
    J = np.zeros((1, 9, NODE_DIM))
    # theta_n is a left perturbation: Exp(theta_n) R_0 Exp(d) = Exp(theta_n) Exp(R_0 d) R_0
    J[0, ROTATION, ROTATION] = so3.right_jacobian_inverse(theta_n) @ known.R_nb
    J[0, VELOCITY, VELOCITY] = np.eye(3)
    J[0, POSITION, POSITION] = np.eye(3)
    term = Term("x", np.zeros(1, np.int64), J / known.sd[:, None])
    return Block(kinds.START, AXES, np.array([time]), residual[None], (term,), sigma=known.sd[None])
