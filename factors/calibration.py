"""The chain of calibration vectors: what is in it, its prior and its random walk.

All that is constant or slow (biases, scale factor, mounting, lever arm, delay, ground) is one
vector per segment of some ten seconds; neighbouring vectors are tied by a random walk whose density
says how constant each component is. One uniform chain keeps batch and incremental smoothing linear
in the run's length (design fact 6).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from factors import kinds
from factors.block import Array, Block, Index, Term

# names of the components
GYRO_BIAS, ACCEL_BIAS = "gyro_bias", "accel_bias"  # rad/s, m/s^2, body axes
GYRO_SCALE, ACCEL_SCALE = "gyro_scale", "accel_scale"  # 1, body axes: measured less true, of it
IMU_ERRORS = (GYRO_BIAS, ACCEL_BIAS, GYRO_SCALE, ACCEL_SCALE)  # three axes each, in this order
SCALE, MOUNTING, LEVER = "scale", "mounting", "lever"  # odometer: 1; pitch, heading; m, body
DELAY, CORNERING, TRACK_WIDTH = "delay", "cornering", "track_width"  # s; s; m
SLOPE_DRIFT = "slope_drift"  # 1: slip angle per sine of the side slope
ANTENNA, GNSS_OFFSET, GNSS_DELAY = "antenna", "gnss_offset", "gnss_delay"  # m, body; m, n; s
SLIP_COEFFICIENT, SIDE_SLIP, YAW_SLIP, TOE = "slip_coefficient", "side_slip", "yaw_slip", "toe"


def forward_of(state: str) -> str:
    """The odometer's factor in a motion state."""
    return f"forward:{state}"


def lateral_of(state: str) -> str:
    """Sideways metres per radian of turn in a motion state."""
    return f"lateral:{state}"


CONSTANT = 1e-6  # of its prior sd: how far a constant may wander in one second


@dataclass(frozen=True)
class Component:
    """One calibrated quantity: a constant, a random walk (`walk`), or with `memory` an error that
    comes and goes about its prior, correlated over that time.
    """

    name: str
    prior: Array  # (d,)
    sd: Array  # (d,) one sigma of the prior
    walk: float | None = None  # per sqrt(s), in the component's unit
    memory: float | None = None  # s, of a first-order Gauss-Markov process


@dataclass(frozen=True)
class Layout:
    """Where each component stands in the calibration vector."""

    components: tuple[Component, ...]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Columns of each component."""
        ends = np.cumsum([len(c.prior) for c in self.components])
        starts = [0, *ends[:-1]]
        return {
            c.name: slice(int(a), int(b))
            for c, a, b in zip(self.components, starts, ends, strict=True)
        }

    @property
    def dim(self) -> int:
        """Length of the calibration vector."""
        return sum(len(c.prior) for c in self.components)

    @cached_property
    def prior(self) -> Array:
        """(dim,)"""
        return np.concatenate([c.prior for c in self.components])

    @cached_property
    def prior_sd(self) -> Array:
        """(dim,)"""
        return np.concatenate([c.sd for c in self.components])

    @cached_property
    def walk(self) -> Array:
        """(dim,) random-walk density per sqrt(s); of a process with memory over short times."""

        def density(c: Component) -> Array:
            if c.memory is not None:
                return np.asarray(c.sd * np.sqrt(2 / c.memory))
            return CONSTANT * c.sd if c.walk is None else np.full(len(c.prior), c.walk)

        return np.concatenate([density(c) for c in self.components])

    @cached_property
    def memory(self) -> Array:
        """(dim,) s; infinite for constants and random walks."""
        return np.concatenate([np.full(len(c.prior), c.memory or np.inf) for c in self.components])

    @cached_property
    def imu_errors(self) -> tuple[Index, Index]:
        """Columns (m,) of the IMU's errors that are calibrated, and which of the twelve each is."""
        there = [(k, name) for k, name in enumerate(IMU_ERRORS) if name in self.slices]
        every = np.arange(self.dim)
        columns = [every[self.slices[name]] for _, name in there]
        return np.concatenate(columns), np.concatenate([3 * k + np.arange(3) for k, _ in there])

    def imu_errors_of(self, calibration: Array) -> Array:
        """The IMU's errors (n, 12) in calibrations (n, dim): biases and scale factors of gyro and
        accelerometer, zero where they are not calibrated.
        """
        columns, which = self.imu_errors
        errors = np.zeros((*calibration.shape[:-1], 3 * len(IMU_ERRORS)))
        errors[..., which] = calibration[..., columns]
        return errors

    def column(self, name: str) -> int:
        """The column of a component that is a single number and there."""
        span = self.slices[name]
        assert span.stop == span.start + 1, f"{name} has several columns"
        return int(span.start)

    def find(self, name: str) -> int | None:
        """The column of a component that is a single number, None when the layout has none."""
        return self.column(name) if name in self.slices else None


def prior(layout: Layout, calibration: Array, heavy: tuple[str, ...] = ()) -> list[Block]:
    """The first segment at its prior: `(c_0 - prior) / sd`.

    The components named in `heavy` form a block of their own that is marked robust: what a user
    states is right to its sigma, or it is another thing altogether.
    """
    rest, tail = _apart(layout, heavy)
    blocks = [_prior(kinds.CALIBRATION_PRIOR, layout, calibration, rest, False)]
    if len(tail):
        blocks.append(_prior(kinds.STATED, layout, calibration, tail, True))
    return blocks


def _prior(kind: str, layout: Layout, calibration: Array, rows: Index, robust: bool) -> Block:
    """Prior of some components (r,) as one block."""
    sd = layout.prior_sd[rows]
    residual = (calibration[:1, rows] - layout.prior[rows]) / sd
    jacobian = (np.eye(layout.dim)[rows] / sd[:, None])[None]
    term = Term("c", np.zeros(1, np.int64), jacobian)
    axes = tuple(str(k) for k in rows)
    return Block(kind, axes, np.zeros(1), residual, (term,), robust=robust)


def _apart(layout: Layout, heavy: tuple[str, ...]) -> tuple[Index, Index]:
    """Columns of the components that are not named, and of those that are."""
    chosen = [np.arange(s.start, s.stop) for name, s in layout.slices.items() if name in heavy]
    tail = np.concatenate(chosen) if chosen else np.zeros(0, np.int64)
    return np.setdiff1d(np.arange(layout.dim), tail), tail


def walk(layout: Layout, calibration: Array, time: Array, heavy: tuple[str, ...]) -> list[Block]:
    """Random walk between segments (B6): `(c_{k+1} - c_k) / (walk sqrt(dt))`; with memory tau
    `(c_{k+1} - m - phi (c_k - m)) / (sd sqrt(1 - phi^2))`, phi = exp(-dt / tau), m the prior
    (Source: Gelb 1974, Applied Optimal Estimation, 3.6).

    `calibration` (K, dim), `time` (K,) s, the middles of the segments. The components named in
    `heavy` form a block of their own that is marked robust: a heavy-tailed step lets a puncture be
    a step of the scale factor instead of a smear.
    """
    rest, tail = _apart(layout, heavy)
    blocks = [_walk(kinds.CALIBRATION_WALK, layout, calibration, time, rest, False)]
    if len(tail):
        blocks.append(_walk(kinds.SCALE_WALK, layout, calibration, time, tail, True))
    return blocks


def _walk(
    kind: str, layout: Layout, calibration: Array, time: Array, rows: Index, robust: bool
) -> Block:
    """Walk of some components (r,) as one block."""
    dt = np.diff(time)[:, None]
    phi = np.exp(-dt / layout.memory[rows])  # (K - 1, r)
    forgotten = layout.prior_sd[rows] * np.sqrt(1 - phi * phi)
    inverse = 1 / np.where(phi < 1, forgotten, layout.walk[rows] * np.sqrt(dt))
    select = np.eye(layout.dim)[rows][None] * inverse[:, :, None]
    away = calibration[:, rows] - layout.prior[rows]
    index: Index = np.arange(len(calibration) - 1)
    return Block(
        kind=kind,
        axes=tuple(str(k) for k in rows),
        time=time[1:],
        residual=(away[1:] - phi * away[:-1]) * inverse,
        terms=(Term("c", index, -select * phi[:, :, None]), Term("c", index + 1, select)),
        robust=robust,
    )
