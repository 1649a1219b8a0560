"""A smoothed run told in full: dense path, corrected odometer, calibrations, verdicts."""

from dataclasses import replace
from typing import Any

import numpy as np

from factors import kinds, so3
from factors.block import MOTION
from factors.calibration import LEVER, MOUNTING, SCALE, forward_of, lateral_of
from factors.preintegration import InertialNoise, preintegrate
from graphnav.batch import gears
from graphnav.batch.learnt import calibrated, imu_late, verdicts
from graphnav.batch.smoother import Smoothed
from graphnav.common.run import Array, Run
from graphnav.graph import inertial_noise
from graphnav.graph.densify import Path, densify
from graphnav.graph.kinematics import kinematics
from graphnav.graph.motion import driven
from graphnav.graph.preparation import fixes_in
from graphnav.inertial.increments import GRID_S, increments
from graphnav.result.solved import Odometry, Solved


def finish(smoothed: Smoothed, recorded: Run, rate_hz: float = 1 / GRID_S) -> Solved:
    """Everything the writers need of a smoothed run; `recorded` as it was read, all fixes in it,
    `rate_hz` at which the path is to be told.
    """
    prep, problem, estimate = smoothed.prep, smoothed.problem, smoothed.estimate
    origin = prep.setup.alignment.origin
    found = calibrated(smoothed)
    layout = prep.setup.layout
    pitch, heading = estimate.calibration[-1, layout.slices[MOUNTING]]
    R_bm = so3.exp(np.array([pitch, prep.setup.vehicle.odometer.mount_b[1], heading]))
    return Solved(
        # in the axes that were smoothed
        run=replace(recorded, imu=prep.sensed.run.imu, heading=prep.sensed.run.heading),
        vehicle=prep.setup.vehicle,
        origin=origin,
        path=smoothed.path if rate_hz * GRID_S <= 1 else _sample_by_sample(smoothed),
        R_bm=R_bm,
        node_time=problem.nodes.time,
        imu_late=imu_late(found),
        node_covariance=smoothed.covariances.nodes[:, MOTION, MOTION],
        timeline=smoothed.timeline.covering(
            float(prep.sensed.inc.edge[0]), float(prep.sensed.inc.edge[-1])
        ),
        calibrated=found,
        blocks=smoothed.solution.blocks,
        weights=smoothed.solution.weights,
        reckoned=smoothed.reckoned,
        odometry=_odometry(smoothed, R_bm),
        fixes_n=fixes_in(origin, recorded.gnss),
        standstills=prep.sensed.standstill.standstills,
        solver=_solver(smoothed),
        verdicts=verdicts(found),
        remarks=(
            *prep.setup.alignment.remarks,
            *smoothed.solution.remarks,
            *gears.remarks(smoothed.unclear, recorded.clock_start),
        ),
        moved=prep.sensed.standstill.moved,
        gaps=_gaps(smoothed),
    )


def _solver(smoothed: Smoothed) -> dict[str, Any]:
    """What the summary tells of the way to the solution."""
    problem = smoothed.problem
    return {
        "iterations": smoothed.iterations,
        "rounds": smoothed.rounds,
        "cost": smoothed.solution.cost,
        "nodes": len(problem.nodes.time),
        "heading_source": smoothed.prep.setup.alignment.source,
        "imu_noise": inertial_noise.as_summary(problem.noise[kinds.INERTIAL]),
        "noise_found": {k: round(v, 4) for k, v in sorted(smoothed.scales.items())},
    }


def _sample_by_sample(smoothed: Smoothed) -> Path:
    """The path at every sample of the IMU, between the same nodes: rows closer than the
    increments are to show what happened inside them.
    """
    prep, nodes, imu = smoothed.prep, smoothed.problem.nodes, smoothed.prep.sensed.run.imu
    assert imu is not None
    inc = increments(imu, grid_s=0.0)
    fine = replace(nodes, edge=np.searchsorted(inc.edge, nodes.time))  # its edges hold the others
    pre = preintegrate(inc, fine.edge, smoothed.problem.pre.errors, InertialNoise(1.0, 1.0))
    return densify(inc, pre, fine, smoothed.estimate, prep.setup.alignment.origin)


def _gaps(smoothed: Smoothed) -> Array | None:
    """Spans in which the IMU was silent and what it may have missed, (G, 4)."""
    inc = smoothed.prep.sensed.inc
    if inc.doubt is None:
        return None
    on = np.flatnonzero(inc.doubt.any(axis=1))
    return np.column_stack([inc.edge[on], inc.edge[on + 1], inc.doubt[on]])


def _odometry(smoothed: Smoothed, R_bm: Array) -> Odometry | None:
    """Raw odometer speed and what the learnt corrections make of it, at 10 Hz."""
    prep, estimate = smoothed.prep, smoothed.estimate
    if prep.sensed.run.odometer is None:
        return None
    nodes, layout = smoothed.problem.nodes, prep.setup.layout
    path = smoothed.path
    motion = kinematics(prep, path, estimate, nodes)
    names = driven(prep, smoothed.timeline.state_at(motion.time))
    last = estimate.calibration[-1]

    def learnt(name: str, otherwise: float) -> float:
        column = layout.find(name)
        return otherwise if column is None else float(last[column])

    scale_column = estimate.calibration[:, layout.column(SCALE)]
    scale = 1 + np.interp(motion.time, nodes.segment_time, scale_column)
    v_x, v_y = np.zeros(len(names)), np.full(len(names), np.nan)
    for state in np.unique(names):
        row, on = prep.setup.table[str(state)], names == state
        length = prep.setup.vehicle.body.contact_length
        v_x[on] = -learnt(lateral_of(str(state)), row.kappa * length) * motion.yaw_rate[on]
        if row.use_odometer:
            factor = learnt(forward_of(str(state)), row.factor)
            sweep = row.half_gauge * np.abs(motion.yaw_rate[on]) * np.sign(motion.v_o[on])
            v_y[on] = factor * scale[on] * motion.v_o[on] - sweep
    v_x[np.isnan(v_y)] = np.nan
    # told at the IMU, as the trajectory is: the odometer point swings about it
    lever_m = R_bm.T @ last[layout.slices[LEVER]]
    swing = motion.yaw_rate
    return Odometry(motion.time, motion.v_o, v_x + swing * lever_m[1], v_y - swing * lever_m[0])
