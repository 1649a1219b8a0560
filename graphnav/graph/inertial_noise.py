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
from graphnav.inertial.vibration import scatter

SHEET, VIBRATION = "sheet", "vibration"
STATES = {"standstill": "standing", "driving": "driving"}  # as they are told
SURVIVES = 0.01  # of the scatter, in a sensor that integrates; all of it where one samples
# times the assumed before the residuals have spoken: ten data sheets (design facts), all vibration
HUMBLE = {SHEET: 10.0, VIBRATION: 1 / SURVIVES}


def inertial_noise(
    inc: Increments, nodes: Index, at_standstill: Index, sheet: InertialNoise, scales: Scales
) -> Parts:
    """Squared noise density of gyro and accelerometer in every interval between `nodes` (N,),
    those in `at_standstill` at standstill; rows [theta, v], (N - 1, 6).
    """
    n = len(nodes) - 1
    state = np.where(np.isin(np.arange(n), at_standstill), "standstill", "driving")
    base = np.concatenate([np.full(3, sheet.gyro), np.full(3, sheet.accel)])
    assumed = {
        SHEET: np.broadcast_to(base, (n, 6)),
        VIBRATION: SURVIVES * np.sqrt(scatter(inc, nodes)),
    }
    return parts(kinds.INERTIAL, state, AXES[:6], assumed, scales, begin=HUMBLE)


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
