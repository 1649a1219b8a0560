"""What the solver had to doubt, factor by factor and calibration by calibration.

Nothing here knows why: shares of rows, sigmas of calibrations and of the start, speeds.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from factors.block import Block
from graphnav.common.run import Array
from graphnav.result.quality import Doubt
from graphnav.result.solved import Calibrated, Solved

DOUBTED = 0.5  # a row's weight
SPANS_TOLD = 6
FEW = 8  # factors of a kind that can be judged at all
# Healthy runs, simulated and recorded, doubt up to 6 % of their fixes and 4 % of their odometer
SURPRISING, BEYOND = 5.0, 15.0  # sigma of a calibration
STATED = 2.5  # sigma of a stated heading
WORSE = 4.0  # times its stated noise that an IMU is told to be
FASTEST, STRONGEST = 100.0, 15.0  # m/s, m/s^2 over a second: no land vehicle
CLIMBING = 1.0  # tangent of a slope kept up for a second


@dataclass(frozen=True)
class Limits:
    """Of a kind of factor: its rows that count, shares doubted that make a result doubtful or not
    acceptable, and words for them."""

    axes: tuple[str, ...]  # () for all
    doubtful: float
    rejected: float
    name: str
    rows: str


KINDS = {
    kinds.GNSS: Limits(("east", "north"), 0.15, 0.4, "the fixes contradict", "fixes"),
    kinds.DISPLACEMENT: Limits((), 0.12, 0.5, "the odometer contradicts", "odometer intervals"),
    kinds.VELOCITY: Limits((), 0.12, 0.5, "the odometer contradicts", "odometer intervals"),
    kinds.WHEEL_DISPLACEMENT: Limits((), 0.25, 0.6, "the wheels contradict", "wheel intervals"),
    kinds.HEADING: Limits((), 0.2, 0.5, "the heading sensor contradicts", "headings"),
    kinds.INERTIAL: Limits((), 0.05, 0.4, "the IMU contradicts", "inertial intervals"),
}

Cause = tuple[str, str]  # what a surprising calibration means, and its cure
CALIBRATIONS: dict[str, Cause] = {
    "odometer_scale": (
        "the odometer's scale is {value:.4g}",
        "check the odometer's unit (km/h is 0.278), direction and [odometer] metres_per_pulse",
    ),
    "mounting_deg": (
        "the IMU lies {value:.1f} deg ({component}) from its stated mounting",
        "check [odometer] mount_deg and [imu] axes",
    ),
    "lever_arm_m": (
        "the odometer's lever arm {component} comes out at {value:.1f} m",
        "check [odometer] lever_arm: metres, from the IMU, right forward up",
    ),
    "antenna_lever_arm_m": (
        "the antenna's lever arm {component} comes out at {value:.1f} m",
        "check [gnss] lever_arm: metres, from the IMU to the antenna, right forward up",
    ),
    "gyro_bias_deg_h": (
        "the gyro's bias {component} is {value:.3g} deg/h",
        "check the gyro's unit and [imu] gyro_bias_deg_h or grade",
    ),
    "accel_bias_mg": (
        "the accelerometer's bias {component} is {value:.3g} mg",
        "check [imu] axes, the accelerometer's unit and [imu] accel_bias_mg or grade",
    ),
    "time_offset_s": (
        "the odometer's clock is {value:.2f} s late",
        "check how the odometer is stamped, or state [odometer] time_offset_s",
    ),
    "gnss_offset_m": (
        "the fixes lie {value:.1f} m ({component}) off as one",
        "check the fixes' datum and [start]",
    ),
}


def of_factors(solved: Solved) -> list[Doubt]:
    """Kinds of factor of which too many rows were doubted, with the longest span."""
    said = []
    for kind, limits in KINDS.items():
        time, doubted = rows_doubted(solved, kind, limits.axes)
        share = float(doubted.mean()) if len(doubted) >= FEW else 0.0
        if share > limits.doubtful:
            start, end = longest(time, doubted)
            clock = solved.run.clock_start
            said.append(
                Doubt(
                    1 + (share > limits.rejected),
                    f"{limits.name} the rest: {100 * share:.0f} % of the {limits.rows} were "
                    f"doubted, longest {start + clock:.0f}-{end + clock:.0f} s",
                )
            )
    return said


def where(solved: Solved) -> list[str]:
    """The longest spans in which fixes were doubted, in sentences and in order of time."""
    clock = solved.run.clock_start
    found = spans(*rows_doubted(solved, kinds.GNSS, KINDS[kinds.GNSS].axes))
    told = sorted(sorted(found, key=lambda s: s[0] - s[1])[:SPANS_TOLD])
    return [f"GNSS disagreed {a + clock:.0f}-{b + clock:.0f} s: down-weighted" for a, b in told]


def rows_doubted(
    solved: Solved, kind: str, axes: tuple[str, ...] = ()
) -> tuple[Array, NDArray[np.bool_]]:
    """Times (n,) s of the factors of a kind and whether any of the `axes` was doubted, (n,)."""
    time, mask = np.zeros(0), np.zeros(0, bool)
    for block, weight in of_kind(solved, kind):
        rows = [k for k, axis in enumerate(block.axes) if not axes or axis in axes]
        time = np.append(time, block.time)
        mask = np.append(mask, (weight[:, rows] < DOUBTED).any(axis=1))
    return time, mask


def of_kind(solved: Solved, kind: str) -> Iterator[tuple[Block, Array]]:
    """Blocks of a kind with their weights."""
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        if block.kind == kind and len(block.time):
            yield block, weight


def spans(time: Array, mask: NDArray[np.bool_], least: int = 3) -> list[tuple[float, float]]:
    """Times of the first and last of `least` or more consecutive True."""
    edge = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    pairs = zip(edge[::2], edge[1::2], strict=True)
    return [(float(time[a]), float(time[b - 1])) for a, b in pairs if b - a >= least]


def longest(time: Array, mask: NDArray[np.bool_]) -> tuple[float, float]:
    """The longest span of consecutive True."""
    return max(spans(time, mask, 1), key=lambda span: span[1] - span[0])


def of_calibrations(calibrated: list[Calibrated]) -> list[Doubt]:
    """Calibrations that ended where their prior all but excludes them."""
    said = []
    for c in calibrated:
        if c.name not in CALIBRATIONS:
            continue
        what, cure = CALIBRATIONS[c.name]
        sigmas = sigmas_off(c)
        for k in np.flatnonzero(sigmas > SURPRISING):
            value = float(np.median(c.value[:, k]))
            found = what.format(value=value, component=c.components[k])
            said.append(
                Doubt(1, f"{found}, {sigmas[k]:.0f} of its sigma from what is stated", cure)
            )
    return said


def sigmas_off(c: Calibrated) -> Array:
    """How many of its prior's sigma a calibration lies from it, by component, (d,)."""
    return np.asarray(np.abs(np.median(c.value, axis=0) - c.prior) / np.maximum(c.prior_sd, 1e-12))


def of_start(solved: Solved) -> list[Doubt]:
    """A stated heading and a stated position that the run contradicts."""
    said = []
    source = solved.solver.get("heading_source", "at the start")
    for block, _ in of_kind(solved, kinds.START):
        assert block.sigma is not None
        sigmas, off = np.abs(block.residual[0]), np.abs(block.residual[0] * block.sigma[0])
        if sigmas[2] > STATED:
            said.append(
                Doubt(
                    int(sigmas[2] > SURPRISING),
                    f"the heading {source} disagrees with the run by {np.rad2deg(off[2]):.3g} deg, "
                    f"{sigmas[2]:.1f} of its sigma",
                    "correct or leave out [start] heading_deg, or state its heading_sd_deg",
                )
            )
        if max(sigmas[6:8]) > SURPRISING:
            said.append(
                Doubt(
                    1,
                    f"[start] is {distance(float(np.hypot(*off[6:8])))} from where the run began",
                    "correct or leave out [start] lat and lon",
                )
            )
    return said


def of_inertial_noise(solved: Solved) -> list[Doubt]:
    """An IMU far worse than stated: by its residuals and by the noise found in them."""
    found = solved.solver.get("noise_found", {})
    times = [float(v) for k, v in found.items() if k.startswith(kinds.INERTIAL)]
    for block, weight in of_kind(solved, kinds.INERTIAL):
        times.append(float(np.sqrt(np.mean(weight * block.residual**2, axis=0)).max()))
    worst = max([0.0, *times])
    if worst < WORSE:
        return []
    return [
        Doubt(
            0,
            f"the IMU is {worst:.0f} times as noisy as its grade or data sheet says",
            "state [imu] grade or its noise as it is when driving",
        )
    ]


def of_unused_fixes(solved: Solved, columns: dict[str, Array]) -> list[Doubt]:
    """The path far from fixes that were not used, for what they are worth."""
    gnss = solved.run.gnss
    if gnss is None or rows_doubted(solved, kinds.GNSS)[0].size:
        return []
    time = columns["time"] - solved.run.clock_start
    on = (gnss.time >= time[0]) & (gnss.time <= time[-1])
    if on.sum() < FEW:
        return []
    off = [np.interp(gnss.time[on], time, columns[k]) - x
           for k, x in zip("en", solved.fixes_n[on].T, strict=False)]  # fmt: skip
    sd = [np.interp(gnss.time[on], time, columns[f"sd_{k}"]) for k in "en"]
    apart, promised = np.hypot(*off), np.hypot(np.hypot(*sd), np.hypot(*gnss.sd_enu[on, :2].T))
    sigmas = float(np.median(apart / promised))
    if sigmas < SURPRISING:
        return []
    return [
        Doubt(
            1,
            f"the path lies {distance(float(np.median(apart)))} from the fixes that were not used, "
            f"{sigmas:.0f} times what it promises",
            "smooth with the fixes, or check [start] heading_deg, [imu] axes and the odometer",
        )
    ]


def of_motion(columns: dict[str, Array]) -> list[Doubt]:
    """Speeds, accelerations and slopes that no land vehicle has, over a second each."""
    time = columns["time"]
    once = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], 1.0)))
    if len(once) < 3:
        return []
    t, v = time[once], np.stack([columns[k][once] for k in ("v_e", "v_n", "v_u")], -1)
    speed = np.linalg.norm(v, axis=1)
    gained = np.append(np.linalg.norm(np.diff(v, axis=0), axis=1) / np.diff(t), 0.0)
    slope = np.abs(v[:, 2]) - CLIMBING * np.maximum(np.hypot(v[:, 0], v[:, 1]), 1.0)

    def told(value: Array, limit: float, word: Callable[[int], str]) -> list[Doubt]:
        k = int(value.argmax())
        return [] if value[k] < limit else [Doubt(2, f"{word(k)} at {t[k]:.0f} s: no vehicle does")]

    return [
        *told(speed, FASTEST, lambda k: f"the path moves at {speed[k]:.0f} m/s"),
        *told(gained, STRONGEST, lambda k: f"the path changes its speed by {gained[k]:.0f} m/s^2"),
        *told(slope, 1.0, lambda k: f"the path rises or falls at {abs(v[k, 2]):.0f} m/s"),
    ]


def distance(metres: float) -> str:
    """A distance in words."""
    return f"{metres / 1000:.1f} km" if metres >= 1000 else f"{metres:.3g} m"
