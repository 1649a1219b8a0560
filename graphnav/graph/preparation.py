"""Everything a solution needs that does not change between rounds."""

from dataclasses import dataclass, replace

import numpy as np

from factors import so3
from factors.block import Index
from factors.calibration import Layout
from factors.preintegration import Increments, InertialNoise, preintegrate
from graphnav.common.earth import G_STANDARD, Origin
from graphnav.common.errors import InputError
from graphnav.common.remark import Remark
from graphnav.common.run import EVERY_AXIS, Array, Gnss, Odometer, Run
from graphnav.graph import calibrations
from graphnav.graph.nodes import INTERVAL_S
from graphnav.inertial.alignment import Alignment, align
from graphnav.inertial.fix_delay import found_delay
from graphnav.inertial.heading_sources import STATED
from graphnav.inertial.increments import increments
from graphnav.inertial.level_force import felt_when_level
from graphnav.inertial.orientation import oriented
from graphnav.inertial.reckoning import inertial_path
from graphnav.inertial.standstill import (
    BEGINS_S,
    Standstill,
    believable,
    find_standstill,
    rocking,
)
from graphnav.inertial.standstill_evidence import Mask, within
from graphnav.reading.outages import Outages, in_use
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.corrections import Correction, VehicleParams, correction_table

LOW_GEAR_RATIO = 1.42  # of a gearbox odometer, where the vehicle file does not say (A6)
# rad/sqrt(s) of roll and pitch: a tenth of what a car, a van and four robots show over 0.5 to 5 s,
# as the first round takes ten times what is stated (`inertial_noise.py`) and the residuals go on
ROCKS = 8e-4
INITIAL_STANDSTILL_S = 3.0  # a standstill at least this long, begun as the run starts, aligns


@dataclass(frozen=True)
class Setup:
    """What holds for the whole run: the vehicle, where it began and what is to be estimated."""

    vehicle: Vehicle
    noise: InertialNoise
    alignment: Alignment
    table: dict[str, Correction]
    layout: Layout
    two_sided: bool = False  # both sides of a skidding vehicle are recorded
    interval: float = INTERVAL_S  # s between nodes
    fix_delay: float = 0.0  # s, taken off the stamps of the fixes beforehand

    @property
    def params(self) -> VehicleParams:
        """What state recognition must know of the vehicle."""
        return params(self.vehicle, self.two_sided)


@dataclass(frozen=True)
class Sensed:
    """What the sensors said over the run, or over a piece of it."""

    run: Run  # with the fixes in use only
    inc: Increments
    standstill: Standstill  # where the vehicle stands or is carried
    fixes_n: Array  # (F, 3) m, the fixes in use, in n
    rocking: Array  # (3,) rad, how far the standing vehicle rocks, one sigma by axis

    @property
    def gnss(self) -> Gnss | None:
        """The fixes in use."""
        return self.run.gnss


@dataclass(frozen=True)
class Prepared:
    """A run, or a piece of it, ready to be smoothed."""

    setup: Setup
    sensed: Sensed


def prepare(
    run: Run,
    vehicle: Vehicle,
    *,
    use_gnss: bool,
    outages: Outages,
    interval: float = INTERVAL_S,
    table: dict[str, Correction] | None = None,
) -> Prepared:
    """Increments, standstill, alignment and calibration layout of a run; nodes every `interval` s.

    `table` replaces the vehicle's correction table; rows with zero sd are held, not learnt.
    """
    if run.imu is None:
        raise InputError(f"{run.path}: no gyro and accelerometer columns to smooth")
    gnss = in_use(run, vehicle, use_gnss, outages)
    if not run.sensed[4] and run.odometer is None and gnss is None:
        raise InputError(
            f"{run.path}: no forward accelerometer, no odometer and no fixes in use: nothing "
            "tells the vehicle's speed; record one of them, or use the fixes"
        )
    run = felt_when_level(replace(run, gnss=gnss), vehicle.odometer.mount_b)
    assert run.imu is not None
    inc = increments(run.imu)
    lying = oriented(run, vehicle, inc)
    vehicle, inc = lying.vehicle, lying.inc
    gnss, delay = punctual(gnss, vehicle, inc, run.odometer)
    used = replace(lying.run, gnss=gnss)
    detected = find_standstill(inc, used, gnss, gyro_bias_sd(vehicle))
    alignment = align(used, vehicle, inc, initial_standstill_end(detected.standstills, inc))
    remarks = lying.remarks
    if alignment.source != STATED:  # nothing rests on whose the stated heading is
        remarks = tuple(replace(remark, level=0) for remark in remarks)
    alignment = replace(alignment, remarks=(*remarks, *alignment.remarks, *_on_fixes_alone(run)))
    table = table or correction_table(params(vehicle, two_sided(run, vehicle)))
    noise = inertial_noise(vehicle, run.sensed)
    fixes = fixes_in(alignment.origin, gnss)
    both, bias = two_sided(run, vehicle), alignment.gyro_bias
    weight = weight_at_standstill(inc, detected.at_standstill, alignment.origin)
    layout = calibrations.layout(vehicle, table, gnss, both, bias, delay, weight)
    setup = Setup(vehicle, noise, alignment, table, layout, both, interval, delay)
    if run.odometer is None:
        kept = believable(detected.standstills, *_reckoned_speed(inc, setup))
        detected = replace(detected, at_standstill=within(inc.edge, kept))
    rock = rocking(inc, detected.standstills, float(np.min(noise.gyro)))
    return Prepared(setup, Sensed(used, inc, detected, fixes, rock))


def _on_fixes_alone(run: Run) -> tuple[Remark, ...]:
    """What is to be said of a run whose speed nothing but its fixes tells."""
    if run.sensed[4] or run.odometer is not None:
        return ()
    return (
        Remark(
            "without odometer and forward accelerometer the fixes alone tell the speed: a burst of "
            "wrong ones looks like driving",
            "record an odometer or the accelerometers",
            level=1,
        ),
    )


def weight_at_standstill(inc: Increments, at_standstill: Mask, origin: Origin) -> float:
    """Specific force at standstill over gravity, 1 where it never stands."""
    if not at_standstill.any():
        return 1.0
    force = inc.velocity[at_standstill] / np.diff(inc.edge)[at_standstill, None]
    g = np.linalg.norm(origin.gravity(np.zeros(3)))
    return float(np.linalg.norm(np.median(force, axis=0)) / g)


def fixes_in(origin: Origin, gnss: Gnss | None) -> Array:
    """Fixes in the frame n of an origin, (F, 3) m."""
    if gnss is None:
        return np.zeros((0, 3))
    return origin.local(np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg), gnss.height)


def punctual(
    gnss: Gnss | None, vehicle: Vehicle, inc: Increments, odometer: Odometer | None
) -> tuple[Gnss | None, float]:
    """The fixes with their delay [s], stated or found, taken off their stamps; and that delay."""
    if gnss is None:
        return None, 0.0
    delay = vehicle.gnss.time_offset_s or 0.0
    on_time = replace(gnss, time=gnss.time - delay)
    if vehicle.gnss.time_offset_sd_s > 0:
        more = found_delay(inc, odometer, on_time)
        delay, on_time = delay + more, replace(on_time, time=on_time.time - more)
    return on_time, delay


def inertial_noise(vehicle: Vehicle, sensed: tuple[bool, ...] = EVERY_AXIS) -> InertialNoise:
    """White noise of the vehicle's inertial sensors, SI; where a gyro was not recorded,
    how vehicles rock.
    """
    spec, on = vehicle.imu, np.array(sensed)
    return InertialNoise(
        gyro=np.where(on[:3], spec.gyro_noise_deg_sqrt_h * calibrations.DEG_SQRT_H, ROCKS),
        accel=spec.accel_noise_mg_sqrt_hz * 1e-3 * G_STANDARD,
    )


def gyro_bias_sd(vehicle: Vehicle) -> float:
    """One sigma of a gyro's bias, rad/s."""
    return float(vehicle.imu.gyro_bias_deg_h * calibrations.DEG_H)


def _reckoned_speed(inc: Increments, setup: Setup) -> tuple[Array, Array]:
    """Forward speed from the IMU alone at 1 Hz: times and m/s."""
    nodes = np.searchsorted(inc.edge, np.append(np.arange(inc.edge[0], inc.edge[-1]), np.inf))
    nodes = np.unique(np.minimum(nodes, len(inc.edge) - 1))
    start = setup.alignment.start
    _, _, speed = speed_along(inc, nodes, setup, start.R_nb, start.v_n)
    return inc.edge[nodes], speed


def speed_along(
    inc: Increments, nodes: Index, setup: Setup, R_0: Array, v_0: Array
) -> tuple[Array, Array, Array]:
    """Forward speed (N,) m/s from the IMU alone at edges `nodes`, from attitude and velocity at the
    first; with them, attitude and velocity at the last.
    """
    errors = np.tile(np.append(setup.alignment.gyro_bias, np.zeros(9)), (len(nodes) - 1, 1))
    pre = preintegrate(inc, nodes, errors, InertialNoise(1.0, 1.0))
    R_bm = so3.exp(setup.vehicle.odometer.mount_b)
    R, v, _ = inertial_path(pre, R_0, v_0, setup.alignment.origin, R_bm)
    return R[-1], v[-1], so3.mtv(R @ R_bm, v)[:, 1]


def params(vehicle: Vehicle, two_sided: bool = False) -> VehicleParams:
    """What state recognition must know of the vehicle."""
    body = vehicle.body
    ratio = body.low_gear_ratio or (1.0 if two_sided else LOW_GEAR_RATIO)
    limit = float(np.deg2rad(body.max_turn_deg))
    return VehicleParams(
        vehicle.kind, body.track_gauge, body.contact_length, ratio, limit, two_sided
    )


def two_sided(run: Run, vehicle: Vehicle) -> bool:
    """Whether the vehicle skids to turn and both sides' speeds are recorded."""
    return vehicle.kind == "tracked" and run.sides is not None


def initial_standstill_end(standstills: Array, inc: Increments) -> float:
    """End of an initial standstill, s; 0 when the run begins on the move."""
    if len(standstills) and standstills[0, 0] - inc.edge[0] < BEGINS_S:
        start, end = standstills[0]
        if end - start >= INITIAL_STANDSTILL_S:
            return float(end)
    return 0.0
