"""Pure inertial navigation against the truth of pyins, and preintegration against GTSAM's own.

pyins makes a drive on the rotating ellipsoid (turns, hills, an engine's 8 Hz) and the exact
integrals a 100 Hz IMU would give; our chain integrates them with nothing to hold it.
"""

from dataclasses import dataclass
from functools import cache

import gtsam
import numpy as np
import pytest
from pyins import earth as pyins_earth
from pyins import sim

from factors import so3
from factors.preintegration import InertialNoise, Preintegrated, preintegrate
from graphnav.common.angles import rotation_of_angles
from graphnav.common.earth import Origin, enu_axes
from graphnav.common.run import Array, Imu
from graphnav.inertial.increments import increments
from graphnav.inertial.reckoning import inertial_path

RATE_HZ = 100
EVERY = 20  # increments (of 50 ms) between nodes
ARCSEC = np.pi / 180 / 3600
SWAP = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])  # forward-right-down to right-forward-up
NOISE = InertialNoise(1e-7, 1e-5)


@dataclass(frozen=True)
class Drive:
    """A noise-free drive: samples, and the truth at their times in n."""

    imu: Imu
    origin: Origin
    R_nb: Array  # (N + 1, 3, 3)
    v_n: Array
    p_n: Array


class LinearGravity(Origin):
    """Our frame with the gravity of pyins, `g_0(lat) (1 - 2 h / a)`."""

    def gravity(self, p_n: Array) -> Array:
        lat, lon, height = self.geodetic(p_n)
        up = enu_axes(lat, lon)[..., 2] @ self.R_en
        return -pyins_earth.gravity(np.rad2deg(lat), height)[..., None] * up


@cache
def drive(seconds: float, finer: int) -> Drive:
    """Bends, hills and a speed of 7 to 13 m/s; roll and pitch shake at 8 Hz, so does the height.

    pyins computes at `finer` times the rate of the IMU.
    """
    t = np.arange(round(seconds * RATE_HZ * finer) + 1) / (RATE_HZ * finer)
    shake = 2 * np.pi * 8 * t
    heading = 30 * np.sin(t / 20) + 0.5 * t + 60 * np.sin(t / 57)
    slope = 4 * np.sin(t / 31)
    roll = 3 * np.sin(t / 17) + 0.02 * np.sin(shake + 1)
    speed = 10 * (1 - np.exp(-t / 5)) + 3 * np.sin(t / 41)
    h, s = np.deg2rad(heading), np.deg2rad(slope)
    up = np.sin(s) * speed + 0.05 * np.sin(shake)
    v_ned = np.stack([speed * np.cos(h) * np.cos(s), speed * np.sin(h) * np.cos(s), -up], -1)
    angles = np.stack([roll, slope + 0.02 * np.sin(shake), heading], -1)
    truth, imu = sim.generate_imu(t, [40.0, 116.0, 60.0], angles, v_ned, sensor_type="increment")

    dt = 1 / RATE_HZ
    mean = imu.to_numpy()[1:].reshape(-1, finer, 6).sum(1) / dt
    end = np.arange(1, len(mean) + 1) * dt
    samples = Imu(end, np.full(len(end), dt), mean[:, :3] @ SWAP.T, mean[:, 3:] @ SWAP.T)
    at = truth.iloc[::finer]
    lat, lon = np.deg2rad(at["lat"].to_numpy()), np.deg2rad(at["lon"].to_numpy())
    height = at["alt"].to_numpy()
    origin = Origin(float(lat[0]), float(lon[0]), float(height[0]))
    p_n = origin.local(lat, lon, height)
    R_nl = so3.transpose(origin.level_axes(p_n))
    R_lb = rotation_of_angles(*np.deg2rad(at[["roll", "pitch", "heading"]].to_numpy().T))
    v_n = so3.mv(R_nl, at[["VE", "VN", "VD"]].to_numpy() * [1, 1, -1])
    return Drive(samples, origin, R_nl @ R_lb, v_n, p_n)


def preintegrated(driven: Drive) -> tuple[Preintegrated, Array]:
    """Intervals of a second, and the sample number at every node."""
    inc = increments(driven.imu)
    last = len(inc.edge) - 1
    nodes = np.unique(np.append(np.arange(0, last, EVERY), last))
    pre = preintegrate(inc, nodes, np.zeros((len(nodes) - 1, 12)), NOISE)
    return pre, np.round(inc.edge[nodes] * RATE_HZ).astype(np.int64)


def error_of(driven: Drive, origin: Origin) -> tuple[Array, Array]:
    """Position error (N, 3) m and attitude error (N, 3) arcsec at nodes a second apart."""
    pre, at = preintegrated(driven)
    start = driven.R_nb[0], driven.v_n[0]
    R, _, p = inertial_path(pre, *start, origin, np.eye(3), held=False)
    return p - driven.p_n[at], so3.log(so3.transpose(R) @ driven.R_nb[at]) / ARCSEC


@pytest.mark.parametrize(
    ("seconds", "finer", "metres", "arcsec"),
    [
        (600, 2, 0.05, 0.2),  # measured 0.015 m, 0.08 arcsec; asked 1 m, 0.5 arcsec
        (4000, 1, 1.0, 0.5),  # measured 0.55 m, 0.18 arcsec
    ],
)
def test_unaided_drive_ends_where_it_truly_did(
    seconds: float, finer: int, metres: float, arcsec: float
) -> None:
    driven = drive(seconds, finer)
    at = driven.origin
    error, angle = error_of(driven, LinearGravity(at.lat, at.lon, at.height))
    assert np.linalg.norm(error[-1]) < metres
    assert np.linalg.norm(angle[-1]) < arcsec


def test_our_gravity_moves_only_the_height() -> None:
    """pyins' gravity is linear in height; ours has NIMA's flattening and rotation terms as well.

    They change the free-air gradient by 0.4 %: 0.75 um/s^2 at 60 m, so 0.2 m of height in 600 s
    (187 m in 4000 s, the unstable vertical channel) and nothing horizontally.
    """
    error, angle = error_of(drive(600, 2), drive(600, 2).origin)
    assert np.hypot(*error[-1, :2]) < 0.05
    assert np.linalg.norm(angle[-1]) < 0.2
    assert error[-1, 2] == pytest.approx(0.213, abs=0.02)


def test_earth_rotation_and_gravity_are_needed() -> None:
    """The same drive with the Earth at rest, and with gravity as at the origin, goes far astray."""
    driven = drive(600, 2)
    at = driven.origin

    class Resting(LinearGravity):
        Omega_n = np.zeros(3)

    class Flat(LinearGravity):
        def gravity(self, p_n: Array) -> Array:
            return super().gravity(np.zeros(3))

    for kind, metres in ((Resting, 5000.0), (Flat, 50.0)):
        error, _ = error_of(driven, kind(at.lat, at.lon, at.height))
        assert np.hypot(*error[-1, :2]) > metres


@pytest.mark.parametrize(
    ("gtsam_class", "rotation", "velocity", "position"),
    [
        # constant rate and force per increment in closed form; position inside an increment: ours
        # carries what the samples say of it
        (gtsam.PreintegratedImuMeasurementsG, 1e-12, 1e-12, 2e-4),
        # GTSAM's default is forward Euler: 4 mm/s a second
        (gtsam.PreintegratedImuMeasurements, 1e-6, 1e-2, 5e-3),
    ],
)
def test_motion_between_nodes_agrees_with_gtsam(
    gtsam_class: type, rotation: float, velocity: float, position: float
) -> None:
    driven = drive(600, 2)
    inc, (pre, _) = increments(driven.imu), preintegrated(driven)
    T = np.diff(inc.edge)
    force = np.linalg.solve(so3.left_jacobian(inc.rotation), inc.velocity[..., None])[..., 0]
    params = gtsam.PreintegrationParams.MakeSharedU(9.8)
    for k in range(5, 600, 25):
        theirs = gtsam_class(params, gtsam.imuBias.ConstantBias())
        for j in range(EVERY * k, EVERY * (k + 1)):
            theirs.integrateMeasurement(force[j] / T[j], inc.rotation[j] / T[j], T[j])
        assert np.linalg.norm(so3.log(pre.dR[k].T @ theirs.deltaRij().matrix())) < rotation
        assert np.linalg.norm(theirs.deltaVij() - pre.dv[k]) < velocity
        assert np.linalg.norm(theirs.deltaPij() - pre.dp[k]) < position
