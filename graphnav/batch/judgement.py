"""The result is judged before it is given: what the solver doubted, weighed and put in words."""

import numpy as np

from graphnav.batch import causes, doubts
from graphnav.common.run import Array, Run
from graphnav.reading.plausibility import driving_findings
from graphnav.result.quality import Doubt, Quality, Spread, graded
from graphnav.result.solved import Solved


def judge(solved: Solved, columns: dict[str, Array], used: Run) -> Quality:
    """The quality of a solved run; `columns` of its trajectory as `trajectory.table` makes them,
    `used` the run with the fixes in use only."""
    found = _doubts(solved, columns)
    if any(d.level for d in found) and used.imu is not None and used.rover is None:
        cause = causes.likeliest(used, solved.vehicle)
        if cause is not None:
            level = max(d.level for d in found)
            found = [Doubt(level, cause.why, cause.remedy), *found]
    return graded(found, *_spreads(columns))


def _doubts(solved: Solved, columns: dict[str, Array]) -> list[Doubt]:
    return [
        *(Doubt(remark.level, remark.why, remark.remedy) for remark in solved.remarks),
        *doubts.of_start(solved),
        *doubts.of_calibrations(solved.calibrated),
        *(Doubt(1, said) for said in _driving(solved)),
        *doubts.of_factors(solved),
        *doubts.of_unused_fixes(solved, columns),
        *doubts.of_motion(columns),
        *doubts.of_inertial_noise(solved),
    ]


def _driving(solved: Solved) -> list[str]:
    """Where driving contradicts axes or units."""
    return [] if solved.run.imu is None else driving_findings(solved.run, solved.vehicle)


def _spreads(columns: dict[str, Array]) -> tuple[Spread, float]:
    """Horizontal deviation over the run and the usual one of the heading."""
    sd = np.hypot(columns["sd_e"], columns["sd_n"])
    at = int(np.argmax(sd))
    position = Spread(float(np.median(sd)), float(sd[at]), float(columns["time"][at]))
    return position, float(np.median(columns["sd_heading_deg"]))
