"""What each source says of the heading at the start: stated, sensed, the Earth's turn, the path."""

from dataclasses import dataclass, replace

import numpy as np

from factors.preintegration import Increments
from graphnav.common.earth import Origin
from graphnav.common.run import Array, Run
from graphnav.inertial.angle_line import angle_line
from graphnav.inertial.heading_evidence import Evidence
from graphnav.inertial.pace import east_north, pace
from graphnav.inertial.path_heading import STEP_S, PathHeading, Reckoned, path_heading
from graphnav.reading.vehicle import Vehicle

COMPASS_SD = np.deg2rad(5.0)  # a gyrocompass worse than this is not used
EARTH_SIGMAS = 4.0  # by which a rate at standstill may differ from the Earth's
SENSED_SD = np.deg2rad(1.0)  # of a sample of the heading sensor
SENSED_S = 600.0  # of the run over which the gyro carries the sensed headings to the start
# chance of being grossly wrong: people turn the sign or mean another axis; sensors sit askew; a
# path of many slots is what all sensors say together
STATED_GROSS, SENSED_GROSS, COMPASS_GROSS, PATH_GROSS = 0.02, 0.02, 1e-3, 1e-6
CARELESS = 0.4  # chance that what people state or mount is wrong by some degrees
STATED, SENSED, COMPASS, PATH = (
    "stated in [start]", "external heading", "gyrocompass", "satellite course",
)  # fmt: skip
CURES = {
    STATED: "correct or leave out [start] heading_deg",
    SENSED: "check what the heading sensor's zero points to, or leave its column out",
    COMPASS: "state the gyros' true [imu] grade or gyro_bias_deg_h",
    PATH: "check the fixes, and the direction of the odometer",
}


@dataclass(frozen=True)
class Turning:
    """The gyro about the vertical of the start."""

    inc: Increments
    up_b: Array  # (3,) the vertical in the body at the start
    bias: Array  # (3,) rad/s, taken off
    bias_sd: float  # rad/s, of what is left

    @property
    def angle(self) -> Array:
        """Turned to the left since the start at every edge, (M + 1,) rad."""
        dt = np.diff(self.inc.edge)[:, None]
        turn = (self.inc.rotation - self.bias * dt) @ self.up_b
        return np.concatenate([[0.0], np.cumsum(turn)])


@dataclass(frozen=True)
class InitialStandstill:
    """The gyro while the vehicle stood at the start."""

    rate_level: Array  # (3,) rad/s, in the levelled axes of heading zero
    sd: float  # rad/s, what its noise leaves unknown


def reckoned_on_fixes(run: Run, turning: Turning) -> PathHeading | None:
    """The path reckoned with the odometer, or at the fixes' own pace, held against the fixes."""
    gnss = run.gnss
    if gnss is None or len(gnss.time) < 2:
        return None
    fixes = east_north(gnss)
    edge = turning.inc.edge
    time = np.arange(edge[0], edge[-1], STEP_S)
    sd = np.max(gnss.sd_enu[:, :2], axis=1)
    speed = pace(run, time)
    assert speed is not None
    reckoned = Reckoned(time, speed, np.interp(time, edge, turning.angle))
    return path_heading(reckoned, fixes, gnss.time, sd, turning.bias_sd)


def evidence(
    run: Run,
    vehicle: Vehicle,
    turning: Turning,
    path: PathHeading | None,
    standstill: InitialStandstill | None,
    origin: Origin,
) -> list[Evidence]:
    """Every source's heading of the IMU's forward axis at the start."""
    mounted, mount_sd = vehicle.odometer.mount_b[2], np.deg2rad(vehicle.odometer.mount_sd_deg)
    stated, found = vehicle.start, list[Evidence]()

    def of_imu(piece: Evidence) -> Evidence:
        """The vehicle's heading told of the IMU's forward axis."""
        sd = float(np.hypot(piece.sd, mount_sd))
        return replace(piece, heading=piece.heading + float(mounted), sd=sd)

    if stated.heading_deg is not None:
        heading, sd = np.deg2rad([stated.heading_deg, stated.heading_sd_deg])
        piece = Evidence(float(heading), float(sd), STATED, STATED_GROSS, CARELESS)
        found.append(of_imu(piece) if stated.heading_of == "vehicle" else piece)
    if run.heading is not None:
        piece = _sensed(run, turning, path)
        found.append(of_imu(piece) if vehicle.heading.heading_of == "vehicle" else piece)
    if path is not None:
        gross = max(PATH_GROSS, float(np.exp(-len(path.time))))
        found.append(of_imu(Evidence(path.heading, path.sd, PATH, gross)))
    # which way is up, the Earth's turn does not say
    if standstill is not None and all(run.sensed):
        found += _compassed(vehicle, standstill, origin)
    return found


def _compassed(vehicle: Vehicle, standstill: InitialStandstill, origin: Origin) -> list[Evidence]:
    """The Earth's rotation at standstill points north, where the gyros read it and nothing else."""
    sd = float(np.hypot(np.deg2rad(vehicle.imu.gyro_bias_deg_h) / 3600, standstill.sd))
    _, north, up = origin.Omega_n.tolist()
    x, y, z = standstill.rate_level.tolist()
    off = max(abs(np.hypot(x, y) - north), abs(z - up))
    if sd / north > COMPASS_SD or off > EARTH_SIGMAS * sd:
        return []
    return [Evidence(float(np.arctan2(-x, y)), sd / north, COMPASS, COMPASS_GROSS)]


def _sensed(run: Run, turning: Turning, path: PathHeading | None) -> Evidence:
    """All headings of the sensor, carried to the start by the gyro."""
    assert run.heading is not None
    time = run.heading.time - turning.inc.edge[0]
    rate = path.rate if path is not None else 0.0
    on = time <= time[0] + SENSED_S
    carried = np.interp(run.heading.time, turning.inc.edge, turning.angle) - rate * time
    phasor = np.exp(1j * (run.heading.heading + carried))[on]
    weight = np.full(int(on.sum()), SENSED_SD**-2.0)
    line = angle_line(phasor, time[on], weight, turning.bias_sd)
    # samples share what the sensor's mounting is off by
    return Evidence(line.angle, float(np.hypot(line.sd, SENSED_SD)), SENSED, SENSED_GROSS, CARELESS)
