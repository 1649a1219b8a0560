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

from factors import kinds, so3
from factors.block import (
    NODE_DIM,
    POSITION,
    ROTATION,
    VELOCITY,
    Array,
    Block,
    Scope,
    between,
)
from factors.calibration import Layout
from factors.estimate import Estimate
from factors.preintegration import SCALES, Preintegrated

AXES = ("theta_x", "theta_y", "theta_z", "v_x", "v_y", "v_z", "p_x", "p_y", "p_z")


@dataclass(frozen=True)
class EarthField:
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
    pre: Preintegrated, field: EarthField, layout: Layout, scope: Scope, x: Estimate
) -> Block:
    """All inertial factors of a run, one for every interval.

    Returns a block of 9 rows [theta rad, v m/s, p m] in the body frame of node i, whitened.
    """
    errors = layout.imu_errors_of(x.calibration)[scope.segment]
    m = _motion(pre, field, x, errors - pre.errors)
    n = len(pre.T)
    residual = np.concatenate(
        [
            so3.mv(pre.dR, m.angle),
            m.q_v + so3.cross(m.Omega_b, m.y_v) - m.dv,
            m.q_p + so3.cross(m.Omega_b, m.y_p) - m.dp,
        ],
        axis=1,
    )
    J_i, J_j = np.zeros((n, 9, NODE_DIM)), np.zeros((n, 9, NODE_DIM))
    J_e = np.zeros((n, 9, 12))
    _attitude_rows(pre, m, J_i, J_j, J_e)
    _velocity_rows(pre, m, J_i, J_j, J_e)
    _position_rows(pre, m, J_i, J_j, J_e)
    # told in the sensors' own units: a corrected sample carries its noise less its scale error
    scale = (errors - pre.errors)[:, SCALES]
    white = pre.noise.scaled(scale)
    J_e = white @ J_e
    J_e[:, :, SCALES] += pre.noise.by_scale(so3.mv(pre.noise.whitening, residual))
    J_c = np.zeros((n, 9, layout.dim))
    columns, which = layout.imu_errors
    J_c[:, :, columns] = J_e[:, :, which]
    return Block(
        kind=kinds.INERTIAL,
        axes=AXES,
        time=scope.time,
        residual=so3.mv(white, residual),
        terms=between(scope, white @ J_i, white @ J_j, J_c),
    )


@dataclass(frozen=True)
class _Motion:
    """The intervals' motion, in the body frame of node i: what residual and Jacobians share."""

    T: Array  # (n, 1) s
    R_ni_T: Array  # (n, 3, 3) attitude of node i, transposed
    dR: Array  # (n, 3, 3) sensed rotation with the errors in force
    dv: Array  # (n, 3)
    dp: Array
    error_turn: Array  # (n, 3) rad, by which the change of the gyro's errors turned dR
    E: Array  # (n, 3, 3) predicted to estimated attitude of node j
    angle: Array  # (n, 3) its logarithm
    Omega_b: Array  # (n, 3) Earth rate
    W: Array  # (n, 3, 3) its cross product
    turn: Array  # (n, 3, 3) the Earth rate's cross product with vectors of n, told in the body
    sag: Array  # (n, 3, 3) 1/s^2, change of gravity with the place in n, told in the body
    q_v: Array  # (n, 3) change of velocity the states ask for
    q_p: Array  # (n, 3) change of position they ask for
    y_v: Array  # (n, 3) what the Earth rate acts on in the velocity
    y_p: Array


def _motion(pre: Preintegrated, field: EarthField, x: Estimate, de: Array) -> _Motion:
    """`de` (n, 12): the sensors' errors in force less those of the preintegration."""
    R_i, R_j = x.R_nb[:-1], x.R_nb[1:]
    v_i, v_j, p_i, p_j = x.v_n[:-1], x.v_n[1:], x.p_n[:-1], x.p_n[1:]
    R_ni_T = so3.transpose(R_i)
    T, Omega = pre.T[:, None], field.Omega_n
    error_turn = so3.mv(pre.dR_de, de)
    dR = pre.dR @ so3.exp(error_turn)
    dv = pre.dv + so3.mv(pre.dv_de, de)
    dp = pre.dp + so3.mv(pre.dp_de, de)
    E = so3.transpose(so3.exp(-Omega * T) @ R_i @ dR) @ R_j
    Omega_b = so3.mv(R_ni_T, np.broadcast_to(Omega, (len(T), 3)))
    coriolis_v = 2 * so3.cross(Omega, p_j - p_i)
    coriolis_p = so3.cross(Omega, v_i * T**2 + (v_j - v_i) * T**2 / 3)
    return _Motion(
        T=T,
        R_ni_T=R_ni_T,
        dR=dR,
        dv=dv,
        dp=dp,
        error_turn=error_turn,
        E=E,
        angle=so3.log(E),
        Omega_b=Omega_b,
        W=so3.skew(Omega_b),
        turn=R_ni_T @ so3.skew(Omega),
        sag=R_ni_T @ field.gradient,
        q_v=so3.mv(R_ni_T, v_j - v_i - field.g_n * T + coriolis_v),
        q_p=so3.mv(R_ni_T, p_j - p_i - v_i * T - 0.5 * field.g_n * T**2 + coriolis_p),
        y_v=T * dv - dp,
        y_p=dp * T / 3,
    )


def _attitude_rows(pre: Preintegrated, m: _Motion, J_i: Array, J_j: Array, J_e: Array) -> None:
    out = pre.dR @ so3.right_jacobian_inverse(m.angle)
    back = -out @ so3.transpose(m.E)
    J_i[:, ROTATION, ROTATION] = back @ so3.transpose(m.dR)
    J_j[:, ROTATION, ROTATION] = out
    J_e[:, ROTATION] = back @ so3.right_jacobian(m.error_turn) @ pre.dR_de


def _velocity_rows(pre: Preintegrated, m: _Motion, J_i: Array, J_j: Array, J_e: Array) -> None:
    T, W, turn, sag = m.T[:, :, None], m.W, m.turn, m.sag
    J_i[:, VELOCITY, ROTATION] = so3.skew(m.q_v) - so3.skew(m.y_v) @ W
    J_i[:, VELOCITY, VELOCITY], J_j[:, VELOCITY, VELOCITY] = -m.R_ni_T, m.R_ni_T
    J_i[:, VELOCITY, POSITION] = -2 * turn - sag * T / 2
    J_j[:, VELOCITY, POSITION] = 2 * turn - sag * T / 2
    # the errors also enter the small Earth-rate term, at 1e-4 of their main effect
    J_e[:, VELOCITY] = W @ (T * pre.dv_de - pre.dp_de) - pre.dv_de


def _position_rows(pre: Preintegrated, m: _Motion, J_i: Array, J_j: Array, J_e: Array) -> None:
    T, W, turn, sag = m.T[:, :, None], m.W, m.turn, m.sag
    J_i[:, POSITION, ROTATION] = so3.skew(m.q_p) - so3.skew(m.y_p) @ W
    J_i[:, POSITION, VELOCITY] = -m.R_ni_T * T + turn * (2 / 3 * T**2)
    J_j[:, POSITION, VELOCITY] = turn * (T**2 / 3)
    J_i[:, POSITION, POSITION] = -m.R_ni_T - sag * T**2 / 4
    J_j[:, POSITION, POSITION] = m.R_ni_T - sag * T**2 / 4
    J_e[:, POSITION] = (W * (T / 3) - np.eye(3)) @ pre.dp_de
