"""Inertial factor between consecutive nodes on the rotating Earth.

In n, fixed to the Earth and turning with `Omega` (3), gravity `g` at the middle of the interval:

    R_j = Exp(-Omega T) R_i dR
    v_j = v_i + R_i dv - Omega x R_i (T dv - dp) + g T - 2 Omega x (p_j - p_i)
    p_j = p_i + v_i T + R_i dp - Omega x R_i dp T/3 + g T^2/2
          - Omega x (v_i T^2 + (v_j - v_i) T^2/3)

The Coriolis integral of the velocity is the displacement itself, so the velocity equation is exact
in it; what is left out is of second order in `Omega T` (3 ng at 1 s). Source: strapdown
mechanisation in an Earth-fixed frame; the residual's form after Forster et al. 2017.
"""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.block import NODE_DIM, POSITION, ROTATION, VELOCITY, Array, Block, Index, Term
from factors.preintegration import Preintegrated

AXES = ("theta_x", "theta_y", "theta_z", "v_x", "v_y", "v_z", "p_x", "p_y", "p_z")


@dataclass(frozen=True)
class Field:
    """Earth rotation and gravity over the run."""

    Omega_n: Array  # (3,) rad/s
    g_n: Array  # (n, 3) m/s^2, at the middle of each interval
    gradient: Array  # (3, 3) 1/s^2, d g_n / d p_n


def predict(
    pre: Preintegrated, i: int, R: Array, v: Array, p: Array, g: Array, Omega: Array
) -> tuple[Array, Array, Array]:
    """Carry one node's attitude, velocity and position over interval i (strapdown, no aiding)."""
    T, dv, dp = float(pre.T[i]), pre.dv[i], pre.dp[i]
    a = R @ dv - so3.cross(Omega, R @ (T * dv - dp)) + g * T
    guess = v * T + 0.5 * a * T * T
    v_j = v + a - 2 * so3.cross(Omega, guess)
    p_j = p + v * T + R @ dp - so3.cross(Omega, R @ dp) * (T / 3) + 0.5 * g * T * T
    p_j = p_j - so3.cross(Omega, v * T * T + (v_j - v) * (T * T / 3))
    v_j = v + a - 2 * so3.cross(Omega, p_j - p)
    return so3.exp(-Omega * T) @ R @ pre.dR[i], v_j, p_j


def inertial(
    pre: Preintegrated,
    R: Array,
    v: Array,
    p: Array,
    bias: Array,
    field: Field,
    time: Array,
    segment: Index,
    n_calibration: int,
) -> Block:
    """All inertial factors of a run.

    Args: `R` (N, 3, 3), `v`, `p` (N, 3) the nodes; `bias` (n, 6) in force in each interval, at
    columns 0:6 of calibration segment `segment` (n,); `time` (N,) s.
    Returns a block of 9 rows [theta rad, v m/s, p m] in the body frame of node i, whitened.
    """
    n = len(pre.T)
    Ri, Rj = R[:-1], R[1:]
    vi, vj, pi, pj = v[:-1], v[1:], p[:-1], p[1:]
    Rit = so3.transpose(Ri)
    T = pre.T[:, None]
    Omega = field.Omega_n
    db = bias - pre.bias
    turned = so3.mv(pre.dR_dbg, db[:, :3])
    dR = pre.dR @ so3.exp(turned)
    dv = pre.dv + so3.mv(pre.dv_dbg, db[:, :3]) + so3.mv(pre.dv_dba, db[:, 3:])
    dp = pre.dp + so3.mv(pre.dp_dbg, db[:, :3]) + so3.mv(pre.dp_dba, db[:, 3:])
    w = so3.mv(Rit, np.broadcast_to(Omega, (n, 3)))

    E = so3.transpose(so3.exp(-Omega * T) @ Ri @ dR) @ Rj
    angle = so3.log(E)
    q_v = so3.mv(Rit, vj - vi - field.g_n * T + 2 * so3.cross(Omega, pj - pi))
    q_p = so3.mv(
        Rit,
        pj
        - pi
        - vi * T
        - 0.5 * field.g_n * T**2
        + so3.cross(Omega, vi * T**2 + (vj - vi) * T**2 / 3),
    )
    y_v, y_p = T * dv - dp, dp * T / 3
    residual = np.concatenate(
        [so3.mv(pre.dR, angle), q_v + so3.cross(w, y_v) - dv, q_p + so3.cross(w, y_p) - dp], axis=1
    )

    Ji, Jj = np.zeros((n, 9, NODE_DIM)), np.zeros((n, 9, NODE_DIM))
    Jb = np.zeros((n, 9, 6))
    out = pre.dR @ so3.right_jacobian_inverse(angle)
    th, ve, po = slice(0, 3), slice(3, 6), slice(6, 9)
    Ji[:, th, ROTATION] = -out @ so3.transpose(E) @ so3.transpose(dR)
    Jj[:, th, ROTATION] = out
    Jb[:, th, 0:3] = -out @ so3.transpose(E) @ so3.right_jacobian(turned) @ pre.dR_dbg
    W = so3.skew(w)
    Ji[:, ve, ROTATION] = so3.skew(q_v) - so3.skew(y_v) @ W
    Ji[:, po, ROTATION] = so3.skew(q_p) - so3.skew(y_p) @ W
    T3 = T[:, :, None]
    turn = Rit @ so3.skew(Omega)
    sag = Rit @ field.gradient
    Ji[:, ve, VELOCITY], Jj[:, ve, VELOCITY] = -Rit, Rit
    Ji[:, ve, POSITION] = -2 * turn - sag * T3 / 2
    Jj[:, ve, POSITION] = 2 * turn - sag * T3 / 2
    Ji[:, po, VELOCITY] = -Rit * T3 + turn * (2 / 3 * T3**2)
    Jj[:, po, VELOCITY] = turn * (T3**2 / 3)
    Ji[:, po, POSITION] = -Rit - sag * T3**2 / 4
    Jj[:, po, POSITION] = Rit - sag * T3**2 / 4
    # the bias also enters the small Earth-rate terms, at 1e-4 of its main effect
    Jb[:, ve, 0:3] = W @ (T3 * pre.dv_dbg - pre.dp_dbg) - pre.dv_dbg
    Jb[:, ve, 3:6] = W @ (T3 * pre.dv_dba - pre.dp_dba) - pre.dv_dba
    Jb[:, po, 0:3] = (W * (T3 / 3) - np.eye(3)) @ pre.dp_dbg
    Jb[:, po, 3:6] = (W * (T3 / 3) - np.eye(3)) @ pre.dp_dba

    white = pre.whitening
    Jc = np.zeros((n, 9, n_calibration))
    Jc[:, :, :6] = white @ Jb
    index = np.arange(n)
    return Block(
        kind="inertial",
        axes=AXES,
        time=time[1:],
        residual=so3.mv(white, residual),
        terms=(
            Term("x", index, white @ Ji),
            Term("x", index + 1, white @ Jj),
            Term("c", segment, Jc),
        ),
    )
