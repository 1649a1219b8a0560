"""Motion of the vehicle point on a uniform grid, as state recognition needs it (A1-A5)."""

import numpy as np

from factors import so3
from factors.calibration import DELAY, LEVER, MOUNTING
from factors.estimate import Estimate
from factors.preintegration import corrected
from graphnav.graph.densify import Path
from graphnav.graph.nodes import Nodes
from graphnav.graph.preparation import Prepared
from graphnav.inertial.odometer_steps import speed_at
from graphnav.recognition.motion_states import Kinematics

RATE_HZ = 10.0
SPEED_SD = 0.1  # m/s, smoothed inertial speed while the ground is still being learnt


def kinematics(prep: Prepared, path: Path, estimate: Estimate, nodes: Nodes | None) -> Kinematics:
    """Kinematics of the odometer point from a path at increment edges.

    Without `nodes` the path is dead reckoning on the odometer itself and its speed says nothing.
    """
    t = np.arange(path.time[0], path.time[-1], 1 / RATE_HZ)
    c = np.median(estimate.calibration, 0)
    layout = prep.setup.layout
    lever = c[layout.slices[LEVER]]
    tilt = c[layout.slices[MOUNTING]]
    R_mb = so3.exp(np.array([tilt[0], prep.setup.vehicle.odometer.mount_b[1], tilt[1]])).T
    dt = np.diff(path.time)[:, None]
    inc = corrected(prep.sensed.inc, layout.imu_errors_of(c))
    R, Omega = path.R_nb[:-1], prep.setup.alignment.origin.Omega_n
    rate_b = inc.rotation / dt - so3.mtv(R, np.broadcast_to(Omega, (len(R), 3)))
    g_n = prep.setup.alignment.origin.gravity(path.p_n[:1])
    force_m = (inc.velocity / dt + so3.mtv(R, np.broadcast_to(g_n, (len(R), 3)))) @ R_mb.T
    v_m = (so3.mtv(R, path.v_n[:-1]) + so3.cross(rate_b, lever)) @ R_mb.T
    mid = 0.5 * (path.time[1:] + path.time[:-1])

    assert prep.sensed.run.odometer is not None
    late = layout.find(DELAY)
    delay = 0.0 if late is None else c[late]
    sd = np.full(len(t), np.inf if nodes is None else SPEED_SD)
    return Kinematics(
        time=t,
        v_y=np.interp(t, path.time[:-1], v_m[:, 1]),
        sd_v_y=sd,
        v_o=speed_at(prep.sensed.run.odometer, t + delay),
        yaw_rate=np.interp(t, mid, rate_b @ R_mb[2]),
        a_c=np.interp(t, mid, force_m[:, 0]),
        at_standstill=np.interp(t, mid, prep.sensed.standstill.at_standstill.astype(np.float64))
        > 0.5,
        accel_y=np.interp(t, mid, force_m[:, 1]),
    )
