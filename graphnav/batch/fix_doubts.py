"""What fixes say against a path and a path against fixes, used or not."""

import numpy as np

from factors import kinds
from graphnav.batch.doubts import FEW, SURPRISING, distance, of_kind, rows_doubted, scatter, spans
from graphnav.common.remark import Remark
from graphnav.common.run import Array
from graphnav.inertial.alignment import ANOTHER_PLACE
from graphnav.result.solved import Solved

MISCLAIMED = 5.0  # times the claimed deviation
AWAY_M = 20.0  # of [start] from where the fixes put the start; less may be an antenna or a datum
SPANS_TOLD = 6
NEAR_BY = "check [gnss] lever_arm, the fixes' datum, and [start] lat and lon or position_sd_m"
HORIZONTAL = ("east", "north")


def of_fix_deviations(solved: Solved) -> list[Remark]:
    """Fixes that scatter far more than they claim; less is usual, for errors that last."""
    said = []
    for block, _ in of_kind(solved, kinds.GNSS):
        if block.sigma is not None and solved.run.gnss is not None and len(block.time) >= FEW:
            found = float(scatter((block.residual * block.sigma)[:, :2]).max())
            claimed = float(np.median(solved.run.gnss.sd_enu[:, :2]))
            if found > MISCLAIMED * claimed:
                said.append(
                    Remark(
                        f"the fixes scatter by {found:.2g} m and claim an sd of {claimed:.2g} m",
                        "check gnss_sd_e, gnss_sd_n and gnss_sd_u: their column and unit",
                    )
                )
    return said


def of_unused_fixes(solved: Solved, columns: dict[str, Array]) -> list[Remark]:
    """The path far from fixes that were not used, for what they are worth."""
    gnss = solved.run.gnss
    if gnss is None or rows_doubted(solved, kinds.GNSS)[0].size:
        return []
    time = columns["time"] - solved.run.clock_start
    on = (gnss.time >= time[0]) & (gnss.time <= time[-1])
    if on.sum() < FEW:
        return []
    off = [np.interp(gnss.time[on], time, columns[k]) - x
           for k, x in zip("en", solved.fixes_n[on].T, strict=False)]  # fmt: skip
    sd = [np.interp(gnss.time[on], time, columns[f"sd_{k}"]) for k in "en"]
    apart, promised = np.hypot(*off), np.hypot(np.hypot(*sd), np.hypot(*gnss.sd_enu[on, :2].T))
    sigmas = float(np.median(apart / promised))
    if sigmas < SURPRISING:
        return []
    return [
        Remark(
            f"the path lies {distance(float(np.median(apart)))} from the fixes that were not used, "
            f"{sigmas:.0f} times what it promises",
            "smooth with the fixes, or check [start] heading_deg, [imu] axes and the odometer",
            level=1,
        )
    ]


def of_stated_position(solved: Solved, columns: dict[str, Array]) -> list[Remark]:
    """[start] far from where fixes put the start, where that was not found beforehand; nearer, it
    may be the antenna or the datum that is stated wrong."""
    if any(remark.remedy == ANOTHER_PLACE for remark in solved.remarks):
        return []
    at = solved.vehicle.start
    if at.lat is None or at.lon is None or not rows_doubted(solved, kinds.GNSS)[0].size:
        return []
    stated = solved.origin.local(np.deg2rad(at.lat), np.deg2rad(at.lon), np.asarray(0.0))
    off = float(np.hypot(stated[0] - columns["e"][0], stated[1] - columns["n"][0]))
    sd = float(np.hypot(np.hypot(columns["sd_e"][0], columns["sd_n"][0]), at.position_sd_m))
    if off < SURPRISING * sd:
        return []
    why = f"[start] is {distance(off)} from where the fixes put the start"
    return [Remark(why, *((ANOTHER_PLACE, 1) if off > AWAY_M else (NEAR_BY, 0)))]


def of_carried(solved: Solved) -> list[Remark]:
    """Where the vehicle moves although its odometer stands."""
    if solved.moved is None:
        return []
    fixes, clock, said = rows_doubted(solved, kinds.GNSS)[0], solved.run.clock_start, []
    for start, end, horizontally, _ in solved.moved.tolist():
        span = f"from {start + clock:.0f} to {end + clock:.0f} s"
        if not horizontally:
            said.append(Remark(f"the vehicle is lifted or lowered as it stands {span}"))
        elif np.any((fixes >= start) & (fixes <= end)):
            said.append(Remark(f"the odometer stands while the fixes move {span}"))
        else:
            said.append(Remark(f"the odometer stands while the accelerometers move {span}"))
    return said


def where(solved: Solved) -> list[str]:
    """The longest spans in which fixes were doubted, in sentences and in order of time."""
    clock = solved.run.clock_start
    found = spans(*rows_doubted(solved, kinds.GNSS, HORIZONTAL))
    longest = sorted(sorted(found, key=lambda s: s[0] - s[1])[:SPANS_TOLD])
    return [f"GNSS disagreed {a + clock:.0f}-{b + clock:.0f} s: down-weighted" for a, b in longest]
