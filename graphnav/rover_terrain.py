"""The ground's profile under each side's wheels, as the linkage and the attitude feel it."""

from dataclasses import dataclass, replace

import numpy as np

from factors import so3
from factors.block import Block, Index
from factors.calibration import Layout
from factors.terrain_slip import Profile, arc_share, mismatch, terrain_slip
from graphnav.densify import Path
from graphnav.nodes import Nodes
from graphnav.rover import Wheels
from graphnav.run import Array

STEP = 0.05  # m, grid of the profiles
EVERY = 2  # of the grid, ways at which the mismatch is looked at
SIDES = ("left", "right")
NEAR, FAR = (0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15), (0.7, 1.4)  # of the slip coefficient
COHERENT = 0.5  # mismatch near over far; above it the wheels do not share a profile
CROSS_SLOPE = 5.0  # 1/m, how fast the mismatch grows beside the rut, of the far mismatch
LEAST_ROWS = 50
LIKE_NOISE = 3.0  # neighbouring mismatches share their noise: their sigma is raised by this
LEAST = 2e-4  # m


@dataclass(frozen=True)
class Track:
    """One side's profile and where along it the mismatch counts."""

    side: str
    profile: Profile
    at: Array  # (n,) m, ways at k = 1
    time: Array  # (n,) s
    segment: Index  # (n,)
    arc: Array  # (n,) shortening of the axles' distances in curves
    offset: Array  # (n,) m, how far the middle wheel runs beside the others' rut (turns)
    sigma: Array  # (n,) m


def tracks(wheels: Wheels, nodes: Nodes, path: Path, k: Array) -> list[Track]:
    """Both sides' profiles with the attitude of `path`; sides that are not coherent
    at the slip coefficients `k` (segments,) are left out."""
    R_nb = path.at(wheels.time)[0]
    p_n = so3.mv(R_nb[:, None], wheels.wheels_b)
    found = (_track(wheels, nodes, p_n[..., 2], side, k) for side in (0, 1))
    return [t for t in found if t is not None]


def _track(wheels: Wheels, nodes: Nodes, up: Array, side: int, k: Array) -> Track | None:
    """Side 0 left, 1 right; `up` (N, 6) m heights of the wheels over the body origin."""
    time, motion = wheels.time, wheels.motion
    p = wheels.wheels_b[:, side::2].mean(axis=0)
    speed = np.nan_to_num(motion.v_b[:, 1] + motion.w_z * p[:, 0].mean())
    dt = np.diff(time, prepend=time[0])
    way, back = np.cumsum(np.maximum(speed, 0) * dt), np.cumsum(np.maximum(-speed, 0) * dt)
    if way[-1] < 10.0:
        return None
    grid = np.arange(0.0, way[-1], STEP)
    increasing = way + 1e-9 * np.arange(len(way))
    front, middle, rear = (_gridded(grid, increasing, up[:, side + 2 * i]) for i in range(3))
    L_1, L_2 = float(p[0, 1] - p[1, 1]), float(p[1, 1] - p[2, 1])
    profile = Profile(STEP, front - middle, middle - rear, L_1, L_2)
    margin = profile.reach / k.min() + STEP
    at = grid[(grid > margin) & (grid < grid[-1] - margin)][::EVERY]

    def over_window(value: Array) -> Array:
        ahead, behind = (np.interp(at + m, increasing, value) for m in (margin, -margin))
        return np.asarray(ahead - behind)

    at_time = np.interp(at, increasing, time)
    forward = np.abs(over_window(back)) < 0.02
    curvature = np.abs(over_window(wheels.yaw)) / (2 * margin)
    keep = forward & (curvature < 1.0)
    at, at_time, curvature = at[keep], at_time[keep], curvature[keep]
    arc, offset = arc_share(curvature, profile.reach), 0.5 * curvature * profile.reach**2
    interval = np.clip(np.searchsorted(nodes.time, at_time) - 1, 0, len(nodes.segment) - 1)
    segment = nodes.segment[interval]
    return _weighed(Track(SIDES[side], profile, at, at_time, segment, arc, offset, at), k)


def _gridded(grid: Array, way: Array, height: Array) -> Array:
    """Height averaged over each grid step (standing still counts once)."""
    edges = np.append(grid - 0.5 * STEP, grid[-1] + 0.5 * STEP)
    fine = np.interp(np.linspace(edges[0], edges[-1], 5 * len(grid) + 1), way, height)
    return np.asarray(fine[:-1].reshape(len(grid), 5).mean(axis=1))


def _weighed(track: Track, k: Array) -> Track | None:
    """Sigma from the mismatch itself, larger beside the rut; None where nothing coheres.

    Wheels that share a profile match sharply near the true slip and not at all far from it.
    """
    if len(track.at) < LEAST_ROWS:
        return None

    def noise(share: float) -> float:
        at, arc = track.at[straight], track.arc[straight]
        r, _ = mismatch(track.profile, at, share * k[track.segment][straight], arc)
        return 1.4826 * float(np.median(np.abs(r)))

    straight = track.offset <= np.median(track.offset)
    near, far = min(noise(f) for f in NEAR), min(noise(f) for f in FAR)
    if near > COHERENT * far or far < LEAST:
        return None
    sigma = LIKE_NOISE * np.hypot(max(noise(1.0), LEAST), CROSS_SLOPE * far * track.offset)
    return replace(track, sigma=sigma)


def blocks(found: list[Track], calibration: Array, layout: Layout) -> list[Block]:
    """The tracks' factors at an estimate."""
    return [
        terrain_slip(
            t.profile, t.at, t.arc, calibration, layout, t.segment, t.sigma, t.time, t.side
        )
        for t in found
    ]
