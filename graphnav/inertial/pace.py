"""How fast the vehicle drives: by the odometer or, without one, by the fixes."""

import numpy as np

from graphnav.common.earth import Origin
from graphnav.common.run import Array, Gnss, Run
from graphnav.inertial.angle_line import Complex
from graphnav.inertial.odometer_steps import speed_at

HALF_S = 0.25  # half the baseline over which the odometer is differenced
CLEAR = 3.0  # m a fix's span must have by metre of its sigma
SPAN_S = (0.5, 8.0)  # over which the fixes are differenced


def pace(run: Run, at: Array) -> Array | None:
    """Speed at times `at` (n,) s, m/s; None where neither odometer nor fixes tell one."""
    if run.odometer is not None:
        return speed_at(run.odometer, at, HALF_S)
    gnss = run.gnss
    if gnss is None or len(gnss.time) < 2:
        return None
    fixes = east_north(gnss)
    span = np.clip(CLEAR * float(np.median(gnss.sd_enu[:, :2])), *SPAN_S)
    begin, end = (
        np.interp(at + half, gnss.time, fixes.real)
        + 1j * np.interp(at + half, gnss.time, fixes.imag)
        for half in (-span / 2, span / 2)
    )
    return np.asarray(np.abs(end - begin) / span)


def east_north(gnss: Gnss) -> Complex:
    """East + i north of the fixes from the one in the middle of the run, (F,) m."""
    lat, lon, height = np.deg2rad(gnss.lat_deg), np.deg2rad(gnss.lon_deg), gnss.height
    k = len(lat) // 2
    p_n = Origin(float(lat[k]), float(lon[k]), float(height[k])).local(lat, lon, height)
    return np.asarray(p_n[:, 0] + 1j * p_n[:, 1])
