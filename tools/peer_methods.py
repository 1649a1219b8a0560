"""The same run by others: ten lines of dead reckoning, plain GTSAM, the Kalman filter of pyins.

Each gives a table: time lat lon height and, where it claims any, sd_e sd_n.
"""

from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from pandas import DataFrame, Index
from pyins import filters, measurements, strapdown
from pyins.inertial_sensor import EstimationModel
from pyins.util import TRAJECTORY_COLS

from graphnav.common.angles import angles_of_rotation
from graphnav.common.earth import Origin
from graphnav.common.run import Array, Run
from graphnav.graph.preparation import Prepared
from graphnav.inertial.odometer_steps import speed_at

FRD = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])  # of right-forward-up; its own inverse
VELOCITY_SD, FIX_DOUBT = 0.3, 3.0  # m/s, times the sigma stated: what suits pyins
DEG = np.pi / 180
MG = 9.80665e-3  # m/s^2
LLA = ["lat", "lon", "alt"]
STANDSTILL_SPEED, LEAST_STANDSTILL = 1e-3, 200  # m/s; samples from which a bias is taken
HUMBLE = 10.0  # times the data sheet: what users of GTSAM write after the first try
BIAS_WALK = (1e-3, 1e-5)  # m/s^2, rad/s per sqrt(s), accelerometer and gyro
SAME_S = 1e-6  # s, a fix and its node
MARGINALS = 200  # nodes whose covariance is asked for


def naive(run: Run, start_heading: float, origin: Origin) -> DataFrame:
    """Mean wheel speed along the integrated z gyro, less its median at rest; heading in rad.

    The path begins at the origin and without height.
    """
    assert run.imu is not None and run.odometer is not None
    time, rate = run.imu.time, run.imu.gyro[:, 2]
    speed = np.interp(time, run.odometer.time, run.odometer.speed)
    rest = np.abs(speed) < STANDSTILL_SPEED
    bias = float(np.median(rate[rest])) if rest.sum() > LEAST_STANDSTILL else 0.0
    step = np.diff(time, prepend=time[0])
    heading = start_heading - np.cumsum((rate - bias) * step)
    way = speed * step
    p_n = np.stack(
        [np.cumsum(way * np.sin(heading)), np.cumsum(way * np.cos(heading)), 0 * way], -1
    )
    return positions(time + run.clock_start, p_n, origin)


def plain_gtsam(prep: Prepared) -> DataFrame:
    """ImuFactor and GPSFactor, a node at every second and fix; no wheels, no robustness."""
    gnss, alignment = prep.sensed.gnss, prep.setup.alignment
    assert prep.sensed.run.imu is not None and gnss is not None
    node_time = _node_times(prep.sensed.run.imu.time, gnss.time)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), alignment.gyro_bias)
    start = alignment.start
    state = gtsam.NavState(gtsam.Rot3(start.R_nb), start.p_n, start.v_n)
    _prior(graph, prep, state, bias)
    steps = _preintegrated(prep, node_time, bias)
    for k, at in enumerate(node_time):
        if k:
            graph.add(gtsam.ImuFactor(X(k - 1), V(k - 1), X(k), V(k), B(k - 1), steps[k - 1]))
            graph.add(_bias_walk(k, at - node_time[k - 1]))
            state = steps[k - 1].predict(state, bias)
        for fix in np.flatnonzero(np.abs(gnss.time - at) < SAME_S):
            place = prep.sensed.fixes_n[fix]
            noise = gtsam.noiseModel.Diagonal.Sigmas(gnss.sd_enu[fix])
            graph.add(gtsam.GPSFactor(X(k), place, noise))
            state = gtsam.NavState(state.attitude(), place, state.velocity())
        values.insert(X(k), state.pose())
        values.insert(V(k), state.velocity())
        values.insert(B(k), bias)
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    p_n = np.array([solved.atPose3(X(k)).translation() for k in range(len(node_time))])
    found = positions(node_time + prep.sensed.run.clock_start, p_n, alignment.origin)
    return found.assign(**_deviations(graph, solved, len(node_time)))


def _node_times(imu_time: Array, fix_time: Array) -> Array:
    """Every fix, and every second that none is near, within the IMU's samples."""
    fixes = fix_time[(fix_time > imu_time[0]) & (fix_time < imu_time[-1])]
    seconds = np.arange(imu_time[0], imu_time[-1], 1.0)
    apart = np.abs(seconds[:, None] - fixes).min(1, initial=np.inf)
    return np.unique(np.concatenate([seconds[:1], seconds[apart > 0.5], fixes]))


def _prior(
    graph: gtsam.NonlinearFactorGraph,
    prep: Prepared,
    state: gtsam.NavState,
    bias: gtsam.imuBias.ConstantBias,
) -> None:
    """What graphnav is told of the start, and the biases of the data sheet."""
    spec, sd = prep.setup.vehicle.imu, prep.setup.alignment.start.sd
    level = np.concatenate([sd[:3], sd[6:9]])
    biases = np.repeat([spec.accel_bias_mg * MG, spec.gyro_bias_deg_h * DEG / 3600], 3)
    diagonal = gtsam.noiseModel.Diagonal.Sigmas
    graph.add(gtsam.PriorFactorPose3(X(0), state.pose(), diagonal(level)))
    graph.add(gtsam.PriorFactorVector(V(0), state.velocity(), diagonal(sd[3:6])))
    graph.add(gtsam.PriorFactorConstantBias(B(0), bias, diagonal(biases)))


def _preintegrated(
    prep: Prepared, node_time: Array, bias: gtsam.imuBias.ConstantBias
) -> list[gtsam.PreintegratedImuMeasurements]:
    """Between the nodes, with the data sheet's noise times HUMBLE."""
    imu, spec = prep.sensed.run.imu, prep.setup.vehicle.imu
    assert imu is not None
    params = gtsam.PreintegrationParams.MakeSharedU(9.81)
    gyro, accel = spec.gyro_noise_deg_sqrt_h * DEG / 60, spec.accel_noise_mg_sqrt_hz * MG
    params.setGyroscopeCovariance((HUMBLE * gyro) ** 2 * np.eye(3))
    params.setAccelerometerCovariance((HUMBLE * accel) ** 2 * np.eye(3))
    params.setIntegrationCovariance(1e-8 * np.eye(3))
    found = []
    for start, end in pairwise(node_time):
        pim = gtsam.PreintegratedImuMeasurements(params, bias)
        first, last = np.searchsorted(imu.time, [start, end], side="right")
        edges = np.concatenate([[start], imu.time[first:last], [end]])
        for row, seconds in zip(range(first, last + 1), np.diff(edges), strict=True):
            if seconds > 1e-9:
                sample = min(row, len(imu.time) - 1)
                pim.integrateMeasurement(imu.accel[sample], imu.gyro[sample], seconds)
        found.append(pim)
    return found


def _bias_walk(k: int, seconds: float) -> gtsam.BetweenFactorConstantBias:
    sd = np.repeat(BIAS_WALK, 3) * np.sqrt(seconds)
    noise = gtsam.noiseModel.Diagonal.Sigmas(sd)
    return gtsam.BetweenFactorConstantBias(B(k - 1), B(k), gtsam.imuBias.ConstantBias(), noise)


def _deviations(
    graph: gtsam.NonlinearFactorGraph, solved: gtsam.Values, count: int
) -> dict[str, Array]:
    """sd_e and sd_n (count,) m, at MARGINALS nodes and between them."""
    marginals = gtsam.Marginals(graph, solved)  # fails on a navigation grade: it has Cholesky only
    at = np.unique(np.linspace(0, count - 1, MARGINALS).astype(int))
    found = []
    for k in at:
        R = solved.atPose3(X(k)).rotation().matrix()
        covariance = R @ marginals.marginalCovariance(X(k))[3:, 3:] @ R.T
        found.append(np.sqrt(np.diag(covariance)[:2]))
    every = np.arange(count)
    return {
        f"sd_{k}": np.interp(every, at, sd) for k, sd in zip("en", np.array(found).T, strict=True)
    }


def kalman(prep: Prepared, scale: float) -> DataFrame:
    """pyins' feedback filter on the run's clock."""
    start, spec = prep.setup.alignment.start, prep.setup.vehicle.imu
    increments = _increments(prep)
    lla = prep.setup.alignment.origin.geodetic(start.p_n)
    roll, pitch, heading = (float(np.rad2deg(a)) for a in angles_of_rotation(start.R_nb))
    values = [*np.rad2deg(lla[:2]), lla[2], *_velocity(prep), roll, pitch, heading]
    begin = increments.index[0] - increments["dt"].iloc[0]
    pva = DataFrame([values], index=[begin], columns=TRAJECTORY_COLS).iloc[0]
    gyro = EstimationModel(spec.gyro_bias_deg_h * DEG / 3600, spec.gyro_noise_deg_sqrt_h * DEG / 60)
    accel = EstimationModel(spec.accel_bias_mg * MG, spec.accel_noise_mg_sqrt_hz * MG)
    found = filters.run_feedback_filter(
        pva, start.sd[6], 1.0, 1.0, float(np.rad2deg(start.sd[2])), increments, gyro, accel,
        measurements=_measured(prep, scale), time_step=1.0,
    )  # fmt: skip
    table = found.trajectory[LLA].rename(columns={"alt": "height"})
    table = table.rename_axis("time").reset_index()
    sd = found.trajectory_sd
    return table.assign(
        sd_e=np.interp(table["time"], sd.index, sd["east"]),
        sd_n=np.interp(table["time"], sd.index, sd["north"]),
    )


def _increments(prep: Prepared) -> DataFrame:
    imu = prep.sensed.run.imu
    assert imu is not None
    rates = np.concatenate([imu.gyro @ FRD, imu.accel @ FRD], 1)
    time = Index(imu.time + prep.sensed.run.clock_start, name="time")
    names = [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    samples = DataFrame(rates, index=time, columns=names)
    return strapdown.compute_increments_from_imu(samples, "rate")


def _velocity(prep: Prepared) -> Array:
    """North, east, down at the start: the odometer's, along the heading."""
    odometer = prep.sensed.run.odometer
    speed = (
        0.0 if odometer is None else float(speed_at(odometer, prep.sensed.inc.edge[:1], 0.25)[0])
    )
    east, north, up = prep.setup.alignment.start.R_nb[:, 1] * speed
    return np.array([north, east, -up])


def _measured(prep: Prepared, scale: float) -> list[measurements.Measurement]:
    """Fixes and, once a second, the odometer with the non-holonomic constraint."""
    found = []
    gnss, odometer = prep.sensed.gnss, prep.sensed.run.odometer
    clock = prep.sensed.run.clock_start
    if gnss is not None:
        columns = np.stack([gnss.lat_deg, gnss.lon_deg, gnss.height], -1)
        fixes = DataFrame(columns, index=gnss.time + clock, columns=LLA)
        sd = FIX_DOUBT * float(np.median(gnss.sd_enu[:, :2]))
        found.append(measurements.Position(fixes, sd, FRD @ prep.setup.vehicle.gnss.lever_b))
    if odometer is not None:
        at = np.arange(odometer.time[0], odometer.time[-1]) if gnss is None else gnss.time
        forward = scale * speed_at(odometer, at)
        body = DataFrame(0.0, index=at + clock, columns=["VX", "VY", "VZ"]).assign(VX=forward)
        found.append(measurements.BodyVelocity(body, VELOCITY_SD))
    return found


def positions(time: Array, p_n: Array, origin: Origin) -> DataFrame:
    """A path in n as a table."""
    lat, lon, height = origin.geodetic(p_n)
    columns = {"time": time, "lat": np.rad2deg(lat), "lon": np.rad2deg(lon), "height": height}
    return DataFrame(columns)
