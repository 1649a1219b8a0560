"""The ground's profile under each side's wheels, as the linkage and the attitude feel it."""

from dataclasses import replace

import numpy as np

from factors import so3
from factors.terrain_slip import Profile, WheelTrack, arc_share, mismatch
from graphnav.common.run import Array
from graphnav.graph.densify import Path
from graphnav.graph.nodes import Nodes
from graphnav.rover.running_gear import K_GUESS, Wheels

STEP = 0.05  # m, grid of the profiles
EVERY = 2  # of the grid, ways at which the mismatch is looked at
SIDES = ("left", "right")
NEAR, FAR = (0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15), (0.7, 1.4)  # of the slip coefficient
COHERENT = 0.5  # mismatch near over far; above it the wheels do not share a profile
PIVOT, ASTRAY = 1.0, 0.02  # 1/m curvature of a turn on the spot; m of such way in a window
LEAST_ROWS = 50
LIKE_NOISE = 2.5  # neighbouring mismatches share their noise: their sigma is raised by this
LEAST = 2e-4  # m


def tracks(wheels: Wheels, nodes: Nodes, path: Path, k: Array) -> list[WheelTrack]:
    """Both sides' profiles with the attitude of `path`; sides that are not coherent
    at the slip coefficients `k` (segments,) are left out."""
    R_nb = path.at(wheels.time)[0]
    p_n = so3.mv(R_nb[:, None], wheels.wheels_b)
    found = (_track(wheels, nodes, p_n[..., 2], side, k) for side in (0, 1))
    return [t for t in found if t is not None]


def _track(wheels: Wheels, nodes: Nodes, up: Array, side: int, k: Array) -> WheelTrack | None:
    """Side 0 left, 1 right; `up` (N, 6) m heights of the wheels over the body origin."""
    p = wheels.wheels_b[:, side::2].mean(axis=0)
    v_y, w_z = wheels.motion.v_b[:, 1], wheels.motion.w_z
    speed = np.nan_to_num(v_y + w_z * p[:, 0].mean())
    pivoting = np.abs(w_z) > PIVOT * np.abs(v_y)
    dt = np.diff(wheels.time, prepend=wheels.time[0])
    way = np.cumsum(np.maximum(speed, 0) * dt) + 1e-9 * np.arange(len(dt))  # increasing
    astray = np.cumsum(np.where(pivoting, np.abs(speed), np.maximum(-speed, 0)) * dt)
    if way[-1] < 10.0:
        return None
    grid = np.arange(0.0, way[-1], STEP)
    front, middle, rear = (_gridded(grid, way, up[:, side + 2 * i]) for i in range(3))
    L_1, L_2 = float(p[0, 1] - p[1, 1]), float(p[1, 1] - p[2, 1])
    profile = Profile(STEP, front - middle, middle - rear, L_1, L_2)
    margin = profile.reach / float(k.min()) + STEP
    at = grid[(grid > margin) & (grid < grid[-1] - margin)][::EVERY]

    def over_window(value: Array) -> Array:
        ahead, behind = (np.interp(at + m, way, value) for m in (margin, -margin))
        return np.asarray(ahead - behind)

    at = at[over_window(np.nan_to_num(astray)) < ASTRAY]
    curvature = over_window(wheels.yaw) / (2 * margin)
    time = np.interp(at, way, wheels.time)
    interval = np.clip(np.searchsorted(nodes.time, time) - 1, 0, len(nodes.segment) - 1)
    heading = K_GUESS * np.interp(grid, way, wheels.yaw)
    track = WheelTrack(
        side=SIDES[side],
        profile=profile,
        at=at,
        time=time,
        segment=nodes.segment[interval],
        arc=arc_share(curvature, profile.reach),
        offset=_beside_the_rut(profile, grid, heading, at),
        sigma=at,
    )
    return _weighed(track, k)


def _beside_the_rut(profile: Profile, grid: Array, heading: Array, at: Array) -> Array:
    """How far (n,) m the wheels whose heights are compared ran beside each other, root sum square.

    `heading` (G,) rad, left positive. In the body origin's course y a wheel L ahead runs at
    `y + L heading`; compared are front and middle, middle and rear, front and rear.
    """
    L_1, L_2 = profile.L_1, profile.L_2
    course = np.cumsum(heading) * profile.step * K_GUESS

    def y(offset: float) -> Array:
        return np.interp(at + offset / K_GUESS, grid, course)

    def turned(offset: float) -> Array:
        return np.interp(at + offset / K_GUESS, grid, heading)

    front_middle = y(L_1) - y(0) - L_1 * turned(0)
    middle_rear = y(0) - L_2 * turned(0) - y(-L_2)
    front_rear = y(L_1) - L_2 * turned(L_1) - y(-L_2) - L_1 * turned(-L_2)
    return np.sqrt(front_middle**2 + middle_rear**2 + front_rear**2)


def _gridded(grid: Array, way: Array, height: Array) -> Array:
    """Height averaged over each grid step (standing still counts once)."""
    edges = np.append(grid - 0.5 * STEP, grid[-1] + 0.5 * STEP)
    fine = np.interp(np.linspace(edges[0], edges[-1], 5 * len(grid) + 1), way, height)
    return np.asarray(fine[:-1].reshape(len(grid), 5).mean(axis=1))


def _weighed(track: WheelTrack, k: Array) -> WheelTrack | None:
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
    slope = 1.4826 * float(np.median(np.abs(track.profile.front))) / track.profile.L_1
    sigma = LIKE_NOISE * np.hypot(max(noise(1.0), LEAST), slope * track.offset)
    return replace(track, sigma=sigma)
