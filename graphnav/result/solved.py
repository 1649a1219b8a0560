"""A solved run as the writers see it, whichever vehicle and solver it came from."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from factors.block import Block
from graphnav.common.angles import angles_of_rotation
from graphnav.common.earth import Origin
from graphnav.common.remark import Remark
from graphnav.common.run import Array, Run
from graphnav.graph.densify import Path
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.timeline import Timeline
from graphnav.result.events import Event


@dataclass(frozen=True)
class Calibrated:
    """One calibrated quantity, ready to be told."""

    name: str
    unit: str
    components: tuple[str, ...]
    constant: bool
    time: Array  # (T,) s, T = 1 when constant
    value: Array  # (T, d)
    sd: Array  # (T, d)
    prior: Array  # (d,)
    prior_sd: Array  # (d,)

    @property
    def observable(self) -> list[bool]:
        """Whether the run told more of each component than its prior did."""
        return [bool(s) for s in self.sd.min(0) < 0.7 * self.prior_sd]


@dataclass(frozen=True)
class Odometry:
    """The odometer as recorded and as corrected `[v_x, v_y]`, for plots."""

    time: Array  # (n,) s
    raw_speed: Array  # (n,) m/s
    v_x: Array  # (n,) m/s, NaN where discarded
    v_y: Array  # (n,) m/s


@dataclass(frozen=True)
class Solved:
    """Trajectory, covariances and what was learnt on the way."""

    run: Run
    vehicle: Vehicle
    origin: Origin
    path: Path  # dense
    R_bm: Array  # (3, 3) mounting found
    node_time: Array  # (N,) s
    node_covariance: Array  # (N, 9, 9) of [theta (b), v (n), p (n)]
    timeline: Timeline
    calibrated: list[Calibrated]
    blocks: list[Block]
    weights: list[Array]
    reckoned: Path | None
    odometry: Odometry | None
    fixes_n: Array  # (F, 3) m, every fix of the run, used or not
    standstills: Array  # (K, 2) s, spans of standstill
    solver: dict[str, Any]  # for summary.json
    verdicts: list[str]
    remarks: tuple[Remark, ...] = ()  # found before the solution
    moved: Array | None = (
        None  # (C, 4) carried as it stands: start, end, s; horizontally, vertically
    )
    gaps: Array | None = None  # (G, 4) of the IMU: start, end, s; turn [rad] and speed [m/s] lost
    imu_late: float = 0.0  # s, of the clock the run is told on, by what fixes show
    wheel_events: tuple[Event, ...] = ()  # of single wheels of a rover
    causal: dict[str, Array] | None = None  # columns of trajectory_causal.parquet


def row_weights(solved: Solved, kinds: tuple[str, ...]) -> tuple[Array, Array]:
    """End times (n,) and weights (n, 3) of the vehicle factors, lateral, forward, vertical."""
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        if block.kind in kinds and len(block.time):
            return block.time, weight
    return np.zeros(0), np.zeros((0, 3))


def start_heading_deg(solved: Solved) -> float:
    """Heading at the start of what `[start] heading_of` names, the IMU or the vehicle, deg."""
    R = solved.path.R_nb[0]
    ahead = R @ solved.R_bm if solved.vehicle.start.heading_of == "vehicle" else R
    return float(np.rad2deg(angles_of_rotation(ahead)[2]))
