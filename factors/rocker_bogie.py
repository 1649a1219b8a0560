"""Rocker-bogie running gear: linkage geometry, rolling directions, body motion from six wheels.

Wheels are ordered 1..6: 1, 2 front, 3, 4 middle, 5, 6 rear; odd left, even right. Angles: steering
right positive; a link's pitch is positive when its front end rises; `rocker` is the left rocker's
angle beta_1 against the differential, the right rocker stands at beta_2 = -beta_1; `bogie` (left,
right) is rho against its rocker. The source writes forward-right-down; everything here is already
in b, right-forward-up. Source: C1-C4 (Teng et al. 2021).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.weights import Robust

Array = NDArray[np.float64]

SIDE = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])  # -1 left, +1 right
BETA_SIGN = -SIDE  # beta_1 = rocker on the left, beta_2 = -rocker on the right
MIN_WHEELS = 3  # fewer cannot outvote one that is wrong
ON_BOGIE = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Linkage:
    """Geometry of the running gear, metres, named as in the source (C3).

    Lengths are positive horizontal distances in the linkage's zero position, `d_*` positive
    distances downwards; `l_x` forward and `l_z` downward place the differential's centre relative
    to the body origin, `l_d` is the distance from there to either wheel plane.
    """

    l_m1: float  # rocker pivot back to the bogie pivot
    l_m2: float  # rocker pivot forward to the front axle
    l_r1: float  # bogie pivot back to the rear axle
    l_r2: float  # bogie pivot forward to the middle axle
    d_a1: float  # rocker pivot down to the front axle
    d_a2: float  # bogie pivot down to the middle axle
    d_a3: float  # bogie pivot down to the rear axle
    d_r: float  # rocker pivot down to the bogie pivot
    l_x: float
    l_z: float
    l_d: float
    wheel_radius: float


@dataclass(frozen=True)
class Joints:
    """Steering and linkage angles over a run."""

    steer: Array  # (N, 6) rad, right positive
    rocker: Array  # (N,) rad, beta_1
    bogie: Array  # (N, 2) rad, rho_1 (left), rho_2 (right)


@dataclass(frozen=True)
class BodyMotion:
    """What the wheels say about the body, before any slip coefficient (k_s = 1)."""

    v_b: Array  # (N, 3) m/s, velocity of the wheel centroid over ground, b axes
    w_z: Array  # (N,) rad/s, yaw rate about the body's up axis, left positive
    centroid_b: Array  # (N, 3) m, mean of the six wheel centres seen from the body origin
    weight_roll: Array  # (N, 6) 0..1, trust in each wheel's rate
    weight_side: Array  # (N, 6) 0..1, trust in each wheel not sliding sideways
    w_z_sd: Array  # (N,) rad/s
    residual: Array  # (N, 6, 2) m/s, along and across each wheel
    speed: Array  # (N,) m/s, median of the wheels


@dataclass(frozen=True)
class WheelSpread:
    """How far one honest wheel may differ from the rigid body's motion, 1 sigma."""

    roll: float = 0.05  # of the speed, along the wheel: slip differs from wheel to wheel
    side: float = 0.03  # of the speed, across the wheel: side slip, steering error
    floor: float = 0.0003  # m/s


def beta(joints: Joints) -> Array:
    """Rocker angle of each wheel's side (N, 6), rad: beta_1 left, beta_2 = -beta_1 right."""
    return np.asarray(joints.rocker[:, None] * BETA_SIGN)


def link_pitch(joints: Joints) -> Array:
    """Pitch (N, 6), rad, of the link that carries each wheel.  Source: C1."""
    return np.asarray(beta(joints) + np.tile(joints.bogie, 3) * ON_BOGIE)


def rolling_direction(joints: Joints) -> Array:
    """Unit vectors u_i (N, 6, 3) in b along which the wheels roll forward.  Source: C1."""
    pitch = link_pitch(joints)
    ahead = np.cos(joints.steer)
    return np.stack([np.sin(joints.steer), ahead * np.cos(pitch), ahead * np.sin(pitch)], axis=-1)


def wheel_jacobians(linkage: Linkage, joints: Joints) -> Array:
    """J_i = R_w u_i (N, 6, 3), m: body velocity per wheel rate.  Source: C1."""
    return linkage.wheel_radius * rolling_direction(joints)


def _pitched(pitch: Array, forward: Array | float, down: Array | float) -> Array:
    """(..., 3): a vector `forward` ahead and `down` below, carried by a link at `pitch`."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.stack([np.zeros_like(c), forward * c + down * s, forward * s - down * c], axis=-1)


def _link_vectors(linkage: Linkage, joints: Joints) -> tuple[Array, Array]:
    """Rocker part and bogie part (N, 6, 3) of the way from the differential to each wheel."""
    g = linkage
    front = 1.0 - ON_BOGIE
    on_rocker = _pitched(
        beta(joints), front * g.l_m2 - ON_BOGIE * g.l_m1, front * g.d_a1 + ON_BOGIE * g.d_r
    )
    on_bogie = _pitched(
        link_pitch(joints),
        np.array([0.0, 0.0, g.l_r2, g.l_r2, -g.l_r1, -g.l_r1]),
        np.array([0.0, 0.0, g.d_a2, g.d_a2, g.d_a3, g.d_a3]),
    )
    return on_rocker, on_bogie


def wheel_positions(linkage: Linkage, joints: Joints) -> Array:
    """Wheel centres (N, 6, 3), m, from the body origin, b axes.  Source: C3."""
    on_rocker, on_bogie = _link_vectors(linkage, joints)
    pivot = np.stack(
        [SIDE * linkage.l_d, np.full(6, linkage.l_x), np.full(6, -linkage.l_z)], axis=-1
    )
    return np.asarray(pivot + on_rocker + on_bogie)


def wheel_position_rates(linkage: Linkage, joints: Joints, rates: Joints) -> Array:
    """Velocities (N, 6, 3), m/s, of the wheel centres in b when the linkage flexes at `rates`."""
    on_rocker, on_bogie = _link_vectors(linkage, joints)
    return _swing(on_rocker, beta(rates)) + _swing(on_bogie, link_pitch(rates))


def _swing(arm: Array, rate: Array) -> Array:
    """rate x arm for a rotation about the right axis (front end up positive)."""
    return np.stack([np.zeros_like(rate), -rate * arm[..., 2], rate * arm[..., 1]], axis=-1)


def wheel_velocities(
    linkage: Linkage, wheel: Array, joints: Joints, rates: Joints | None = None
) -> Array:
    """Velocity over ground (N, 6, 3), m/s, of each wheel centre if nothing slips, b axes.

    `wheel` (N, 6), rad/s, is counted against the link; where the link itself pitches (`rates`),
    the wheel rolls that much less.  Source: C1.
    """
    rolling = wheel if rates is None else wheel - link_pitch(rates)
    return wheel_jacobians(linkage, joints) * rolling[..., None]


def mean_motion(linkage: Linkage, wheel: Array, joints: Joints) -> tuple[Array, Array]:
    """The source's own v_b (N, 3), m/s, and w_z (N,), rad/s: all wheels alike, k_s = 1.

    Source: C2, C4.
    """
    v_i = wheel_velocities(linkage, wheel, joints)
    v_b = v_i.mean(axis=1)
    p_i = wheel_positions(linkage, joints)
    arm = p_i - p_i.mean(axis=1, keepdims=True)
    dv = v_i - v_b[:, None]
    cross = arm[..., 0] * dv[..., 1] - arm[..., 1] * dv[..., 0]
    return v_b, cross.sum(axis=1) / np.sum(arm[..., :2] ** 2, axis=(1, 2))


def body_motion(
    linkage: Linkage,
    wheel: Array,
    joints: Joints,
    rates: Joints | None = None,
    spread: WheelSpread | None = None,
) -> BodyMotion:
    """C2 and C4 in one robust adjustment per sample: a wheel that disagrees loses its say.

    Each wheel gives two statements about (v_x, v_y, w_z) of the centroid: its speed along the
    rolling direction, and that it does not move across it. They have their own spreads and IGG
    weights (D3): a spinning wheel still does not slide sideways. A wheel whose rate is NaN is
    left out; samples without at least three sound wheels come out NaN.

    With joint `rates` the flexing of the linkage is taken off, so that a rocker swinging under a
    straight-driving body is no yaw rate.
    """
    spread = spread or WheelSpread()
    missing = ~np.isfinite(wheel)
    v_i = wheel_velocities(linkage, np.where(missing, 0.0, wheel), joints, rates)
    p_i = wheel_positions(linkage, joints)
    centroid = p_i.mean(axis=1)
    flex = np.zeros_like(p_i) if rates is None else wheel_position_rates(linkage, joints, rates)
    flex = flex - flex.mean(axis=1, keepdims=True)  # the centroid keeps its own flexing
    rows, seen = _statements(p_i - centroid[:, None], joints, v_i - flex)
    speed = _median_speed(v_i, missing)
    sd = np.stack([spread.roll * speed, spread.side * speed], axis=-1)[:, None] + spread.floor
    usable = np.repeat(~missing[..., None], 2, axis=-1)
    solution, weight, variance = _adjust(rows, seen, np.broadcast_to(sd, seen.shape), usable)
    w_roll = weight[..., 0]
    v_z = np.sum(w_roll * v_i[..., 2], axis=1) / np.maximum(np.sum(w_roll, axis=1), 1e-12)
    v_z[np.isnan(solution[:, 0])] = np.nan
    return BodyMotion(
        v_b=np.stack([solution[:, 0], solution[:, 1], v_z], axis=-1),
        w_z=solution[:, 2],
        centroid_b=centroid,
        weight_roll=w_roll,
        weight_side=weight[..., 1],
        w_z_sd=np.sqrt(variance[:, 2]),
        residual=seen - np.einsum("nwai,ni->nwa", rows, solution),
        speed=speed,
    )


def fitted_spread(motion: BodyMotion) -> WheelSpread:
    """The spread the wheels of this run show among themselves (MAD of the residuals).

    The adjustment takes v_y out of six residuals along, v_x and w_z out of six across.
    """
    moving = motion.speed > 0.01
    if np.count_nonzero(moving) < 100:
        return WheelSpread()
    share = np.abs(motion.residual[moving]) / motion.speed[moving, None, None]
    along, across = 1.4826 * np.nanmedian(share, axis=(0, 1)) * np.sqrt([6 / 5, 6 / 4])
    return WheelSpread(
        roll=float(np.clip(along, 0.005, 0.2)), side=float(np.clip(across, 0.003, 0.2))
    )


def _median_speed(v_i: Array, missing: NDArray[np.bool_]) -> Array:
    """Median (N,) of the wheels' speeds, 0 where no wheel is heard."""
    speed = np.ma.masked_array(np.linalg.norm(v_i, axis=-1), missing)
    return np.ma.median(speed, axis=1).filled(0.0)  # type: ignore[no-untyped-call, no-any-return]


def _statements(arm: Array, joints: Joints, v_i: Array) -> tuple[Array, Array]:
    """Rows (N, 6, 2, 3) of (v_x, v_y, w_z) and what is seen (N, 6, 2): along and across."""
    u = rolling_direction(joints)[..., :2]
    along = u / np.linalg.norm(u, axis=-1, keepdims=True)
    across = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    axes = np.stack([along, across], axis=-2)
    turning = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)  # z x arm
    rows = np.concatenate([axes, axes @ turning[..., None]], axis=-1)
    return rows, np.einsum("nwak,nwk->nwa", axes, v_i[..., :2])


def _adjust(
    rows: Array, seen: Array, sd: Array, usable: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Iteratively reweighted least squares: solution (N, 3), weights (N, 6, 2), variance (N, 3).

    Rounds of (convex) Huber weights find the majority, then IGG-III rejects the rest; where no
    majority stands out, the Huber weights stay.
    """
    weight = usable.astype(float)
    igg3 = Robust("igg3", 2.5, 6.0)
    for round_ in range(12):
        scaled = weight / sd**2
        normal = np.einsum("nwai,nwa,nwaj->nij", rows, scaled, rows)
        right = np.einsum("nwai,nwa,nwa->ni", rows, scaled, seen)
        trace = np.einsum("nii->n", normal)
        normal += (1e-13 * trace + (trace == 0))[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(normal)
        solution = np.einsum("nij,nj->ni", inverse, right)
        u = np.abs((seen - np.einsum("nwai,ni->nwa", rows, solution)) / sd)
        huber, igg = usable / np.maximum(u, 1.0), usable * igg3.weight(u)
        settled = np.count_nonzero(igg[..., 0], axis=1) >= MIN_WHEELS
        weight = np.where(settled[:, None, None] & (round_ >= 6), igg, huber)
    solution[np.count_nonzero(usable[..., 0], axis=1) < MIN_WHEELS] = np.nan
    return solution, weight, np.einsum("nii->ni", inverse)
