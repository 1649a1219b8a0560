"""How the vehicle stood at the start: levelling, heading, origin and the first gyro bias.

The graph refines all of it; here only what an iteration needs to begin with, and the priors the
vehicle file states. Tilt gets a loose prior: the accelerometers enter once, through the factors.
"""

from dataclasses import dataclass

import numpy as np

from factors import so3
from factors.initial_state import InitialState
from factors.preintegration import Increments
from graphnav.common.angles import angles_of_rotation
from graphnav.common.earth import Origin
from graphnav.common.errors import InputError
from graphnav.common.remark import Remark
from graphnav.common.run import Array, Run
from graphnav.inertial.heading_evidence import Weighed, weigh
from graphnav.inertial.heading_sources import (
    CURES,
    STATED,
    InitialStandstill,
    Turning,
    evidence,
    reckoned_on_fixes,
)
from graphnav.inertial.levelling import levelled, mean_rate, tilting_bias
from graphnav.inertial.pace import pace
from graphnav.inertial.path_heading import PathHeading
from graphnav.reading.vehicle import Vehicle

LOOSE_TILT, LOOSE_HEADING = np.deg2rad(5.0), np.deg2rad(30.0)
LOOSE_SPEED, LOOSE_POSITION = 30.0, 300.0  # m/s, m
FEW_FIXES = 3
LATE_FIX_S = 30.0  # a first fix later than this leaves the start to what is stated
LEAST_BIAS = np.deg2rad(20.0) / 3600  # rad/s, a driving gyro may be off by at least
SIGNIFICANT = 3.0  # sigma of a rate that is taken for bias
ELSEWHERE_SIGMAS = 5.0  # of a stated position and of where the fixes put the start, together
ANOTHER_PLACE = "correct or leave out [start] lat and lon; another datum or another day?"
NEAR = np.deg2rad(10.0)  # a stated heading further from the agreed one begins no iteration
WORST_SD = np.deg2rad(40.0)  # a heading known worse is not known


@dataclass(frozen=True)
class Alignment:
    """Where and how the run begins."""

    origin: Origin
    start: InitialState  # prior of the first node
    gyro_bias: Array  # (3,) rad/s, first guess
    source: str  # where the heading comes from, in words
    heading_sd: float = LOOSE_HEADING  # rad, of the evidence together
    path: PathHeading | None = None  # the reckoned path held against the fixes
    remarks: tuple[Remark, ...] = ()  # evidence that was outvoted

    @property
    def heading(self) -> float:
        """Of the IMU's forward axis at the start, rad."""
        return float(angles_of_rotation(self.start.R_nb)[2])


def align(run: Run, vehicle: Vehicle, inc: Increments, standstill_until: float) -> Alignment:
    """Align at the first increment edge; `standstill_until` ends the initial one (0: none).

    Raises `InputError` saying what is missing when position or heading cannot be known.
    """
    origin = frame_origin(run, vehicle)
    at_standstill = standstill_until > 0
    bias_sd = np.deg2rad(vehicle.imu.gyro_bias_deg_h) / 3600
    rate = mean_rate(inc, standstill_until) if at_standstill else np.zeros(3)
    speed = pace(run, inc.edge)
    bias = rate if at_standstill else tilting_bias(inc, speed if run.felt else None, bias_sd)
    R_level = levelled(inc, speed, standstill_until, bias)
    start_standstill = (
        _initial_standstill(vehicle, R_level @ rate, standstill_until - inc.edge[0])
        if at_standstill
        else None
    )
    turning = Turning(
        inc, R_level[2], bias, max(start_standstill.sd if start_standstill else bias_sd, LEAST_BIAS)
    )
    path = reckoned_on_fixes(run, turning)
    pieces = evidence(run, vehicle, turning, path, start_standstill, origin)
    if not pieces:
        raise InputError(_unknown(run))
    found = weigh(pieces)
    if found.sd > WORST_SD:
        raise InputError(_unknown(run))
    if path is not None and abs(path.rate) > SIGNIFICANT * path.rate_sd:
        bias = bias + path.rate * R_level[2]
    heading, sd, source = _prior(found, vehicle)
    R_nb = so3.exp(np.array([0.0, 0.0, -heading])) @ R_level
    bias = bias - R_nb.T @ origin.Omega_n if at_standstill else bias
    p_0, p_sd = first_position(run, vehicle, origin, float(inc.edge[0]))
    p_0, p_sd, elsewhere = _by_fixes(p_0, p_sd, run, path, origin)
    start = InitialState(R_nb, np.zeros(3), p_0, np.repeat([LOOSE_TILT, LOOSE_SPEED, p_sd], 3))
    start.sd[2] = sd
    remarks = (*_outvoted(found), *elsewhere, *_biased(bias, bias_sd))
    return Alignment(origin, start, bias, source, found.sd, path, remarks)


def _initial_standstill(vehicle: Vehicle, rate_level: Array, seconds: float) -> InitialStandstill:
    """The mean rate of an initial standstill of some seconds."""
    noise = np.deg2rad(vehicle.imu.gyro_noise_deg_sqrt_h) / 60
    return InitialStandstill(rate_level, float(noise / np.sqrt(max(seconds, 1.0))))


def _prior(found: Weighed, vehicle: Vehicle) -> tuple[float, float, str]:
    """Heading, sigma and source of the first node's prior: what is stated of the IMU, where it
    agrees.

    The other sources act through factors of their own, so their heading begins the iteration only.
    """
    for piece in found.agreeing:
        if piece.source == STATED and abs(piece.apart(found.heading)) < NEAR:
            sd = piece.sd if vehicle.start.heading_of == "imu" else float(LOOSE_HEADING)
            return piece.heading, sd, STATED
    return found.heading, float(LOOSE_HEADING), found.agreeing[0].source


def _outvoted(found: Weighed) -> tuple[Remark, ...]:
    """Evidence that was outvoted, each piece with its cure."""
    best = found.agreeing[0].source
    return tuple(
        Remark(
            f"the heading {piece.source} is wrong by "
            f"{abs(np.rad2deg(piece.apart(found.heading))):.1f} deg: it says "
            f"{np.rad2deg(piece.heading) % 360:.1f} deg at the start, the {best} "
            f"{np.rad2deg(found.heading) % 360:.1f} +- {np.rad2deg(found.sd):.1f}, which is used",
            CURES[piece.source],
        )
        for piece in found.outvoted
    )


def _biased(bias: Array, bias_sd: float) -> tuple[Remark, ...]:
    """A gyro bias that the vehicle file does not allow for."""
    size = float(np.abs(bias).max())
    if size < SIGNIFICANT * bias_sd:
        return ()
    deg_h = np.rad2deg(size) * 3600
    return (
        Remark(
            f"a gyro is off by {deg_h:.3g} deg/h, {size / bias_sd:.0f} of its sigma: followed",
            f"state [imu] gyro_bias_deg_h = {deg_h:.2g} if that is usual",
        ),
    )


def _unknown(run: Run) -> str:
    return (
        f"{run.path}: the heading at the start is unknown (no fixes that move, no heading sensor, "
        "gyro or standstill not good enough to gyrocompass): give [start] heading_deg"
    )


def frame_origin(run: Run, vehicle: Vehicle) -> Origin:
    """The frame's origin: the first fixes, or the stated start."""
    if run.gnss is not None:
        few = slice(0, 10)
        lat, lon = np.median(run.gnss.lat_deg[few]), np.median(run.gnss.lon_deg[few])
        return Origin(np.deg2rad(lat), np.deg2rad(lon), float(np.median(run.gnss.height[few])))
    at = vehicle.start
    if at.lat is None or at.lon is None:
        raise InputError(
            f"{run.path}: no GNSS fix is used and the vehicle file states no start: "
            "give [start] lat, lon, height and heading_deg"
        )
    return Origin(np.deg2rad(at.lat), np.deg2rad(at.lon), at.height or 0.0)


def first_position(run: Run, vehicle: Vehicle, origin: Origin, begin: float) -> tuple[Array, float]:
    """Prior position in n [m] and its sigma at `begin` s: the first fix; where fixes are late, what
    is stated.

    Fixes from the start on make a stated position needless (and may be told in another datum).
    """
    gnss, at = run.gnss, vehicle.start
    wait = np.inf if gnss is None else float(gnss.time[0] - begin)
    if at.lat is not None and at.lon is not None and wait > LATE_FIX_S:
        lat, lon = np.deg2rad(at.lat), np.deg2rad(at.lon)
        height = origin.height if at.height is None else at.height
        known = origin.local(np.asarray(lat), np.asarray(lon), np.asarray(height))
        return known, at.position_sd_m
    assert gnss is not None  # `frame_origin` has refused a run with neither
    few = slice(0, FEW_FIXES)  # the first fixes of all are the worst
    fixes = origin.local(
        np.deg2rad(gnss.lat_deg[few]), np.deg2rad(gnss.lon_deg[few]), gnss.height[few]
    )
    return np.median(fixes, axis=0), LOOSE_POSITION + LOOSE_SPEED * max(wait, 0.0)


def _by_fixes(
    p_0: Array, sd: float, run: Run, path: PathHeading | None, origin: Origin
) -> tuple[Array, float, tuple[Remark, ...]]:
    """The first position, or where fixes and path put it when they contradict what is stated."""
    gnss = run.gnss
    if gnss is None or path is None or sd >= LOOSE_POSITION:
        return p_0, sd, ()
    fix = [gnss.lat_deg, gnss.lon_deg, gnss.height]
    lat, lon, height = (column[len(column) // 2] for column in fix)
    middle = origin.local(np.deg2rad(lat), np.deg2rad(lon), np.asarray(height))
    there = np.array([middle[0] + path.begin.real, middle[1] + path.begin.imag, gnss.height[0]])
    there[2] -= origin.height
    away = float(np.hypot(*(p_0 - there)[:2]))
    if away < ELSEWHERE_SIGMAS * np.hypot(sd, path.begin_sd):
        return p_0, sd, ()
    said = Remark(
        f"[start] is {away:.0f} m from where the fixes and the path to them put the start "
        f"(+- {path.begin_sd:.0f} m): not used",
        ANOTHER_PLACE,
        level=1,
    )
    return there, LOOSE_POSITION, (said,)
