"""From a prepared run to its estimate: dead reckoning, motion states and graph, in rounds."""

from dataclasses import dataclass, replace

import numpy as np

from factors.block import POSITION
from factors.estimate import Estimate
from graphnav.batch.first_path import first_path
from graphnav.batch.gears import Attempt, Contest, Unclear, contested, held_at, widened
from graphnav.common.progress import Progress, unheard
from graphnav.common.run import Array
from graphnav.graph.common_error import found_common
from graphnav.graph.densify import Path, densify
from graphnav.graph.elimination import Covariances, covariances
from graphnav.graph.kinematics import kinematics
from graphnav.graph.nodes import Nodes, near_fixes, place_nodes
from graphnav.graph.noise import Scales, rescaled
from graphnav.graph.preparation import Prepared
from graphnav.graph.problem import Problem, build
from graphnav.graph.robust_schedule import FINAL, FIRST, Weights
from graphnav.graph.solve import FINE, ROUGH, Solution, gauss_newton
from graphnav.recognition.motion_states import recognise, with_probabilities
from graphnav.recognition.timeline import Timeline, disagreement, timeline_from_states

MIN_ROUNDS, MAX_ROUNDS = 3, 12
FIRST_INTERVAL_S = 2.0  # the first round only has to be near enough for the states
SAME_TIMELINE = 0.002  # share of time that may still change its state
CONTEST_ROUND = 6  # from which gears are doubted, at the latest
SAME_PLACE, SAME_SD = 0.3, 0.15  # sigmas that a node may move; of their logarithm, to have settled


@dataclass(frozen=True)
class Smoothed:
    """A solved run."""

    prep: Prepared
    problem: Problem
    solution: Solution
    timeline: Timeline
    covariances: Covariances
    reckoned: Path  # plain dead reckoning
    path: Path  # dense, smoothed
    scales: dict[str, float]  # noise found over noise assumed
    iterations: int
    rounds: int
    unclear: tuple[Unclear, ...]  # spans whose gear is not certain

    @property
    def estimate(self) -> Estimate:
        """The states at the nodes."""
        return self.solution.estimate


def smooth_batch(
    prep: Prepared,
    progress: Progress = unheard,
    robust: tuple[Weights, Weights] = (FIRST, FINAL),
    most: int = MAX_ROUNDS,
) -> Smoothed:
    """Smooth a run; `progress` hears the name of each stage as it begins.

    `robust` holds the weight functions by factor kind of the first round and of the later ones:
    convex first, redescending once the trajectory is near (a graduated schedule). The rounds end
    when motion states, noise and places have settled, or with the `most`-th.
    """
    progress("dead reckoning")
    nodes = _nodes(prep, np.zeros(0), prep.setup.interval)
    first = first_path(prep, nodes)
    estimate, path, reckoned = first.estimate, first.path, first.reckoned
    progress("motion states")
    states = _States.of(prep, _recognised(prep, path, estimate, None))
    scales: dict[str, float] = {}
    last, iterations = False, 0
    before: Iterate | None = None
    for round_ in range(1, most + 1):
        last = last or round_ == most
        interval = max(FIRST_INTERVAL_S if round_ == 1 else 0.0, prep.setup.interval)
        nodes_next = _nodes(prep, states.timeline.boundaries, interval)
        estimate = _moved(estimate, nodes, path, nodes_next)
        progress(f"round {round_}")
        problem = build(prep, nodes_next, states.timeline, estimate, scales)
        now = _iterate(prep, problem, estimate, robust[round_ > 1], FINE if last else ROUGH)
        iterations += now.solution.iterations
        nodes, estimate, path = nodes_next, now.solution.estimate, now.path
        if last:
            break
        settled = before is not None and now.settled(before)
        states = states.recognised(prep, now, nodes)
        if states.open and ((states.same and settled) or round_ >= CONTEST_ROUND):
            states = states.contested(prep, now, nodes, scales, robust[1])
        last = round_ + 1 >= MIN_ROUNDS and states.same and settled and not states.open
        before = now
        scales = _rescaled(scales, now, problem, prep)
    unclear = states.contest.unclear if states.contest else ()
    progress("state probabilities")
    timeline = _with_probabilities(prep, path, estimate, nodes, states.timeline)
    return Smoothed(
        prep, problem, now.solution, timeline, widened(now.covariances, unclear), reckoned, path,
        scales, iterations, round_, unclear,
    )  # fmt: skip


def _rescaled(scales: Scales, now: "Iterate", problem: Problem, prep: Prepared) -> dict[str, float]:
    """The noise found in a round, and what its fixes have in common."""
    blocks, estimate = now.solution.blocks, now.solution.estimate
    found = rescaled(scales, blocks, problem.noise, now.covariances.joints)
    usual = usual_variance(now.covariances)
    return found | found_common(blocks, prep.setup.layout, estimate, usual, scales)


@dataclass(frozen=True)
class Iterate:
    """Where one round ended."""

    solution: Solution
    path: Path
    covariances: Covariances

    def settled(self, before: "Iterate") -> bool:
        """Whether another round would hardly move the nodes or change their deviations."""
        p, q = self.solution.estimate.p_n, before.solution.estimate.p_n
        if p.shape != q.shape:
            return False
        variance = position_variances(self.covariances)
        now, then = usual_variance(self.covariances), usual_variance(before.covariances)
        near = np.abs(p - q) < SAME_PLACE * np.sqrt(variance)
        return bool(near.all() and (0.5 * np.abs(np.log(now / then)) < SAME_SD).all())


def _iterate(
    prep: Prepared, problem: Problem, estimate: Estimate, weights: Weights, tolerance: float
) -> Iterate:
    """Solve one round's problem from an estimate."""
    solution = gauss_newton(problem.linearise, estimate, problem.order, weights, tolerance)
    origin = prep.setup.alignment.origin
    path = densify(prep.sensed.inc, problem.pre, problem.nodes, solution.estimate, origin)
    return Iterate(solution, path, covariances(solution.bayes_net, problem.order))


@dataclass(frozen=True)
class _States:
    """The motion states between two rounds."""

    timeline: Timeline
    same: bool  # the last round changed nothing of them
    contest: Contest | None  # of their gears, once it was held

    @staticmethod
    def of(prep: Prepared, timeline: Timeline) -> "_States":
        """Those of dead reckoning; what has one gear only is held in none other."""
        geared = _has_gears(prep) and prep.setup.params.has_low_gear
        return _States(timeline, False, None if geared else Contest(timeline, False, ()))

    @property
    def open(self) -> bool:
        """Whether their gears are still to be doubted, for the first time or anew."""
        return self.contest is None or self.contest.changed

    def recognised(self, prep: Prepared, now: Iterate, nodes: Nodes) -> "_States":
        """Those of the path where a round ended; what is the same already stays."""
        if self.same:
            return self
        again = _recognised(prep, now.path, now.solution.estimate, nodes)
        return replace(
            self, timeline=again, same=disagreement(self.timeline, again) < SAME_TIMELINE
        )

    def contested(
        self, prep: Prepared, now: Iterate, nodes: Nodes, scales: Scales, weights: Weights
    ) -> "_States":
        """With the gears that the factors speak for."""
        attempt = _attempts(prep, now, nodes, self.timeline, weights)
        motion = kinematics(prep, now.path, now.solution.estimate, None)
        params = prep.setup.params
        contest = contested(self.timeline, motion, params, scales, attempt, weights)
        return _States(contest.timeline, True, contest)


def _attempts(
    prep: Prepared, now: Iterate, nodes: Nodes, timeline: Timeline, weights: Weights
) -> Attempt:
    """How the run is solved with another timeline than `timeline`, beginning where a round ended;
    told at the nodes of `timeline`.
    """
    interval = prep.setup.interval
    edge = _nodes(prep, timeline.boundaries, interval).edge
    sd = np.sqrt(np.einsum("kii->ki", now.covariances.calibration)).min(axis=0)

    def attempt(other: Timeline, scales: Scales) -> tuple[Solution, Estimate]:
        there = _nodes(prep, other.boundaries, interval)
        begin = _moved(now.solution.estimate, nodes, now.path, there)
        problem = build(prep, there, other, begin, scales)
        held = held_at(prep.setup.layout, begin.calibration, sd, there.segment_time)
        solution = gauss_newton(
            lambda x: [*problem.linearise(x), held(x)], begin, problem.order, weights, ROUGH
        )
        origin = prep.setup.alignment.origin
        path = densify(prep.sensed.inc, problem.pre, there, solution.estimate, origin)
        moved = replace(
            solution.estimate, R_nb=path.R_nb[edge], v_n=path.v_n[edge], p_n=path.p_n[edge]
        )
        return solution, moved

    return attempt


def position_variances(found: Covariances) -> Array:
    """Variance of every node's position by axis, (N, 3) m^2."""
    return np.asarray(np.einsum("nii->ni", found.nodes[:, POSITION, POSITION]))


def usual_variance(found: Covariances) -> Array:
    """The same of a usual node, (3,) m^2."""
    return np.asarray(np.median(position_variances(found), axis=0))


def _nodes(prep: Prepared, boundaries: Array, interval: float) -> Nodes:
    """Nodes at the interval, standstill edges, state boundaries and fixes."""
    edges = prep.sensed.inc.edge
    same = prep.sensed.standstill
    events = np.concatenate([same.changes, boundaries])
    aids = (prep.sensed.gnss, prep.sensed.run.heading)
    extra = near_fixes(*(aid.time for aid in aids if aid is not None))
    return place_nodes(edges, events, extra, same.standstills, interval)


def _moved(estimate: Estimate, old: Nodes, path: Path, new: Nodes) -> Estimate:
    """An estimate carried to other nodes of the same run by its dense path."""
    calibration = np.stack(
        [
            np.interp(new.segment_time, old.segment_time, column)
            for column in estimate.calibration.T
        ],
        -1,
    )
    at = new.edge
    phase = np.interp(new.time, old.time, estimate.phase)
    return Estimate(path.R_nb[at], path.v_n[at], path.p_n[at], phase, calibration)


def _has_gears(prep: Prepared) -> bool:
    """Whether there are more motion states to tell than stop and moving."""
    return prep.setup.vehicle.kind == "tracked" and prep.sensed.run.odometer is not None


def _with_probabilities(
    prep: Prepared, path: Path, estimate: Estimate, nodes: Nodes, timeline: Timeline
) -> Timeline:
    """The timeline with the probability of each state, where there is more than one to tell."""
    if not _has_gears(prep):
        return timeline
    return with_probabilities(timeline, kinematics(prep, path, estimate, nodes), prep.setup.params)


def _recognised(prep: Prepared, path: Path, estimate: Estimate, nodes: Nodes | None) -> Timeline:
    """Motion states of a path; for vehicles other than tracked: stop and moving from standstill."""
    if not _has_gears(prep):
        mid = 0.5 * (path.time[1:] + path.time[:-1])
        state = np.where(prep.sensed.standstill.at_standstill, "stop", "moving")
        timeline = timeline_from_states(mid, state)
        return timeline.covering(float(path.time[0]), float(path.time[-1]))
    return recognise(kinematics(prep, path, estimate, nodes), prep.setup.params)
