"""A rover run from wheels to estimate: first guess, rounds of solving, the path between nodes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from factors import kinds, so3
from factors.calibration import SLIP_COEFFICIENT, TOE, YAW_SLIP, Component, Layout
from factors.estimate import Estimate
from factors.rover_wheels import turns
from factors.terrain_slip import WheelTrack
from factors.weights import Robust
from graphnav.common.angles import rotation_of_angles
from graphnav.common.progress import Progress, unheard
from graphnav.common.run import Run
from graphnav.graph.densify import Path
from graphnav.graph.elimination import Covariances, covariances
from graphnav.graph.solve import FINE, ROUGH, Solution, gauss_newton
from graphnav.reading.vehicle import Vehicle
from graphnav.rover import running_gear as rover
from graphnav.rover import terrain as rover_terrain
from graphnav.rover.problem import YAW_LENGTH, RoverProblem, build, prepare

LEARN_WAY = 30.0  # m driven before the ground's statistics are learnt
YAW_WINDOW = 6.0  # m over which the wheels' turn is compared with the seen one
SEEN_S = 3.0  # heading samples further apart leave the time between unseen

ROBUST = {
    kinds.HEADING: Robust("igg3", 2.5, 8.0),
    kinds.GNSS: Robust("igg3", 2.0, 6.0),
    kinds.LEVEL: Robust("igg3", 2.5, 8.0),
    kinds.WHEEL_DISPLACEMENT: Robust("huber", 2.5),
    kinds.WHEEL_YAW: Robust("huber", 2.5),
    kinds.TERRAIN_SLIP: Robust("igg3", 2.5, 8.0),
}
CONVEX = {kind: Robust("huber", 2.0) for kind in ROBUST}


@dataclass(frozen=True)
class RoverSolution:
    """The smoothed rover."""

    problem: RoverProblem
    solution: Solution
    covariances: Covariances
    tracks: list[WheelTrack]  # sides whose wheels felt one ground

    @property
    def estimate(self) -> Estimate:
        """States of all nodes and calibrations."""
        return self.solution.estimate


def smooth_rover(
    run: Run,
    vehicle: Vehicle,
    progress: Progress = unheard,
    feel_ground: bool = True,
) -> RoverSolution:
    """Solve a rover run: convex weights first; then the ground's profile and statistics join in.

    Every fix in `run.gnss` is used; `progress` hears the name of each stage as it begins. Not
    `feel_ground`: slip is not read from the ground's profile.
    """
    progress("wheels")
    problem = prepare(run, vehicle)
    estimate = first_guess(problem)
    found: list[WheelTrack] = []
    for round_, robust in enumerate((CONVEX, CONVEX, ROBUST), 1):
        progress(f"solve, round {round_}")
        factors = build(problem, estimate, found)
        solution = gauss_newton(
            lambda x: [b for f in factors for b in f(x)],  # noqa: B023  called at once
            estimate,
            problem.order,
            robust,
            FINE if robust is ROBUST else ROUGH,
        )
        estimate = solution.estimate
        if robust is not ROBUST:
            path = path_of(problem, estimate)
            k = estimate.calibration[:, problem.layout.column(SLIP_COEFFICIENT)]
            if feel_ground:
                found = rover_terrain.tracks(problem.wheels, problem.nodes, path, k)
            if round_ == 1:  # later estimates lean on the wheels' yaw too much to judge it
                problem = with_spread(problem, YAW_SLIP, 0.0, yaw_slip_sd(problem, estimate))
            known = covariances(solution.bayes_net, problem.order)
            problem = with_spread(problem, SLIP_COEFFICIENT, *slip_spread(problem, estimate, known))
    progress("covariances")
    return RoverSolution(problem, solution, covariances(solution.bayes_net, problem.order), found)


def path_of(problem: RoverProblem, x: Estimate) -> Path:
    """The trajectory at the nodes; `Path.at` carries it between them."""
    return Path(problem.nodes.time, x.R_nb, x.v_n, x.p_n)


def with_spread(problem: RoverProblem, name: str, mean: float, sd: float) -> RoverProblem:
    """The problem with another prior for something that wanders over the ground."""

    def spread(component: Component) -> Component:
        if component.name != name:
            return component
        return replace(component, prior=np.array([mean]), sd=np.array([sd]))

    layout = Layout(tuple(spread(c) for c in problem.layout.components))
    wandering = tuple(replace(w, component=spread(w.component)) for w in problem.wandering)
    return replace(problem, layout=layout, wandering=wandering)


def slip_spread(problem: RoverProblem, x: Estimate, known: Covariances) -> tuple[float, float]:
    """Mean and spread of the slip coefficient over this run's ground.

    Those of the estimated values plus their covariance: one step of expectation maximisation.
    """
    at = problem.layout.column(SLIP_COEFFICIENT)
    value, variance = x.calibration[:, at], known.calibration[:, at, at]
    path = np.interp(problem.nodes.segment_time, problem.wheels.time, problem.wheels.path)
    weight = np.maximum(np.gradient(path), 0.0) if len(path) > 1 else np.zeros(1)
    if weight.sum() < LEARN_WAY:
        return float(problem.layout.prior[at]), float(problem.layout.prior_sd[at])
    mean = float(np.average(value, weights=weight))
    return mean, float(np.sqrt(np.average((value - mean) ** 2 + variance, weights=weight)))


def yaw_slip_sd(problem: RoverProblem, x: Estimate) -> float:
    """Spread rad/m of the yaw slip: turns over `YAW_WINDOW` m against the wheels' account of them.

    Only where the heading is seen (or gyros are fitted) throughout; else the sd stays as it was.
    """
    layout, nodes, sums = problem.layout, problem.nodes, problem.sums
    before = float(layout.prior_sd[layout.column(YAW_SLIP)])
    c = x.calibration[nodes.segment]
    k, toe = c[:, layout.column(SLIP_COEFFICIENT)], c[:, layout.column(TOE)]
    missed = turns(x.R_nb).phi[:, 2] - k * sums.yaw - toe * sums.ahead
    stray = np.concatenate([[0.0], np.cumsum(missed)])
    way = np.concatenate([[0.0], np.cumsum(sums.path)])
    blind = np.concatenate([[0.0], np.cumsum(~_heading_seen(problem))])
    begin = np.arange(len(way))
    end = np.searchsorted(way, way + YAW_WINDOW)
    inside = (end < len(way)) & (np.append(sums.path, 0.0) > 0.01)
    begin, end = begin[inside], end[inside]
    on = blind[end] == blind[begin]
    if way[-1] == 0 or np.sum(sums.path[begin[on]]) < LEARN_WAY:
        return before
    scatter = 1.4826 * float(np.median(np.abs(stray[end[on]] - stray[begin[on]])))
    unit = 2 * YAW_LENGTH * (YAW_WINDOW - YAW_LENGTH * (1 - np.exp(-YAW_WINDOW / YAW_LENGTH)))
    return float(np.clip(scatter / np.sqrt(unit), 0.03 * before, before))


def _heading_seen(problem: RoverProblem) -> NDArray[np.bool_]:
    """Intervals (n,) whose turn something other than the wheels tells."""
    nodes, seen = problem.nodes, problem.run.heading
    if problem.inc is not None:
        return np.ones(len(nodes.segment), bool)
    if seen is None:
        return np.zeros(len(nodes.segment), bool)
    ahead = np.clip(np.searchsorted(seen.time, nodes.time[:-1]), 1, len(seen.time) - 1)
    return np.asarray(seen.time[ahead] - seen.time[ahead - 1] < SEEN_S)


def first_guess(problem: RoverProblem, sensed: bool = True) -> Estimate:
    """Level from the accelerometer, heading from the sensor and the wheels, dead reckoning.

    Not `sensed`: the heading sensor is left out, the wheels turn the start's heading.
    """
    time, n = problem.nodes.time, len(problem.nodes.time)
    wheels, sums = problem.wheels, problem.sums
    yaw = rover.K_GUESS * np.concatenate([[0.0], np.cumsum(sums.yaw)])
    start_R = problem.start.R_nb
    known = float(np.arctan2(start_R[0, 1], start_R[1, 1]))
    angle = np.full(n, known)
    seen = problem.run.heading
    if seen is not None and sensed:
        carried = np.interp(seen.time, time, yaw)
        angle = np.interp(time, seen.time, np.unwrap(seen.heading + carried))
    roll, pitch = np.zeros(n), np.zeros(n)
    source = problem.run.imu or problem.run.accelerometer
    if source is not None:
        f = rover.levelling(source, time).force_b
        ok = np.isfinite(f[:, 0])
    if source is not None and ok.any():  # else level until the wheels tell
        roll = np.interp(time, time[ok], np.arctan2(-f[ok, 0], f[ok, 2]))
        pitch = np.interp(time, time[ok], np.arctan2(f[ok, 1], np.hypot(f[ok, 0], f[ok, 2])))
    R = rotation_of_angles(roll, pitch, angle - yaw)
    middle = R[:-1] @ so3.exp(0.5 * so3.log(so3.transpose(R[:-1]) @ R[1:]))
    steps = so3.mv(middle, rover.K_GUESS * sums.displacement)
    foot = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    swing = so3.mv(R, sums.centroid_b)
    calibration = np.tile(problem.layout.prior, (len(problem.nodes.segment_time), 1))
    velocity = so3.mv(R, rover.K_GUESS * rover.origin_velocity(wheels, time))
    p = problem.start.p_n + foot - (swing - swing[0])
    return Estimate(R, velocity, p, np.zeros(n), calibration)
