"""Gears doubted: what the run would look like in the other one, and which fits better.

A path once smoothed has followed the gear it was given, and then speaks for it. So every straight
is tried in the other gear, with what lies about it as that asks for, and both are compared by the
robust cost of all factors near it, at the same noise (Laplace's evidence: the determinants are
those of the same factors). One that fits clearly better is taken; what the other one still has of
probability widens the deviations as it moves the path (the second moment of a mixture).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from factors import kinds, so3
from factors.block import MOTION, Block, Term
from factors.calibration import Layout, forward_of, lateral_of
from factors.estimate import Estimate
from factors.weights import Robust
from graphnav.common.errors import SolutionError
from graphnav.common.remark import Remark
from graphnav.common.run import Array
from graphnav.graph.elimination import Covariances
from graphnav.graph.noise import Scales
from graphnav.graph.solve import Solution
from graphnav.recognition.corrections import VehicleParams
from graphnav.recognition.gears import REACH_S, apart, other_gear, spliced, straights
from graphnav.recognition.motion_states import Kinematics
from graphnav.recognition.timeline import Timeline

Trial = tuple[float, int, Timeline]  # what it costs more, the segment, the timeline
Attempt = Callable[[Timeline, Scales], tuple[Solution, Estimate]]  # and its states at the nodes now
NEAR_S = 1.5 * REACH_S  # of a straight, in which its gear tells in the factors
CLEAR = 8.0  # difference of costs from which the other gear is taken
SURE = 12.0  # difference of costs beyond which the other gear is no possibility
TEMPER = 0.5  # of it that counts: the errors of neighbouring rows are not independent
FREE = 1e3  # times its prior's sigma: not held
TOLD = 0.05  # probability of the other gear that is told
# states that tell the same but for the gear: at the same noise they compare
ALIKE = (
    ("straight_high", "straight_low"),
    ("turn_arc", "turn_separated", "turn_separated_low"),
    ("turn_pivot", "turn_pivot_low"),
)


@dataclass(frozen=True)
class Unclear:
    """A span whose gear is not certain."""

    start: float  # s
    end: float
    probability: float  # of the other gear
    moved: Array  # (N, 9) error states by which the other gear moves the nodes


@dataclass(frozen=True)
class Contest:
    """The timeline as the evidence has it."""

    timeline: Timeline
    changed: bool
    unclear: tuple[Unclear, ...]


def contested(
    timeline: Timeline,
    kinematics: Kinematics,
    vehicle: VehicleParams,
    scales: Scales,
    attempt: Attempt,
    robust: Mapping[str, Robust],
) -> Contest:
    """Every straight of a timeline in the other gear; `kinematics` without a known speed.

    `attempt` solves the run with a timeline at given noise.
    """
    alike = _alike(scales, timeline)
    solved, now = attempt(timeline, alike)
    time, cost = _costs(solved.blocks, robust)
    found: list[Trial] = []
    for group in apart(timeline, straights(timeline), 2 * NEAR_S):
        other = other_gear(timeline, kinematics, vehicle, group)
        try:
            there = _costs(attempt(other, alike)[0].blocks, robust)
        except SolutionError:
            continue  # no path can be driven so
        found += [(_gained(k, timeline, (time, cost), there), k, other) for k in group]
    found.sort(key=lambda one: one[0])
    better = _bettered(timeline, found)
    if better is not None:
        return Contest(better, True, ())
    unclear = []
    for gain, k, other in found:
        if gain < SURE:
            elsewhere = attempt(spliced(timeline, other, _about(timeline, k)), alike)[1]
            moved = _moved(now, elsewhere)
            start, end = float(timeline.start[k]), float(timeline.end[k])
            unclear.append(Unclear(start, end, float(expit(-TEMPER * gain)), moved))
    return Contest(timeline, False, tuple(unclear))


def _bettered(timeline: Timeline, found: list[Trial]) -> Timeline | None:
    """The timeline with the trials that cost less, the best first where they meet; None where none
    does.
    """
    spans, better = np.zeros((0, 2)), timeline
    for gain, k, other in found:
        span = _about(timeline, k)
        meets = (spans[:, 0] < span[0, 1]) & (spans[:, 1] > span[0, 0])
        if gain < -CLEAR and not meets.any():
            spans, better = np.vstack([spans, span]), spliced(better, other, span)
    return better if len(spans) else None


def _about(timeline: Timeline, k: int) -> Array:
    """A segment and what its change of gear may reach, (1, 2) s."""
    return np.array([[timeline.start[k] - REACH_S, timeline.end[k] + REACH_S]])


def remarks(unclear: tuple[Unclear, ...], clock: float) -> tuple[Remark, ...]:
    """Spans whose gear is not certain, on a file's clock that was `clock` s at the start."""
    return tuple(
        Remark(
            f"the gear (motion state) from {one.start + clock:.0f} to {one.end + clock:.0f} s is "
            f"not certain: with the other one the path would end "
            f"{np.linalg.norm(one.moved[-1, 6:8]):.2g} m away; the deviations cover both"
        )
        for one in sorted(unclear, key=lambda one: one.start)
        if one.probability > TOLD
    )


def widened(found: Covariances, unclear: tuple[Unclear, ...]) -> Covariances:
    """Covariances of nodes with what gears that are not certain leave open: the other path's square
    distance by its probability.
    """
    nodes = found.nodes.copy()
    for one in unclear:
        d = one.moved
        nodes[:, MOTION, MOTION] += one.probability * d[:, :, None] * d[:, None, :]
    return replace(found, nodes=nodes)


def held_at(
    layout: Layout, calibration: Array, sd: Array, time: Array
) -> Callable[[Estimate], Block]:
    """Calibrations (K, dim) of segments at `time` (K,) s as they are to `sd` (dim,): what is tried
    in one place shall not be made to fit everywhere else. The ground's constants are free: those of
    a wrong gear have followed it.
    """
    count, dim = calibration.shape
    sd = sd.copy()
    for name, columns in layout.slices.items():
        if name.startswith((forward_of(""), lateral_of(""))):
            sd[columns] = FREE * layout.prior_sd[columns]
    term = Term("c", np.arange(count), np.tile(np.diag(1 / sd), (count, 1, 1)))

    def factor(x: Estimate) -> Block:
        off = (x.calibration - calibration) / sd
        axes = tuple(map(str, range(dim)))
        return Block(kinds.CALIBRATION_PRIOR, axes, time, off, (term,))

    return factor


def _alike(scales: Scales, timeline: Timeline) -> dict[str, float]:
    """Scales in which states that are compared have the noise of the most driven of them."""
    driven, out = timeline.totals(), dict(scales)
    for states in ALIKE:
        most = max(states, key=lambda s: driven.get(s, (0, 0.0))[1])
        for kind in (kinds.DISPLACEMENT, kinds.VELOCITY):
            known = {k: v for k, v in scales.items() if k.startswith(f"{kind}:{most}:")}
            for state in states:
                head = f"{kind}:{state}:"
                out = {k: v for k, v in out.items() if not k.startswith(head)}
                out |= {k.replace(f":{most}:", f":{state}:"): v for k, v in known.items()}
    return out


def _costs(blocks: list[Block], robust: Mapping[str, Robust]) -> tuple[Array, Array]:
    """Times and costs of all factors: minus the log of their density, but for what is common."""
    time, cost = [], []
    for block in blocks:
        inflation = np.ones_like(block.residual) if block.inflation is None else block.inflation
        weight = robust[block.kind] if block.robust and block.kind in robust else Robust("none")
        rows = weight.loss(block.standardised) / inflation**2
        if block.kind in (kinds.DISPLACEMENT, kinds.VELOCITY) and block.sigma is not None:
            rows = rows + np.log(np.minimum(block.sigma, 1.0))  # a row of 1 m says nothing
        # the ground's constants are changed from everywhere: what that costs counts everywhere
        whole = block.terms and all(term.family == "c" for term in block.terms)
        time.append(np.full(len(block.time), np.nan) if whole else block.time)
        cost.append(rows.sum(axis=1))
    return np.concatenate(time), np.concatenate(cost)


def _gained(
    k: int, timeline: Timeline, now: tuple[Array, Array], other: tuple[Array, Array]
) -> float:
    """How much more the factors near segment `k` cost otherwise than now."""
    start, end = timeline.start[k] - NEAR_S, timeline.end[k] + NEAR_S

    def near(time: Array, cost: Array) -> float:
        return float(cost[np.isnan(time) | ((time > start) & (time < end))].sum())

    return near(*other) - near(*now)


def _moved(now: Estimate, there: Estimate) -> Array:
    """Error states (N, 9) of one estimate from another at the same nodes."""
    turned = so3.log(so3.transpose(now.R_nb) @ there.R_nb)
    return np.concatenate([turned, there.v_n - now.v_n, there.p_n - now.p_n], axis=1)
