"""The result is judged before it is given: what the solver doubted, weighed and put in words."""

from dataclasses import replace

import numpy as np

from graphnav.batch import causes, doubts, fix_doubts, noise_doubts
from graphnav.common.remark import Remark
from graphnav.common.run import Array, Run
from graphnav.reading.plausibility import driving_findings
from graphnav.result.quality import Quality, Spread, graded
from graphnav.result.solved import Solved


def judge(solved: Solved, columns: dict[str, Array], used: Run) -> Quality:
    """The quality of a solved run; `columns` of its trajectory as `trajectory.table` makes them,
    `used` the run with the fixes in use only."""
    remarks = [
        *(Remark(said, level=1) for said in _driving(solved)),
        *doubts.of_factors(solved),
        *fix_doubts.of_unused_fixes(solved, columns),
        *doubts.of_motion(columns),
        *fix_doubts.of_stated_position(solved, columns),
        *solved.remarks,
        *doubts.of_start(solved),
        *doubts.of_calibrations(solved.calibrated),
        *noise_doubts.of_inertial_noise(solved),
        *fix_doubts.of_fix_deviations(solved),
        *fix_doubts.of_carried(solved),
    ]
    level = max(remark.level for remark in [Remark(""), *remarks])
    if level and used.imu is not None and used.rover is None:
        found = causes.likeliest(used, solved.vehicle, causes.work_of(solved))
        # of what the cause says already, no more
        cures = [cause.remedy for cause in found if cause.remedy]
        remarks = [remark for remark in remarks if remark.level > 1 or remark.remedy not in cures]
        remarks = [*(replace(c, level=min(c.level, 1) * level) for c in found), *remarks]
    return graded(remarks, *_spreads(columns))


def _driving(solved: Solved) -> list[str]:
    """Where driving contradicts axes or units."""
    return [] if solved.run.imu is None else driving_findings(solved.run, solved.vehicle)


def _spreads(columns: dict[str, Array]) -> tuple[Spread, float]:
    """Horizontal deviation over the run and the usual one of the heading."""
    sd = np.hypot(columns["sd_e"], columns["sd_n"])
    at = int(np.argmax(sd))
    position = Spread(float(np.median(sd)), float(sd[at]), float(columns["time"][at]))
    return position, float(np.median(columns["sd_heading_deg"]))
