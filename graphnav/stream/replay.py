"""`--mode incremental`: the run replayed through the streaming smoother, beside the batch.

The stream says what the vehicle knew at every node. What is known now is the batch's answer; how
far iSAM2's own is from the batch solution of the same factors is told with it.
"""

from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np

from factors import so3
from factors.block import POSITION
from graphnav.batch.smoother import Smoothed, smooth_batch
from graphnav.common.errors import InputError
from graphnav.common.progress import Progress, unheard
from graphnav.common.run import Array, Run
from graphnav.common.worker_process import WorkerProcess
from graphnav.graph.elimination import step
from graphnav.graph.preparation import Prepared
from graphnav.graph.robust_schedule import FIRST
from graphnav.graph.solve import square_root
from graphnav.result.trajectory import deviations
from graphnav.stream.causal_estimate import CausalEstimate
from graphnav.stream.incremental_graph import IncrementalGraph
from graphnav.stream.smoother import Smoother

PIECE_S = 20.0  # of the recording given to the stream at a time
THOUSAND = 1000
STRAYED_M = 1.0  # of iSAM2's last estimate from the batch's, at least, that is worth telling


@dataclass(frozen=True)
class Replayed:
    """A run as it was known while it was driven, and as it is known now."""

    smoothed: Smoothed
    known: list[CausalEstimate]  # by node, in order of time
    solver: dict[str, Any]  # for summary.json
    peak_memory_mb: float  # of the replay


def smooth_incremental(
    prep: Prepared, lag: float | None = None, progress: Progress = unheard
) -> Replayed:
    """Replay a run in another process while this one smooths it; `lag` s as in `Smoother`.

    Raises InputError when the stream never learns where it starts, though the batch might, or
    when accelerometers are missing.
    """
    if not prep.sensed.run.felt:
        raise InputError(
            f"{prep.sensed.run.path}: without accelerometers a stream is not supported: smooth the "
            "run in batch, leave out --mode"
        )
    with WorkerProcess(f"{__name__}:known_and_solver") as stream:
        stream.call(prep, lag)
        smoothed = smooth_batch(prep, progress)
        progress("incremental")
        known, solver = stream.result()
    return Replayed(smoothed, known, solver, stream.peak_memory_mb)


def known_and_solver(
    prep: Prepared, lag: float | None
) -> tuple[list[CausalEstimate], dict[str, Any]]:
    """What the stream knew at each node and how it fared, for summary.json."""
    began = perf_counter()
    stream = replayed(prep, lag)
    took = perf_counter() - began
    assert stream.graph is not None
    return stream.history, latencies(stream.history) | {
        "incremental_s": round(took, 3),
        "isam_minus_batch_max_m": distance_from_batch(stream.graph),
        "lag_s": lag,
        "nodes_incremental": stream.graph.last + 1,
    }


def verdicts(replayed: Replayed) -> list[str]:
    """Whether the stream lost its way, for the user to read."""
    apart = replayed.solver["isam_minus_batch_max_m"]
    usual = float(np.median([np.hypot(*k.sd_enu[:2]) for k in replayed.known] or [0.0]))
    if apart < max(usual, STRAYED_M):
        return []
    return [
        f"the stream ended up to {apart:.1f} m from the batch solution of its own factors: do not "
        "rely on trajectory_causal.parquet"
    ]


def replayed(prep: Prepared, lag: float | None, piece: float = PIECE_S) -> Smoother:
    """The stream after all samples of a run in pieces of some seconds, IMU last."""
    run = prep.sensed.run
    assert run.imu is not None
    imu = prep.setup.vehicle.imu.model_copy(update={"axes": "RFU"})  # axes are turned already
    vehicle = prep.setup.vehicle.model_copy(update={"imu": imu})
    stream = Smoother(
        vehicle,
        lag=lag,
        table=prep.setup.table,
        fixes=prep.sensed.gnss is not None,
        interval=prep.setup.interval,
        clock=0.0,
    )
    for start, end in pairwise(np.arange(-piece, run.end + piece, piece).tolist()):
        _give(stream, run, prep.setup.fix_delay, start, end)
    stream.finish()
    return stream


def _give(stream: Smoother, run: Run, late: float, start: float, end: float) -> None:
    """What every sensor saw in (start, end]; `late` s were taken off the stamps of the fixes."""

    def inside(time: Array) -> slice:
        return slice(*np.searchsorted(time, [start, end], side="right").tolist())

    odometer, gnss, heading = run.odometer, run.gnss, run.heading
    imu = run.logged or run.imu  # the stream judges the samples itself
    if odometer is not None:
        on = inside(odometer.time)
        if odometer.pulse:
            counts = odometer.distance[on] / odometer.pulse
            stream.add_odometer(odometer.time[on], pulses=counts)
        else:
            stream.add_odometer(odometer.time[on], speed=odometer.speed[on])
    if run.sides is not None:
        on = inside(run.sides.time)
        stream.add_sides(run.sides.time[on], run.sides.left[on], run.sides.right[on])
    if gnss is not None:
        stamp = gnss.time + late
        on = inside(stamp)
        stream.add_gnss(
            stamp[on], gnss.lat_deg[on], gnss.lon_deg[on], gnss.height[on], gnss.sd_enu[on]
        )
    if heading is not None:
        on = inside(heading.time)
        stream.add_heading(heading.time[on], np.rad2deg(heading.heading[on]))
    assert imu is not None
    on = inside(imu.time)
    stream.add_imu(imu.time[on], imu.gyro[on], imu.accel[on])


def distance_from_batch(graph: IncrementalGraph) -> float:
    """How far the batch would still move iSAM2's estimate with the same factors, m, at most."""
    estimate = graph.everything()
    problem = graph.whole(estimate)
    net = square_root(problem.linearise(estimate), problem.order, FIRST)
    nodes, _ = step(net, problem.order)
    return float(np.linalg.norm(nodes[:, POSITION], axis=1).max())


def latencies(known: list[CausalEstimate]) -> dict[str, Any]:
    """Milliseconds an update took."""
    ms = 1e3 * np.array([k.latency for k in known])
    if not len(ms):
        return {}
    few = max(1, min(THOUSAND, len(ms) // 2))
    return {
        "updates": len(ms),
        "median_ms": round(float(np.median(ms)), 3),
        "p99_ms": round(float(np.percentile(ms, 99)), 3),
        "first_thousand_ms": round(float(np.median(ms[:few])), 3),
        "last_thousand_ms": round(float(np.median(ms[-few:])), 3),
    }


def causal(replayed: Replayed, prep: Prepared) -> dict[str, Array]:
    """Columns of trajectory_causal.parquet: what was known at each node, in the result's frame."""
    known, origin = replayed.known, prep.setup.alignment.origin
    x_e = np.array([k.origin.x_e + k.origin.R_en @ k.p_n for k in known]).reshape(-1, 3)
    p_n = (x_e - origin.x_e) @ origin.R_en
    v_n = np.array([origin.R_en.T @ k.origin.R_en @ k.v_n for k in known]).reshape(-1, 3)
    v_l = so3.mv(origin.level_axes(p_n), v_n)
    covariance = np.array([k.covariance for k in known]).reshape(-1, 9, 9)
    sd = deviations(covariance, np.array([k.R_nb for k in known]).reshape(-1, 3, 3))
    columns = {"time": np.array([k.time for k in known]) + prep.sensed.run.clock_start}
    columns |= dict(zip("enu", p_n.T, strict=True))
    columns |= {f"v_{axis}": v for axis, v in zip("enu", v_l.T, strict=True)}
    columns |= {"heading_deg": np.array([k.heading_deg for k in known])}
    columns |= {f"sd_{axis}": sd.position[:, k] for k, axis in enumerate("en")}
    columns |= {f"sd_v_{axis}": sd.velocity[:, k] for k, axis in enumerate("enu")}
    columns |= {"sd_heading_deg": np.rad2deg(sd.angles[:, 2])}
    return columns | {"latency_ms": 1e3 * np.array([k.latency for k in known])}
