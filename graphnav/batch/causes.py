"""The likeliest cause is tried before it is named: the run is solved again as if it were undone."""

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from graphnav.batch import doubts
from graphnav.batch.finish import finish
from graphnav.batch.hypotheses import hypotheses
from graphnav.batch.noise_doubts import WORSE, noise_found
from graphnav.batch.smoother import smooth_batch
from graphnav.common.angles import wrapped
from graphnav.common.errors import GraphnavError
from graphnav.common.remark import Remark
from graphnav.common.run import Run
from graphnav.graph.preparation import prepare
from graphnav.reading.plausibility import driving_findings
from graphnav.reading.vehicle import Vehicle
from graphnav.result.solved import Solved, start_heading_deg

PIECE_S = 300.0  # of driving that shows a mistake
INTERVAL_S = 2.0  # between nodes: coarse is enough
ROUNDS = 5  # of a trial
# node solves: a trial goes on while all before took less than the solution itself, or than this
FREE = 120_000  # all causes on a piece of a run
# doubt left that is a healthy run's, or so little of what there was that the cause must be the one
CURED, SHARE_LEFT = 0.12, 0.25
# or so much less than before and than every other cause leaves that only this one can be it: what
# a vehicle's own doubt is, none takes away
STANDS_OUT, CLEARLY = 0.6, 0.2
EXCUSED = 3.0  # sigma of a calibration
PER_SIGMA, MOST_SIGMA = 0.01, 0.3  # of doubt, by calibration
CONTRADICTION = 0.3  # of doubt, by finding of how vehicles drive and remark that grades
PER_DECADE = 0.1  # of doubt, by which an IMU is noisier than it may be
UNSOLVED = 3.0  # of doubt


def likeliest(run: Run, vehicle: Vehicle, work: int) -> list[Remark]:
    """The mistake that, undone, takes the doubt away, at level 1: it is told, and grades at least
    doubtful; none where none does. That not all could be tried is a remark, too.

    `run` with the fixes in use only, `work` node solves that the solution took.
    """
    piece = _cut(run, _driving(run) + PIECE_S)
    before = _tried(piece, vehicle)
    if before.doubt < CURED:  # the piece is healthy: nothing to find out on it
        return []
    spent, allowed = before.work, max(work, FREE)
    mistakes = hypotheses(piece, vehicle)
    stopped, left = list[Remark](), list[float]()
    best = Remark("")
    for k, mistake in enumerate(mistakes):
        if spent > allowed:
            stopped = [_stopped(k, len(mistakes))]
            break
        trial = _tried(*mistake.undo(piece, vehicle))
        spent += trial.work
        if trial.solved is not None and trial.doubt < min(left, default=np.inf):
            best = Remark(mistake.why(trial.solved), mistake.remedy(trial.solved), level=1)
        left.append(trial.doubt)
        if min(left) < CURED and _convicted(before.doubt, sorted(left)):
            break
    return [best, *stopped] if _convicted(before.doubt, sorted(left)) else stopped


def _convicted(before: float, left: list[float]) -> bool:
    """Whether the cause that leaves the least of the doubt must be the one; `left` in order."""
    if not left:
        return False
    next_best = min([before, *left[1:2]])
    stands_out = left[0] < STANDS_OUT * next_best and left[0] < before - CLEARLY
    return left[0] < SHARE_LEFT * before or stands_out


def _stopped(tried: int, of: int) -> Remark:
    return Remark(
        f"{tried} of {of} causes were tried, as long as the run itself took: the others were not"
    )


def doubt(solved: Solved) -> float:
    """How much of a solution is doubted: shares of rows, calibrations against their priors, the
    IMU's noise, how vehicles drive, and what the start contradicts; 0 for none."""
    shares = [doubts.rows_doubted(solved, kind, k.axes)[1] for kind, k in doubts.KINDS.items()]
    rows = sum(float(share.mean()) for share in shares if len(share))
    sigmas = [s for c in solved.calibrated if c.name in doubts.CALIBRATIONS
              for s in doubts.sigmas_off(c)]  # fmt: skip
    excess = PER_SIGMA * np.maximum(np.array([*sigmas, _heading_off(solved)]) - EXCUSED, 0.0)
    findings = len(driving_findings(solved.run, solved.vehicle))
    odd = CONTRADICTION * (findings + sum(remark.level > 0 for remark in solved.remarks))
    noisy = [max(times / WORSE, 1.0) for _, _, times in noise_found(solved)]
    noise = float(np.log10(noisy).sum())
    return rows + float(np.minimum(excess, MOST_SIGMA).sum()) + odd + PER_DECADE * noise


def _heading_off(solved: Solved) -> float:
    """How far the heading at the start is from a stated one, in its sigmas, in the graph or not:
    a cause that the user's own heading contradicts is not the likelier one."""
    start = solved.vehicle.start
    if start.heading_deg is None:
        return 0.0
    off = wrapped(start_heading_deg(solved) - start.heading_deg, 360.0)
    return float(abs(off) / start.heading_sd_deg)


@dataclass(frozen=True)
class _Trial:
    """A coarse solution (None where there is none), how much of it is doubted, its node solves."""

    solved: Solved | None
    doubt: float
    work: int


def _tried(run: Run, vehicle: Vehicle) -> _Trial:
    try:
        prep = prepare(run, vehicle, use_gnss=True, outages=(), interval=INTERVAL_S)
        solved = finish(smooth_batch(prep, most=ROUNDS), run)
        return _Trial(solved, doubt(solved), work_of(solved))
    except GraphnavError:
        return _Trial(None, UNSOLVED, int((run.end or 0.0) / INTERVAL_S) * ROUNDS)


def work_of(solved: Solved) -> int:
    """Node solves of a solution."""
    return int(solved.solver["nodes"]) * int(solved.solver["iterations"])


def _driving(run: Run) -> float:
    """When the vehicle begins to move, s; 0 where nothing tells."""
    if run.odometer is None:
        return 0.0
    return float(run.odometer.time[np.argmax(np.abs(run.odometer.speed) > 1.0)])


def _cut(run: Run, end: float) -> Run:
    """The run until a time, s."""
    if run.end <= end:
        return run
    parts = {f.name: _until(getattr(run, f.name), end) for f in fields(run)}
    return replace(run, **parts | {"end": end})


def _until(sensor: Any, end: float) -> Any:
    """A sensor's samples until a time; None when none is left. What is no sensor stays."""
    if not is_dataclass(sensor) or isinstance(sensor, type):
        return sensor
    values = {f.name: getattr(sensor, f.name) for f in fields(sensor)}
    count = int(np.searchsorted(values["time"], end, side="right"))
    kept = {k: v[:count] if isinstance(v, np.ndarray) else v for k, v in values.items()}
    return replace(sensor, **kept) if count > 1 else None
