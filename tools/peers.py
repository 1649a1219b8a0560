"""The same run by others: plain dead reckoning and the Kalman filter of pyins, beside graphnav.

    python tools/peers.py run.csv --truth truth.csv
    python tools/peers.py run.csv --truth truth.csv --outage 120:180 --outage 300:360
    python tools/peers.py run.csv --truth truth.csv --no-gnss --odometer-scale 1.011

pyins (PyPI `python-ins`) gets the same samples, start, noise figures and lever arms; body velocity
[0, odometer, 0] with every fix (once a second without), fixes as they come. It has no state for the
odometer's scale: give the true one to be kind. Its pandas loop takes minutes for an hour.
"""

import argparse
from pathlib import Path

import numpy as np
from pandas import DataFrame, Index
from pyins import filters, measurements, strapdown
from pyins.inertial_sensor import EstimationModel
from pyins.util import TRAJECTORY_COLS
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table

from graphnav.batch.finish import finish
from graphnav.batch.smoother import smooth_batch
from graphnav.common.angles import angles_of_rotation
from graphnav.common.earth import Origin
from graphnav.common.errors import GraphnavError, InputError
from graphnav.common.run import Array
from graphnav.graph.preparation import Prepared, prepare
from graphnav.inertial.odometry import speed_at
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import trajectory
from graphnav.result.compare import compare

FRD = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])  # of right-forward-up; its own inverse
VELOCITY_SD, GNSS_FLOOR = 0.3, 5.0  # m/s, m: what suits pyins on recorded runs
DEG = np.pi / 180
LLA = ["lat", "lon", "alt"]


def kalman(prep: Prepared, scale: float) -> DataFrame:
    """Positions of pyins' feedback filter on the run's clock."""
    run, imu, start = prep.sensed.run, prep.sensed.run.imu, prep.setup.alignment.start
    assert imu is not None
    rates = np.concatenate([imu.gyro @ FRD, imu.accel @ FRD], 1)
    time = imu.time + run.clock_start
    names = [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    samples = DataFrame(rates, index=Index(time, name="time"), columns=names)
    increments = strapdown.compute_increments_from_imu(samples, "rate")
    lla = prep.setup.alignment.origin.geodetic(start.p_n)
    roll, pitch, heading = (float(np.rad2deg(a)) for a in angles_of_rotation(start.R_nb))
    values = [*np.rad2deg(lla[:2]), lla[2], *_velocity(prep), roll, pitch, heading]
    pva = DataFrame([values], index=[time[0]], columns=TRAJECTORY_COLS).iloc[0]
    spec = prep.setup.vehicle.imu
    gyro = EstimationModel(spec.gyro_bias_deg_h * DEG / 3600, spec.gyro_noise_deg_sqrt_h * DEG / 60)
    accel = EstimationModel(
        spec.accel_bias_mg * 9.80665e-3, spec.accel_noise_mg_sqrt_hz * 9.80665e-3
    )
    found = filters.run_feedback_filter(
        pva, start.sd[6], 1.0, 1.0, float(np.rad2deg(start.sd[2])), increments, gyro, accel,
        measurements=_measured(prep, scale), time_step=1.0,
    )  # fmt: skip
    table = found.trajectory[LLA].rename(columns={"alt": "height"})
    return table.rename_axis("time").reset_index()


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
        sd = max(float(np.median(gnss.sd_enu[:, :2])), GNSS_FLOOR)
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


def ends(table: DataFrame, truth: DataFrame, outages: list[tuple[float, float]]) -> str:
    """Median error at the ends of the outages."""
    if not outages:
        return ""
    at = [end for _, end in outages]
    near = [compare(table, truth.iloc[[np.abs(truth["time"] - t).argmin()]]) for t in at]
    return f"{np.median([c.horizontal_end_m for c in near]):.2f}"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--vehicle", type=Path)
    parser.add_argument("--no-gnss", action="store_true")
    parser.add_argument("--outage", action="append", default=[], metavar="START:END")
    parser.add_argument("--odometer-scale", type=float, default=1.0)
    options = parser.parse_args()
    outages = [(float(a), float(b)) for a, b in (o.split(":") for o in options.outage)]
    try:
        vehicle = load_vehicle(options.vehicle, options.run)
        run = read_run(options.run, vehicle)
        if run.imu is None:
            raise InputError(f"{options.run}: no gyro")
        truth = read_truth(options.truth)[["time", "lat", "lon", "height"]]
        prep = prepare(run, vehicle, use_gnss=not options.no_gnss, outages=outages)
        smoothed = smooth_batch(prep)
    except GraphnavError as error:
        raise SystemExit(f"peers: {error}") from None
    origin, clock = prep.setup.alignment.origin, run.clock_start
    rows = {
        "dead reckoning": positions(smoothed.reckoned.time + clock, smoothed.reckoned.p_n, origin),
        "pyins, Kalman filter": kalman(prep, options.odometer_scale),
        "graphnav": DataFrame(trajectory.table(finish(smoothed, run), 10.0)),
    }
    table = Table(box=MARKDOWN)
    for title in ("", "rms [m]", "max [m]", "end [m]", "outage ends, median [m]"):
        table.add_column(title, justify="left" if not title else "right")
    for name, found in rows.items():
        c = compare(found, truth)
        errors = (c.horizontal_rms_m, c.horizontal_max_m, c.horizontal_end_m)
        table.add_row(name, *(f"{x:.2f}" for x in errors), ends(found, truth, outages))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
