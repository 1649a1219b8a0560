"""What the IMU's noise is a sum of: its data sheet's and the vibration that survives in the sums.

Standing and driving are found apart (`noise.py`). Vibration that a true mean averages away keeps
nothing of the samples' scatter (`inertial/vibration.py`), vibration that was sampled keeps it all.
"""

import numpy as np

from factors import kinds
from factors.block import Index
from factors.inertial import AXES
from factors.preintegration import Increments, InertialNoise
from graphnav.common.run import Array
from graphnav.graph.calibrations import DEG_SQRT_H, MG
from graphnav.graph.noise import Parts, Scales, parts
from graphnav.graph.preparation import Sensed
from graphnav.inertial.standstill_evidence import Mask
from graphnav.inertial.vibration import scatter

SHEET, VIBRATION = "sheet", "vibration"
STATES = {"standstill": "standing", "driving": "driving"}  # as they are told
SURVIVES = 0.01  # of the scatter, in a sensor that integrates; all of it where one samples
UNFELT = 1e3  # m/s/sqrt(s) of an accelerometer that was not recorded: it says nothing
MISSED = 0.6  # m/s/sqrt(s) that its stand-in misses: 5 % of slope, and what the odometer does
# times the assumed before the residuals have spoken: ten data sheets (design facts), all vibration
HUMBLE = {SHEET: 10.0, VIBRATION: 1 / SURVIVES}


def inertial_noise(
    sensed: Sensed, nodes: Index, at_standstill: Index, sheet: InertialNoise, scales: Scales
) -> Parts:
    """Squared noise density of gyro and accelerometer in every interval between `nodes` (N,),
    those in `at_standstill` at standstill; rows [theta, v], (N - 1, 6).
    """
    n = len(nodes) - 1
    state = np.where(np.isin(np.arange(n), at_standstill), "standstill", "driving")
    base = np.concatenate([np.full(3, sheet.gyro), np.full(3, sheet.accel)])
    assumed = {
        SHEET: np.broadcast_to(base, (n, 6)),
        VIBRATION: SURVIVES * np.sqrt(scatter(sensed.inc, nodes)),
    }
    learnt = told_by_residuals(sensed.run.sensed)
    humble = sum((HUMBLE[part] * sigma) ** 2 for part, sigma in assumed.items())
    fixed = np.sqrt(humble) * ~learnt
    fixed[:, 3:] = np.where(learnt[3:], _leaked(sensed.inc, nodes, ~learnt[3:]), UNFELT)
    assumed = {part: sigma * learnt for part, sigma in assumed.items()}
    return parts(kinds.INERTIAL, state, AXES[:6], assumed, scales, fixed=fixed, begin=HUMBLE)


def _leaked(inc: Increments, nodes: Index, unfelt: Mask) -> Array:
    """Density (N - 1, 3) of what stand-ins for `unfelt` axes miss in the other axes of the first
    node, as an interval turns into them; m/s/sqrt(s).
    """
    turned = np.abs(np.add.reduceat(inc.rotation, nodes[:-1], axis=0))
    x, y, z = turned.T / np.sqrt(3)  # from none to all of it
    share = np.stack([0 * x, z, y, z, 0 * x, x, y, x, 0 * x], -1).reshape(-1, 3, 3)
    return np.asarray(MISSED * np.sqrt(np.sum((share * unfelt) ** 2, axis=2)))


def told_by_residuals(sensed: tuple[bool, ...]) -> Mask:
    """Whose noise the residuals tell, of gyro and accelerometer (6,), by what was `sensed`.

    Where no accelerometer was, nothing speaks against a gyro about a level axis: the ground may
    rock as it says. Pitch (x) is held by what is felt ahead (y), and roll the other way round.
    """
    felt = np.array(sensed[3:])
    return np.concatenate([felt[[1, 0]], [True], felt])


def density(noise: Parts) -> InertialNoise:
    """The noise of every interval."""
    return InertialNoise(noise.sigma[:, :3], noise.sigma[:, 3:])


def as_summary(noise: Parts) -> dict[str, dict[str, list[float]]]:
    """Root mean square density by state and axis, in the units of the vehicle file."""

    def level(density: Array, unit: float) -> list[float]:
        return [float(f"{x:.4g}") for x in np.sqrt(np.mean(density**2, axis=0)) / unit]

    found = {}
    for state, name in STATES.items():
        on = noise.state == state
        if on.any():
            found[name] = {
                "gyro_deg_sqrt_h": level(noise.sigma[on, :3], DEG_SQRT_H),
                "accel_mg_sqrt_hz": level(noise.sigma[on, 3:], MG),
            }
    return found
