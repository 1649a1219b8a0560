"""A smoothed rover as the writers want it, and what its wheels did wrong."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from factors import kinds
from factors.block import PHASE
from factors.calibration import ACCEL_BIAS, GYRO_BIAS, SIDE_SLIP, SLIP_COEFFICIENT, TOE, YAW_SLIP
from graphnav.common.progress import Progress, unheard
from graphnav.common.run import Array, Run
from graphnav.graph.calibrations import DEG_H, MG
from graphnav.graph.preparation import fixes_in
from graphnav.reading.outages import Outages, in_use
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.timeline import Timeline, timeline_from_states
from graphnav.result.events import Event
from graphnav.result.solved import Calibrated, Odometry, Solved
from graphnav.rover.running_gear import Wheels
from graphnav.rover.smoother import RoverSolution, first_guess, path_of, smooth_rover

STANDSTILL_SPEED = 0.003  # m/s at the wheels' rim
STANDSTILL_LEAST_S = 2.0  # a shorter pause is part of the drive
EPISODE_S, EPISODE_SHARE = 3.0, 0.25  # shorter or smaller (of the speed) is left untold
DOUBTED = 0.3
ODOMETER_S = 0.2
# no measurements of their own
INNER = (kinds.CALIBRATION_MEAN, kinds.BOUNDS, kinds.TILT, kinds.WHEEL_SPEED)


@dataclass(frozen=True)
class Reported:
    """How a calibration is reported."""

    column: str
    name: str
    unit: str
    components: tuple[str, ...]
    per: float
    constant: bool = False


XYZ = ("x", "y", "z")
DEG = np.deg2rad(1.0)
REPORTED = (
    Reported(GYRO_BIAS, "gyro_bias_deg_h", "deg/h", XYZ, DEG_H),
    Reported(ACCEL_BIAS, "accel_bias_mg", "mg", XYZ, MG),
    Reported(SLIP_COEFFICIENT, "slip_coefficient", "1", ("k_s",), 1.0),
    Reported(SIDE_SLIP, "side_slip", "1", ("right",), 1.0),
    Reported(TOE, "toe_deg_m", "deg/m", ("left",), DEG, constant=True),
    Reported(YAW_SLIP, "yaw_slip_deg_m", "deg/m", ("left",), DEG),
)


def solve_rover(
    run: Run,
    vehicle: Vehicle,
    *,
    use_gnss: bool = True,
    outages: Outages = (),
    progress: Progress = unheard,
    feel_ground: bool = True,
) -> Solved:
    """Smooth a run with rover gear. `outages` on the file's clock, s: fixes withheld.

    Not `feel_ground`: slip only from turns that the heading sensor or a gyro sees (C6).

    Raises `InputError` when wheels, geometry or start are missing, `SolutionError` when the graph
    does not settle.
    """
    used = replace(run, gnss=in_use(run, vehicle, use_gnss, outages))
    return finished(smooth_rover(used, vehicle, progress, feel_ground), run, vehicle)


def finished(solution: RoverSolution, run: Run, vehicle: Vehicle) -> Solved:
    """Everything the writers need of a smoothed rover; `run` as it was read, all fixes in it."""
    problem = solution.problem
    kept = [i for i, b in enumerate(solution.solution.blocks) if b.kind not in INNER]
    return Solved(
        run=run,
        vehicle=vehicle,
        origin=problem.origin,
        path=path_of(problem, solution.estimate),
        R_bm=np.eye(3),
        node_time=problem.nodes.time,
        node_covariance=solution.covariances.nodes[:, : PHASE.start, : PHASE.start],
        timeline=timeline(problem.wheels, problem.nodes.time),
        calibrated=calibrated(solution),
        blocks=[solution.solution.blocks[i] for i in kept],
        weights=[solution.solution.weights[i] for i in kept],
        reckoned=path_of(problem, first_guess(problem, sensed=False)),
        odometry=odometry(solution),
        fixes_n=fixes_in(problem.origin, run.gnss),
        solver={
            "kind": "rover, gyro-free" if problem.inc is None else "rover with gyros",
            "nodes": len(problem.nodes.time),
            "iterations": solution.solution.iterations,
            "cost": solution.solution.cost,
        },
        standstills=standstills(solution.problem.wheels),
        verdicts=verdicts(solution),
        remarks=solution.solution.remarks,
        wheel_events=tuple(wheel_events(solution)),
    )


def standstills(wheels: Wheels) -> Array:
    """Spans (K, 2) s of two seconds or more in which no wheel turns."""
    time = wheels.time
    found = [(time[a], time[b]) for a, b in _spans(wheels.motion.speed < STANDSTILL_SPEED)]
    return np.array([s for s in found if s[1] - s[0] >= STANDSTILL_LEAST_S]).reshape(-1, 2)


def timeline(wheels: Wheels, node_time: Array) -> Timeline:
    """Stop and moving, from the wheels."""
    at_standstill = np.zeros(len(wheels.time), bool)
    for start, end in standstills(wheels):
        at_standstill |= (wheels.time >= start) & (wheels.time <= end)
    states = timeline_from_states(wheels.time, np.where(at_standstill, "stop", "moving"))
    return states.covering(float(node_time[0]), float(node_time[-1]))


def _spans(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edge = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    ends = zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1) - 1, strict=True)
    return [(int(a), int(b)) for a, b in ends]


def calibrated(solution: RoverSolution) -> list[Calibrated]:
    """Slip, toe and biases with their standard deviations."""
    layout, time = solution.problem.layout, solution.problem.nodes.segment_time
    value = solution.estimate.calibration
    sd = np.sqrt(np.einsum("kii->ki", solution.covariances.calibration))
    out = []
    for t in REPORTED:
        if t.column in layout.slices:
            at = layout.slices[t.column]
            rows = slice(-1, None) if t.constant else slice(None)
            numbers = (value[rows, at], sd[rows, at], layout.prior[at], layout.prior_sd[at])
            scaled = [x / t.per for x in numbers]
            out.append(Calibrated(t.name, t.unit, t.components, t.constant, time[rows], *scaled))
    return out


def odometry(solution: RoverSolution) -> Odometry:
    """Mean wheel speed as recorded, velocity of the wheels' centroid as corrected."""
    wheels = solution.problem.wheels
    every = max(1, round(ODOMETER_S / float(np.median(np.diff(wheels.time)))))
    time, v_b = wheels.time[::every], wheels.motion.v_b[::every]
    segment_time = solution.problem.nodes.segment_time
    slips = solution.estimate.calibration[:, solution.problem.layout.column(SLIP_COEFFICIENT)]
    k = np.interp(time, segment_time, slips)
    return Odometry(time, v_b[:, 1], k * v_b[:, 0], k * v_b[:, 1])


def wheel_events(solution: RoverSolution) -> list[Event]:
    """Spells in which one wheel spun or was blocked, by wheel."""
    wheels = solution.problem.wheels
    clear = wheels.motion.speed > 10 * STANDSTILL_SPEED
    found = []
    for i in range(6):
        doubted = (wheels.motion.weight_roll[:, i] < DOUBTED) & clear
        for first, last in _spans(doubted):
            start, end = float(wheels.time[first]), float(wheels.time[last])
            excess = wheels.motion.residual[first : last + 1, i, 0]
            share = float(np.median(excess / wheels.motion.speed[first : last + 1]))
            if end - start >= EPISODE_S and abs(share) > EPISODE_SHARE:
                peak = float(excess[np.argmax(np.abs(excess))])
                kind = "wheel_spin" if peak > 0 else "wheel_lock"
                found.append(Event(start, end, kind, f"wheel_{i + 1}", peak))
    return sorted(found, key=lambda e: e.start)


def verdicts(solution: RoverSolution) -> list[str]:
    """What the reader of the result should know."""
    problem, said = solution.problem, []
    if problem.run.heading is None:
        said.append("no heading sensor: heading rests on the start and the wheels")
    if problem.inc is None and problem.run.accelerometer is None:
        said.append("no accelerometer: the rover is taken to drive on level ground")
    column = problem.layout.column(SLIP_COEFFICIENT)
    k = solution.estimate.calibration[:, column]
    seen = " and ".join(t.side for t in solution.tracks)
    how = f"felt from the ground's profile under the {seen} wheels" if seen else "not felt directly"
    said.append(f"slip coefficient {k.min():.2f} to {k.max():.2f}, mean {k.mean():.3f}; {how}")
    for e in wheel_events(solution):
        clock = e.start + problem.run.clock_start
        what = "spun" if e.kind == "wheel_spin" else "was slower than the rover"
        said.append(f"{e.axis} {what} for {e.end - e.start:.0f} s from {clock:.0f}")
    return said
