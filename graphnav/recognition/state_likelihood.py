"""What the data of one moment say about the motion state: log likelihoods, no memory.

Four independent witnesses, in the order of the functions below:

- speed: the inertial speed `v_y` (A2), backed by `a_c / phi_dot` (A4), against the odometer
  corrected as the state would have it (A6 and the table of corrections);
- radius: `rho = v / phi_dot` (A1) against the state's band (A8-A15);
- rest and size of the heading change: standing, and A16;
- increments: the accelerometer's speed change against that of the corrected odometer, within a
  state or across a change of state. It knows nothing of absolute speed, so a timeline that has
  been believed once cannot talk it round.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from graphnav.common.run import Array
from graphnav.recognition.corrections import Correction, VehicleParams

R_II = 2.88  # B; theoretical arc radius (A12)
R_MAX = 50.0  # B; straighter than this is straight (A6); separated turns reach 20-30 B
R_ENDLESS = 1000.0  # B; radii are capped here
R_PIVOT = 0.25  # B; half the theoretical pivot radius (A8)
GROUND_SPREAD = 0.15  # of the radius: soil against concrete, 5-15 %
WEAVE = 0.005  # rad/s of steering about a straight line, not a turn
CORRELATION = 0.6  # s; evidence of neighbouring steps counts once per this time
OUTLIER = -6.0  # log likelihood ratio at which a disagreeing witness is no longer believed
TOP_SPEED = 25.0  # m/s; a moving odometer may show anything up to it
NO_EVIDENCE = 1e3  # m/s, sd that stands for "not known"
INCREMENT_SD = 0.06  # m/s; tilt and vibration over the window
HALF_WINDOW = 0.6  # s; increments span twice this, a gear change takes about 0.8 s


@dataclass(frozen=True)
class Moments:
    """Smoothed kinematics at the model's steps, forward positive whatever the gear; all (T,)."""

    step: float  # s
    speed: Array  # m/s, inertial, A2 fused with A4
    sd_speed: Array  # m/s
    correlation: Array  # s over which its error persists
    odometer: Array  # m/s, nominal; NaN where none
    yaw_rate: Array  # rad/s, magnitude
    turned: Array  # rad, magnitude of the heading change in 1 s
    at_standstill: NDArray[np.bool_]
    odometer_before: Array  # m/s, HALF_WINDOW earlier
    odometer_after: Array
    yaw_rate_before: Array  # rad/s, magnitude
    yaw_rate_after: Array
    gained: Array  # m/s, accelerometer's speed change between the two; NaN where unknown
    sd_change: Array  # m/s, noise of the odometer's change between the two: pulses, stamps, slip


@dataclass(frozen=True)
class StateModel:
    """How a state looks: radius band in units of the gauge and how loosely its factor holds."""

    correction: Correction
    nearest: float  # B, lower end of the band of |rho|
    farthest: float  # B
    spread: float  # 1 sigma of v_y / v_o about its factor, relative
    fastest: float  # m/s of v_o, above which the state is not driven
    largest_turn: float  # rad in one filter period of 1 s, beyond which it is `turn_large` (A16)


# nearest and farthest |rho| [B], spread of v_y / v_o, fastest v_o [m/s]
BANDS: dict[str, tuple[float, float, float, float]] = {
    "straight_high": (R_MAX, R_ENDLESS, 0.05, 25.0),
    "straight_low": (R_MAX, R_ENDLESS, 0.06, 15.0),
    "stop": (R_MAX, R_ENDLESS, 0.0, 25.0),
    # A12-A14; the open band below 1.549 R_II is arc, too, and soil may widen it beyond 2 R_II
    "turn_arc": (R_II, 2.4 * R_II, 0.10, 15.0),
    "turn_pivot": (R_PIVOT, R_II, 0.25, 6.0),  # A8-A11
    "turn_separated": (2.0 * R_II, R_MAX, 0.06, 20.0),  # A15
    # table 1 has no low arc: whatever is no low pivot is a low separated turn
    "turn_separated_low": (R_II, R_MAX, 0.08, 12.0),
    "turn_pivot_low": (R_PIVOT, R_II, 0.25, 6.0),
    "turn_large": (R_PIVOT, R_ENDLESS, 1.0, 25.0),  # A16
    "moving": (R_PIVOT, R_ENDLESS, 0.10, 60.0),
}


def state_models(vehicle: VehicleParams, table: dict[str, Correction]) -> tuple[StateModel, ...]:
    """The states this vehicle can be in; low ones only where the gear ratio tells them apart."""
    return tuple(
        StateModel(row, *BANDS[row.state], vehicle.max_turn)
        for row in table.values()
        if vehicle.has_low_gear or not row.low_gear
    )


def step_likelihood(
    moments: Moments, models: tuple[StateModel, ...], increments: Array, gauge: float
) -> Array:
    """Log likelihood of each step's data in each state, (T, S), tempered for correlation.

    `increments` (T, S, S) as of `increment_likelihood`, `gauge` B in m. Sources: A1-A6, A8-A16.
    """
    once = np.minimum(1.0, moments.step / CORRELATION)
    rarer = np.minimum(once, moments.step / moments.correlation)
    per_state = [
        rarer * _speed(moments, model) + once * _looks(moments, model, gauge) for model in models
    ]
    same_state: Array = np.einsum("tii->ti", increments)
    same_state = same_state * min(1.0, moments.step / (2 * HALF_WINDOW))  # windows overlap
    total: Array = np.column_stack(per_state) + same_state
    return total


def _looks(moments: Moments, model: StateModel, gauge: float) -> Array:
    """All witnesses but the speeds: what the odometer reads, radius, rest and size of the turn."""
    return _odometer(moments, model) + _radius(moments, model, gauge) + _standstill(moments, model)


def _gaussian(error: Array, sd: Array) -> Array:
    return -0.5 * (error / sd) ** 2 - np.log(sd)


def _predicted_speed(model: StateModel, odometer: Array, yaw_rate: Array) -> tuple[Array, Array]:
    """Forward speed the odometer would mean in this state and its sd, m/s."""
    speed = np.maximum(model.correction.forward(odometer, yaw_rate), 0.0)
    return speed, np.hypot(model.spread * speed, 0.05)


def _speed(moments: Moments, model: StateModel) -> Array:
    """Inertial speed against the odometer as this state would correct it."""
    if model.correction.state == "turn_large":
        return np.full(len(moments.speed), OUTLIER / 2)
    predicted, spread = _predicted_speed(model, moments.odometer, moments.yaw_rate)
    floor = OUTLIER
    if model.correction.state == "stop":  # whatever the odometer says
        predicted, spread, floor = (
            np.zeros_like(predicted),
            np.full_like(spread, 0.05),
            4 * OUTLIER,
        )
    sd = np.hypot(moments.sd_speed, np.nan_to_num(spread))
    error = moments.speed - predicted
    known = np.isfinite(error)
    match = np.logaddexp(_gaussian(np.where(known, error, 0.0), sd), floor - np.log(sd))
    return np.where(known, match, -np.log(TOP_SPEED))


def _odometer(moments: Moments, model: StateModel) -> Array:
    """Density of the odometer's own reading: zero at standstill, else below the state's limit."""
    if model.correction.state == "stop":
        density = _gaussian(moments.odometer, np.full_like(moments.odometer, 0.06))
        return np.nan_to_num(np.maximum(density, 4 * OUTLIER))
    excess = np.maximum(moments.odometer - model.fastest, 0.0)
    too_fast = np.maximum(-0.5 * (excess / (0.1 * model.fastest)) ** 2, 2 * OUTLIER)
    at_speed: Array = too_fast - np.log(TOP_SPEED)  # no state gains by being a slow one
    return np.nan_to_num(at_speed)


def _radius(moments: Moments, model: StateModel, gauge: float) -> Array:
    """Density of log(|rho| / B): uniform over the state's band, blurred by ground and speed."""
    odometer, spread = _predicted_speed(model, moments.odometer, moments.yaw_rate)
    known = ~np.isnan(odometer) & (model.correction.state != "turn_large")
    weight_odometer = np.where(known, 1.0 / spread**2, 0.0)
    weight_inertial = 1.0 / moments.sd_speed**2
    weight = weight_odometer + weight_inertial
    speed = (
        weight_inertial * moments.speed + weight_odometer * np.where(known, odometer, 0.0)
    ) / weight
    speed = np.maximum(speed, 0.05)
    blur = np.hypot(GROUND_SPREAD, np.minimum(1.0 / np.sqrt(weight) / speed, 2.0))
    turning = np.maximum(moments.yaw_rate - WEAVE, speed / (R_ENDLESS * gauge))
    place = np.log(speed / turning / gauge)
    steady = _share_inside(place, model.nearest, model.farthest, blur)
    if not model.correction.state.startswith("turn"):
        density: Array = np.log(steady + np.exp(2 * OUTLIER))
        return density
    # a turn that begins or ends passes through every larger radius on its way
    ramp = np.abs(moments.yaw_rate_after - moments.yaw_rate_before) / (
        moments.yaw_rate_after + moments.yaw_rate_before + WEAVE
    )
    passing = _share_inside(place, model.nearest, max(R_MAX, model.farthest), blur)
    density = np.log((1.0 - ramp) * steady + ramp * passing + np.exp(2 * OUTLIER))
    return density


def _share_inside(place: Array, nearest: float, farthest: float, blur: Array) -> Array:
    """Density at `place` = log(|rho| / B) of a uniform band blurred by `blur`."""
    low, high = np.log(nearest), np.log(farthest)
    edge = np.inf if farthest == R_ENDLESS else high  # the cap is no upper edge
    inside: Array = (ndtr((place - low) / blur) - ndtr((place - edge) / blur)) / (high - low)
    return inside


def _standstill(moments: Moments, model: StateModel) -> Array:
    """Zero-velocity detector, and the heading change of A16 that overrules every other state."""
    beyond = (moments.turned - model.largest_turn) / (0.1 * model.largest_turn)
    is_large = model.correction.state == "turn_large"
    size: Array = np.maximum(log_ndtr(beyond if is_large else -beyond), 4 * OUTLIER)
    if model.correction.state != "stop":
        return size
    turning = -0.5 * (np.maximum(moments.yaw_rate - WEAVE, 0.0) / 0.01) ** 2
    size = size + np.maximum(turning, 4 * OUTLIER) + np.where(moments.at_standstill, -OUTLIER, 0.0)
    return size


def increment_likelihood(moments: Moments, models: tuple[StateModel, ...], gauge: float) -> Array:
    """Log likelihood of the speed change around each step, were it i before and j after, (T, S, S).

    A gear change moves `v_o / v_y` by 1.42 within a second while the accelerometer sees nothing of
    it; inside a state both see the same change in the ratio of its factor. Zero where unknown.
    """
    before = [
        _predicted_speed(m, moments.odometer_before, moments.yaw_rate_before)[0] for m in models
    ]
    after = [_predicted_speed(m, moments.odometer_after, moments.yaw_rate_after)[0] for m in models]
    spread = np.array([m.spread for m in models])
    start, end = np.column_stack(before), np.column_stack(after)
    value = end[:, None, :] - start[:, :, None]
    value -= moments.gained[:, None, None]
    value *= value
    # ground and odometer scale are common to both states: half the spread is shared
    variance = 0.25 * (spread * start)[:, :, None] ** 2 + 0.25 * (spread * end)[:, None, :] ** 2
    np.einsum("tii->ti", variance)[:] = (spread * (end - start)) ** 2
    # while a turn begins or ends the faster track gains on the middle as its factor allows
    swing = 0.5 * gauge * (moments.yaw_rate_after - moments.yaw_rate_before)
    variance += (swing**2 + INCREMENT_SD**2)[:, None, None]
    # a factor below 1 makes the odometer's noise smaller, which must not speak for its state
    square = np.array([m.correction.factor for m in models]) ** 2
    variance += 0.5 * (moments.sd_change**2)[:, None, None] * (square[:, None] + square)
    value /= -2 * variance
    np.maximum(value, 3 * OUTLIER, out=value)
    return np.nan_to_num(value, copy=False, nan=0.0)


def change_likelihood(
    moments: Moments, models: tuple[StateModel, ...], increments: Array, gauge: float
) -> Array:
    """What `increment_likelihood` says for a change i -> j, (T, S, S).

    Measured against the best explanation without a change of gear, so that only a gear change is
    ever credited, and only where neither staying nor turning accounts for the data: another state
    only as far as the motion looks like it.
    """
    low = np.array([model.correction.low_gear for model in models])
    same_gear = low[:, None] == low[None, :]
    looks = np.column_stack([_looks(moments, model, gauge) for model in models])
    unlike = (looks - looks.max(axis=1, keepdims=True))[:, None, :]
    best = np.where(same_gear, increments + unlike, -np.inf).max(axis=2, keepdims=True)
    return np.where(same_gear, 0.0, increments - np.maximum(best, 3 * OUTLIER))
