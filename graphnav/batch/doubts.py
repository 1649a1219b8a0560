"""What the solver had to doubt, factor by factor and calibration by calibration.

Nothing here knows why: shares of rows, sigmas of calibrations and of the start, speeds.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from factors.block import Block
from graphnav.common.remark import Remark
from graphnav.common.run import Array
from graphnav.result.solved import Calibrated, Solved

AMONG = 3.0  # times their scatter that fixes may lie off a path that runs among them
DOUBTED = 0.5  # a row's weight
FEW = 8  # factors of a kind that can be judged at all
# Healthy runs, simulated and recorded, doubt up to 6 % of their fixes and 4 % of their odometer
SURPRISING = 5.0  # sigma of a calibration
STATED = 2.5  # sigma of a stated heading
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
    disturbed_s: float = 0.0  # what doubts between believed rows may last and be a disturbance


KINDS = {
    # multipath sets fixes aside for seconds; odometer and IMU hold the path meanwhile
    kinds.GNSS: Limits(("east", "north"), 0.15, 0.4, "the fixes contradict", "fixes", 30.0),
    kinds.DISPLACEMENT: Limits((), 0.12, 0.5, "the odometer contradicts", "odometer intervals"),
    kinds.VELOCITY: Limits((), 0.12, 0.5, "the odometer contradicts", "odometer intervals"),
    kinds.WHEEL_DISPLACEMENT: Limits((), 0.25, 0.6, "the wheels contradict", "wheel intervals"),
    kinds.HEADING: Limits((), 0.2, 0.5, "the heading sensor contradicts", "headings"),
    kinds.INERTIAL: Limits((), 0.05, 0.4, "the IMU contradicts", "inertial intervals"),
}

# scales a user's odometer comes with: metres per second, or per count, over its unit
FACTORS = {
    1 / 3.6: "km/h",
    0.44704: "miles per hour",
    0.514444: "knots",
    0.3048: "feet",
    0.01: "centimetres",
    0.001: "millimetres",
    0.5: "both edges of a pulse counted",
    0.25: "four edges of a pulse counted",
    2.0: "half the pulses counted",
}
Cause = tuple[str, str]  # what a surprising calibration means, and its cure
CALIBRATIONS: dict[str, Cause] = {
    "odometer_scale": (
        "the odometer's scale is {value:.4g}{named}",
        "check the odometer's unit, direction and [odometer] metres_per_pulse",
    ),
    "mounting_deg": (
        "the IMU lies {off:.1f} deg ({component}) from its stated mounting",
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
    "gyro_scale_ppm": (
        "the gyro's scale {component} is off by {value:.3g} ppm",
        "check the gyro's unit and [imu] gyro_scale_ppm or grade",
    ),
    "accel_scale_ppm": (
        "the accelerometer's scale {component} is off by {value:.3g} ppm",
        "check the accelerometer's unit and [imu] accel_scale_ppm or grade",
    ),
    "time_offset_s": (
        "the odometer's clock is {value:.2f} s late",
        "check how the odometer is stamped, or state [odometer] time_offset_s",
    ),
    "gnss_time_offset_s": (
        "the fixes are {value:.2f} s late against the IMU",
        "check how fixes and IMU are stamped, or state [gnss] time_offset_s",
    ),
    "gnss_offset_m": (
        "the fixes lie {value:.1f} m ({component}) off as one",
        "check the fixes' datum and [start]",
    ),
}


def of_factors(solved: Solved) -> list[Remark]:
    """Kinds of factor of which too many rows were doubted, with the longest span."""
    said = []
    for kind, limits in KINDS.items():
        time, doubted = rows_doubted(solved, kind, limits.axes)
        share = float(doubted.mean()) if len(doubted) >= FEW else 0.0
        lasting = doubted & ~disturbed(time, doubted, limits.disturbed_s)
        if share > limits.rejected or (len(doubted) >= FEW and lasting.mean() > limits.doubtful):
            start, end = longest(time, doubted)
            away = share > limits.rejected and not scattered(solved, kind, limits.axes)
            clock = solved.run.clock_start
            said.append(
                Remark(
                    f"{limits.name} the rest: {100 * share:.0f} % of the {limits.rows} were "
                    f"doubted, longest {start + clock:.0f}-{end + clock:.0f} s",
                    level=1 + away,
                )
            )
    return said


def scattered(solved: Solved, kind: str, axes: tuple[str, ...] = ()) -> bool:
    """Whether rows are doubted for their scatter about a path that lies among them."""
    for block, _ in of_kind(solved, kind):
        if block.sigma is not None and len(block.time) >= FEW:
            rows = [k for k, axis in enumerate(block.axes) if not axes or axis in axes]
            off = (block.residual * block.sigma)[:, rows]
            return bool(np.all(np.median(np.abs(off), axis=0) < AMONG * scatter(off)))
    return False


def scatter(off: Array) -> Array:
    """Standard deviation (d,) of what differs from one row of (n, d) to the next, robust."""
    return np.asarray(1.4826 * np.median(np.abs(np.diff(off, axis=0)), axis=0) / np.sqrt(2))


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


def disturbed(time: Array, doubted: NDArray[np.bool_], most_s: float) -> NDArray[np.bool_]:
    """Which of the doubted rows (n,) stand in spells, not single, between rows that are believed,
    no longer than `most_s`."""
    out = np.zeros(len(time), bool)
    for start, end in spans(time, doubted):
        if end - start <= most_s and start > time[0] and end < time[-1]:
            out |= (time >= start) & (time <= end)
    return out & doubted


def longest(time: Array, mask: NDArray[np.bool_]) -> tuple[float, float]:
    """The longest span of consecutive True."""
    return max(spans(time, mask, 1), key=lambda span: span[1] - span[0])


def of_calibrations(calibrated: list[Calibrated]) -> list[Remark]:
    """Calibrations that ended where their prior all but excludes them."""
    said = []
    for c in calibrated:
        if c.name not in CALIBRATIONS:
            continue
        what, cure = CALIBRATIONS[c.name]
        sigmas = sigmas_off(c)
        for k in np.flatnonzero(sigmas > SURPRISING):
            value = float(np.median(c.value[:, k]))
            words = {"value": value, "off": value - c.prior[k], "component": c.components[k]}
            found = what.format(**words, named=_factor_named(value))
            said.append(
                Remark(f"{found}, {sigmas[k]:.0f} of its sigma from what is stated", cure, level=1)
            )
    return said


def _factor_named(scale: float) -> str:
    """What an odometer's scale looks like, in brackets; nothing where it looks like nothing."""
    named = [name for factor, name in FACTORS.items() if abs(abs(scale) / factor - 1) < 0.02]
    if scale < 0:
        named = ["forward counted as backward", *named]
    return f" ({', '.join(named)}?)" if named else ""


def sigmas_off(c: Calibrated) -> Array:
    """How many of its prior's sigma a calibration lies from it, by component, (d,)."""
    return np.asarray(np.abs(np.median(c.value, axis=0) - c.prior) / np.maximum(c.prior_sd, 1e-12))


def of_start(solved: Solved) -> list[Remark]:
    """A stated heading that the run contradicts."""
    said = []
    source = solved.solver.get("heading_source", "at the start")
    for block, _ in of_kind(solved, kinds.START_HEADING):
        assert block.sigma is not None
        sigma, off = abs(block.residual[0, 0]), abs(block.residual[0, 0] * block.sigma[0, 0])
        if sigma > STATED:
            said.append(
                Remark(  # fixes decide; without them it is one against the other
                    f"the heading {source} disagrees with the run by {np.rad2deg(off):.3g} deg, "
                    f"{sigma:.1f} of its sigma",
                    "correct or leave out [start] heading_deg, or state its heading_sd_deg",
                    level=int(sigma > SURPRISING and solved.run.gnss is None),
                )
            )
    return said


def of_motion(columns: dict[str, Array]) -> list[Remark]:
    """Speeds, accelerations and slopes that no land vehicle has, over a second each."""
    time = columns["time"]
    once = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], 1.0)))
    if len(once) < 3:
        return []
    t, v = time[once], np.stack([columns[k][once] for k in ("v_e", "v_n", "v_u")], -1)
    speed = np.linalg.norm(v, axis=1)
    gained = np.append(np.linalg.norm(np.diff(v, axis=0), axis=1) / np.diff(t), 0.0)
    slope = np.abs(v[:, 2]) - CLIMBING * np.maximum(np.hypot(v[:, 0], v[:, 1]), 1.0)

    def over(value: Array, limit: float, word: Callable[[int], str]) -> list[Remark]:
        k = int(value.argmax())
        return (
            []
            if value[k] < limit
            else [Remark(f"{word(k)} at {t[k]:.0f} s: no vehicle does", level=2)]
        )

    return [
        *over(speed, FASTEST, lambda k: f"the path moves at {speed[k]:.0f} m/s"),
        *over(gained, STRONGEST, lambda k: f"the path changes its speed by {gained[k]:.0f} m/s^2"),
        *over(slope, 1.0, lambda k: f"the path rises or falls at {abs(v[k, 2]):.0f} m/s"),
    ]


def distance(metres: float) -> str:
    """A distance in words."""
    return f"{metres / 1000:.1f} km" if metres >= 1000 else f"{metres:.3g} m"
