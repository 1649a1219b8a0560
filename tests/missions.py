"""Missions of a tracked vehicle as motion states are recognised from them: kinematics, truth."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from graphnav.common.run import Array
from graphnav.recognition.motion_states import Kinematics

RADIUS = {  # m, middle of what the states drive on concrete
    "turn_arc": 12.5,
    "turn_separated": 50.0,
    "turn_separated_low": 45.0,
    "turn_pivot": 2.14,
    "turn_pivot_low": 2.14,
}
FACTOR = {  # v_y / v_o on concrete
    "straight_high": 1.0,
    "straight_low": 1 / 1.42,
    "stop": 1.0,
    "turn_arc": 0.8688,
    "turn_separated": 0.97,
    "turn_separated_low": 0.97 / 1.42,
    "turn_pivot": 0.5,
    "turn_pivot_low": 0.5 / 1.42,
}
# Missions drive these blocks in random order; each begins and ends in high gear or at rest.
BLOCKS = (
    ("turn_arc",),
    ("turn_separated",),
    ("turn_pivot",),
    ("straight_low",),
    ("straight_low", "turn_separated_low", "straight_low"),
    ("straight_low", "turn_pivot_low", "straight_low"),
    ("stop",),
)
SPEED = {"stop": 0.0, "turn_arc": 4.0, "turn_separated": 5.0, "turn_pivot": 0.9}


@dataclass(frozen=True)
class Ground:
    """How far a ground is off concrete: multiplies radii and factors of every state."""

    radius: dict[str, float]
    factor: dict[str, float]


def some_ground(rng: np.random.Generator, spread: float) -> Ground:
    """Radii off by up to `spread` either way; in turns, factors too, straight slip a third."""
    return Ground(
        {state: 1 + spread * rng.uniform(-1, 1) for state in RADIUS},
        {s: 1 - spread * rng.uniform(0, 1) * (1 if "turn" in s else 1 / 3) for s in FACTOR},
    )


def mission(rng: np.random.Generator, ground: Ground, blocks: int = 24) -> tuple[Kinematics, Array]:
    """Kinematics at 10 Hz as a perfect inertial solution and a pulse counter see them; states."""
    plan = _plan(rng, blocks)
    state = np.concatenate([np.full(round(10 * seconds), name) for name, seconds, _ in plan])
    target = np.concatenate([np.full(round(10 * seconds), speed) for _, seconds, speed in plan])
    v_y = gaussian_filter1d(target, 9.0)
    factor = np.array([FACTOR[s] * ground.factor[s] for s in state])
    v_o = v_y * np.exp(gaussian_filter1d(np.log(1 / factor), 3.0))
    bend = _bends(rng, ground, state, v_y)
    time = 0.1 * np.arange(len(state))
    yaw_rate = gaussian_filter1d(bend, 3.0) + 0.002 * np.sin(time / 3) * (v_y > 0.1)
    at_standstill = (state == "stop") & (v_y < 0.15)
    rolling_out = (state == "stop") & (v_y >= 0.15)  # before and after the stop proper
    state = np.where(rolling_out, "straight_high", state)
    v_y, v_o = np.where(at_standstill, 0, v_y), np.where(at_standstill, 0, v_o)
    pulses = np.floor(np.r_[0.0, np.cumsum(v_o * 0.1)] / 0.0108)
    shake = np.where(v_y > 0.1, 1.0, 0.0)
    return Kinematics(
        time=time,
        v_y=v_y + 0.02 * rng.standard_normal(len(time)),
        sd_v_y=np.full(len(time), 0.03),
        v_o=np.diff(pulses) * 0.108,
        yaw_rate=yaw_rate,
        a_c=-v_y * yaw_rate + 0.25 * shake * rng.standard_normal(len(time)),
        at_standstill=np.zeros(len(time), dtype=bool),
        accel_y=np.gradient(v_y, time) + 0.1 * shake * rng.standard_normal(len(time)),
    ), state


def _plan(rng: np.random.Generator, blocks: int) -> list[tuple[str, float, float]]:
    """State, seconds and m/s of each leg."""
    order = [BLOCKS[i] for i in np.r_[rng.permutation(7), rng.integers(0, 7, blocks - 7)]]
    plan = [("stop", 30.0, 0.0)]
    for block in order:
        plan.append(("straight_high", rng.uniform(8, 60), rng.uniform(3, 13)))
        for state in block:
            low = rng.uniform(1.8, 3.5) if state.endswith("low") else 0.0
            speed = 0.8 if state == "turn_pivot_low" else SPEED.get(state, low)
            plan.append((state, rng.uniform(4, 12) * (3 if state == "stop" else 1), speed))
    return [*plan, ("straight_high", 20.0, 6.0)]


def _bends(rng: np.random.Generator, ground: Ground, state: Array, v_y: Array) -> Array:
    """Turning rate (N,) rad/s of the legs that turn, either way."""
    bend = np.zeros(len(state))
    edges = np.flatnonzero(np.r_[True, state[1:] != state[:-1], True])
    for first, last in pairwise(edges):
        if state[first] in RADIUS:
            radius = RADIUS[state[first]] * ground.radius[state[first]]
            turning = min(np.median(v_y[first:last]) / radius, 0.45)  # below A16's limit
            bend[first:last] = rng.choice([-1, 1]) * turning
    return bend
