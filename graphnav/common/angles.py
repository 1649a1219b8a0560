"""Attitude as engineers say it: roll, pitch, heading of the right-forward-up body."""

import numpy as np

from graphnav.common.earth import Scalars
from graphnav.common.run import Array

FULL_TURN = 2 * np.pi


def wrapped(angle: Scalars, turn: float = FULL_TURN) -> Array:
    """Principal values of angles, at most half a `turn` (rad, or 360 for degrees) from zero."""
    return np.asarray((angle + turn / 2) % turn - turn / 2)


def rotation_of_angles(roll: Scalars, pitch: Scalars, heading: Scalars) -> Array:
    """`R = Rz(-heading) Rx(pitch) Ry(roll)`, (...,) rad -> (..., 3, 3), body to east-north-up."""
    sr, cr = np.sin(roll), np.cos(roll)
    sp, cp = np.sin(pitch), np.cos(pitch)
    sh, ch = np.sin(heading), np.cos(heading)
    right = np.stack([ch * cr + sh * sp * sr, -sh * cr + ch * sp * sr, -cp * sr], -1)
    forward = np.stack([sh * cp, ch * cp, sp], -1)
    up = np.stack([ch * sr - sh * sp * cr, -sh * sr - ch * sp * cr, cp * cr], -1)
    return np.stack([right, forward, up], -1)


def angles_of_rotation(R: Array) -> tuple[Array, Array, Array]:
    """Roll (right side down positive), pitch (nose up), heading (clockwise from north), rad."""
    pitch = np.arcsin(np.clip(R[..., 2, 1], -1, 1))
    roll = np.arctan2(-R[..., 2, 0], R[..., 2, 2])
    heading = np.arctan2(R[..., 0, 1], R[..., 1, 1]) % FULL_TURN
    return roll, pitch, heading
