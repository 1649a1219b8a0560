"""Noise of the IMU against what its grade or data sheet says."""

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from graphnav.batch.doubts import of_kind
from graphnav.common.remark import Remark
from graphnav.common.run import Array
from graphnav.graph.inertial_noise import told_by_residuals
from graphnav.result.solved import Solved

WORSE = 4.0  # times its stated noise that an IMU is told to be
UNHEARD_OF = 500.0  # times: recorded vehicles reach 300 (design.md), so something else is wrong
SHOWN = 10.0  # intervals' worth of residuals that tell a noise


def of_inertial_noise(solved: Solved) -> list[Remark]:
    """An IMU whose noise was found far above what is stated, where its residuals show it."""
    return [
        Remark(
            f"the {sensor} are {times:.0f} times as noisy while {state} as their grade or data "
            "sheet says",
            "state [imu] grade or its noise as it is when driving",
            level=int(times > UNHEARD_OF),
        )
        for sensor, state, times in noise_found(solved)
        if times > WORSE
    ]


def noise_found(solved: Solved) -> list[tuple[str, str, float]]:
    """Gyros and accelerometers: in which state of motion they are noisiest, and how many times as
    noisy as is stated."""
    found, spec = solved.solver.get("imu_noise", {}), solved.vehicle.imu
    said = []
    told = np.array(solved.run.sensed) & told_by_residuals(solved.run.sensed)
    for block, weight in of_kind(solved, kinds.INERTIAL):
        for unit, sensor, rows, stated in (
            ("gyro_deg_sqrt_h", "gyros", slice(0, 3), spec.gyro_noise_deg_sqrt_h),
            ("accel_mg_sqrt_hz", "accelerometers", slice(3, 6), spec.accel_noise_mg_sqrt_hz),
        ):
            kept = np.minimum(weight * block.residual**2, 1.0)[:, rows]
            times = {}
            for state, on in _by_motion(solved, block.time).items():
                shown = (kept[on].sum(axis=0) > SHOWN) & told[rows]
                level = np.array(found.get(state, {}).get(unit, np.zeros(3)))
                times[state] = float(np.max(level * shown)) / stated
            state = max(times, key=times.__getitem__)
            said.append((sensor, state, times[state]))
    return said


def _by_motion(solved: Solved, time: Array) -> dict[str, NDArray[np.bool_]]:
    """Which of some intervals, by their end times (n,) s, ended standing and which driving."""
    start, end = solved.standstills[:, :1], solved.standstills[:, 1:]
    at_standstill = np.asarray(np.any((time > start) & (time <= end + 1e-6), axis=0))
    return {"standing": at_standstill, "driving": ~at_standstill}
