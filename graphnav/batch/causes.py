"""The likeliest cause is tried before it is named: the run is solved again as if it were undone."""

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from graphnav.batch import doubts
from graphnav.batch.finish import finish
from graphnav.batch.hypotheses import hypotheses
from graphnav.batch.smoother import smooth_batch
from graphnav.common.errors import GraphnavError
from graphnav.common.remark import Remark
from graphnav.common.run import Run
from graphnav.graph.preparation import prepare
from graphnav.reading.plausibility import driving_findings
from graphnav.reading.vehicle import Vehicle
from graphnav.result.solved import Solved

PIECE_S = 300.0  # of driving that shows a mistake
INTERVAL_S = 2.0  # between nodes: coarse is enough
# doubt left that is a healthy run's, or so little of what there was that the cause must be the one
CURED, SHARE_LEFT = 0.12, 0.25
EXCUSED = 3.0  # sigma of a calibration
PER_SIGMA, MOST_SIGMA = 0.01, 0.3  # of doubt, by calibration
CONTRADICTION = 0.3  # of doubt, by finding of how vehicles drive and remark on the start
UNSOLVED = 3.0  # of doubt


def likeliest(run: Run, vehicle: Vehicle) -> Remark | None:
    """The mistake that, undone, takes the doubt away; None when none does.

    `run` with the fixes in use only. Level 1: it is told, and grades at least doubtful.
    """
    piece = _cut(run, _driving(run) + PIECE_S)
    _, before = _tried(piece, vehicle)
    best, left = None, SHARE_LEFT * before
    if before < CURED:  # the piece is healthy: nothing to find out on it
        return None
    for hypothesis in hypotheses(piece, vehicle):
        solved, doubt = _tried(*hypothesis.undo(piece, vehicle))
        if solved is not None and doubt < left:
            best, left = Remark(hypothesis.why(solved), hypothesis.remedy(solved), level=1), doubt
        if left < CURED:
            break
    return best


def doubt(solved: Solved) -> float:
    """How much of a solution is doubted: shares of rows, calibrations against their priors, how
    vehicles drive, and what the start contradicts; 0 for none."""
    shares = [doubts.rows_doubted(solved, kind, k.axes)[1] for kind, k in doubts.KINDS.items()]
    rows = sum(float(share.mean()) for share in shares if len(share))
    sigmas = [s for c in solved.calibrated if c.name in doubts.CALIBRATIONS
              for s in doubts.sigmas_off(c)]  # fmt: skip
    excess = PER_SIGMA * np.maximum(np.array(sigmas) - EXCUSED, 0.0)
    odd = CONTRADICTION * (len(driving_findings(solved.run, solved.vehicle)) + len(solved.remarks))
    return rows + float(np.minimum(excess, MOST_SIGMA).sum()) + odd


def _tried(run: Run, vehicle: Vehicle) -> tuple[Solved | None, float]:
    """A coarse solution and how much of it is doubted; None and `UNSOLVED` where there is none."""
    try:
        prep = prepare(run, vehicle, use_gnss=True, outages=(), interval=INTERVAL_S)
        solved = finish(smooth_batch(prep), run)
        return solved, doubt(solved)
    except GraphnavError:
        return None, UNSOLVED


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
