"""Which calibrations a run carries, with priors from the vehicle file."""

import numpy as np

from factors.calibration import (
    ACCEL_BIAS,
    ACCEL_SCALE,
    ANTENNA,
    CORNERING,
    DELAY,
    GNSS_DELAY,
    GNSS_OFFSET,
    GYRO_BIAS,
    GYRO_SCALE,
    LEVER,
    MOUNTING,
    SCALE,
    SLOPE_DRIFT,
    TRACK_WIDTH,
    Component,
    Layout,
    forward_of,
    lateral_of,
)
from graphnav.common.earth import G_STANDARD
from graphnav.common.run import Array, Gnss
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.corrections import Correction

DEG_H = np.deg2rad(1) / 3600  # rad/s
DEG_SQRT_H = np.deg2rad(1) / 60  # rad/sqrt(s)
MG = 1e-3 * G_STANDARD  # m/s^2
PPM = 1e-6

SURPRISING = 3.0  # sigma of its prior, beyond which a bias found overrules it
INSTABILITY_S, HOUR_S = 900.0, 3600.0  # s in which biases, and the odometer's scale, wander
CORNERING_SD = 0.01  # s; a car's tyres slip some 0.5 deg at 1 m/s^2 and 10 m/s
SLOPE_DRIFT_SD = 0.1  # 1 deg of slip per 10 deg of slope: tyres 0.6 to 1.5, tracks on soil up to 2
REFERENCE = ("straight_high", "moving")
WIDTH_RATIO, WIDTH_RATIO_SD = 1.5, 0.6  # effective over geometric track width of a skidding vehicle
SEARCHED_SD_S = 0.3  # of a delay sought before the solve
COMMON_SHARE, COMMON_S = 0.3, 300.0  # of a fix's sd that neighbours share, and for how long


def layout(
    vehicle: Vehicle,
    table: dict[str, Correction],
    gnss: Gnss | None,
    two_sided: bool = False,
    gyro_bias: Array | None = None,
    fix_delay: float = 0.0,
    weight: float = 1.0,
) -> Layout:
    """The calibration vector: biases and scale factors of the IMU, the odometer's scale, mounting,
    lever arm and delay, and the ground by state.

    With fixes in use also the antenna's lever arm, their common offset and their delay, which is
    expected to be `fix_delay` s. A `gyro_bias` (3,) rad/s that the alignment has found far outside
    its prior widens it, and so does a `weight`, the force at rest over gravity, that of the
    accelerometers' scale.
    """
    components = [
        *bias_components(vehicle, gyro_bias),
        *scale_components(vehicle, weight),
        *odometer_components(vehicle),
        *ground_components(vehicle, table),
    ]
    if two_sided:
        gauge = vehicle.body.track_gauge
        width = Component(TRACK_WIDTH, _one(WIDTH_RATIO * gauge), _one(WIDTH_RATIO_SD * gauge))
        components.append(width)
    return Layout((*components, *gnss_components(vehicle, gnss, fix_delay)))


def bias_components(
    vehicle: Vehicle, gyro_bias: Array | None = None
) -> tuple[Component, Component]:
    """Gyro and accelerometer bias, as large as the sensors' grade says, or as a `gyro_bias` (3,)
    rad/s found far beyond it.
    """
    spec = vehicle.imu
    gyro, accel = spec.gyro_bias_deg_h * DEG_H, spec.accel_bias_mg * MG
    gyro_walk = _wander(spec.gyro_instability_deg_h * DEG_H, INSTABILITY_S)
    accel_walk = _wander(spec.accel_instability_mg * MG, INSTABILITY_S)
    seen = np.zeros(3) if gyro_bias is None else np.abs(gyro_bias)
    gyro_sd = np.where(seen > SURPRISING * gyro, seen, gyro)
    return (
        Component(GYRO_BIAS, np.zeros(3), gyro_sd, gyro_walk),
        Component(ACCEL_BIAS, np.zeros(3), np.full(3, accel), accel_walk),
    )


def scale_components(vehicle: Vehicle, weight: float = 1.0) -> list[Component]:
    """Scale factors of gyros and accelerometers, those that are not held.

    The force at rest shows one axis only, and not apart from its bias; but where it is beyond both
    (`weight`, over gravity) nothing says that the other axes are better.
    """
    spec, off = vehicle.imu, abs(weight - 1)
    gyro, accel = spec.gyro_scale_ppm * PPM, spec.accel_scale_ppm * PPM
    if off > SURPRISING * np.hypot(accel, spec.accel_bias_mg * 1e-3):
        accel = max(accel, off) if accel > 0 else 0.0
    sds = {GYRO_SCALE: gyro, ACCEL_SCALE: accel}
    return [Component(k, np.zeros(3), np.full(3, sd)) for k, sd in sds.items() if sd > 0]


def odometer_components(vehicle: Vehicle) -> list[Component]:
    """The odometer's scale, which drifts, its mounting, lever arm and delay."""
    spec = vehicle.odometer
    drift = _wander(spec.scale_wander, HOUR_S)
    found = [
        Component(SCALE, np.zeros(1), _one(spec.scale_sd), drift),
        Component(MOUNTING, spec.mount_b[[0, 2]], np.full(2, np.deg2rad(spec.mount_sd_deg))),
        Component(LEVER, spec.lever_b, np.full(3, spec.lever_arm_sd)),
    ]
    if spec.time_offset_sd_s > 0:
        found.append(Component(DELAY, _one(spec.time_offset_s), _one(spec.time_offset_sd_s)))
    return found


def ground_components(vehicle: Vehicle, table: dict[str, Correction]) -> list[Component]:
    """What the ground does in each state of the `table`, on side slopes and to tyres in a bend."""
    found = [Component(SLOPE_DRIFT, np.zeros(1), _one(SLOPE_DRIFT_SD))]
    if vehicle.kind == "wheeled":
        found.append(Component(CORNERING, np.zeros(1), _one(CORNERING_SD)))
    for state, row in table.items():
        # straight ahead in high gear the factor and the scale are one number
        if row.use_odometer and row.factor_sd > 0 and state not in REFERENCE:
            found.append(Component(forward_of(state), _one(row.factor), _one(row.factor_sd)))
    length = vehicle.body.contact_length
    for state, row in table.items():
        if row.kappa_sd > 0:
            prior, sd = row.kappa * length, row.kappa_sd * length
            found.append(Component(lateral_of(state), _one(prior), _one(sd)))
    return found


def gnss_components(vehicle: Vehicle, gnss: Gnss | None, delay: float = 0.0) -> list[Component]:
    """Antenna lever arm, common offset and delay (`delay` s expected), where fixes are in use."""
    if gnss is None:
        return []
    spec = vehicle.gnss
    usual = np.maximum(np.percentile(gnss.sd_enu, 25, axis=0), 1e-3)  # some may not know
    found = [
        Component(ANTENNA, spec.lever_b, np.full(3, spec.lever_arm_sd)),
        Component(GNSS_OFFSET, np.zeros(3), COMMON_SHARE * usual, memory=COMMON_S),
    ]
    if spec.time_offset_sd_s > 0:
        searched = delay != (spec.time_offset_s or 0.0)
        sd = np.hypot(spec.time_offset_sd_s, SEARCHED_SD_S if searched else 0.0)
        found.append(Component(GNSS_DELAY, _one(delay), _one(float(sd))))
    return found


def _wander(by: float, in_s: float) -> float | None:
    """Random walk per sqrt(s) that is 1 sigma `by` after so many s; None where it stays."""
    return by / np.sqrt(in_s) if by > 0 else None


def _one(x: float) -> Array:
    return np.array([x])
