"""`graphnav validate`: a run smoothed again with fixes withheld in turn. No truth is needed."""

import json
from pathlib import Path
from typing import Any

from graphnav.common.errors import InputError
from graphnav.common.progress import Stages
from graphnav.common.run import Run
from graphnav.inertial.measured import measured
from graphnav.pipeline import SmoothOptions, solve
from graphnav.reading.bounds import check_solution
from graphnav.reading.check import check
from graphnav.reading.read import read_run
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import withheld
from graphnav.result.withheld import Promise
from graphnav.result.writing import keep_in_result

NAME = "validation.json"
LENGTHS_S = (10.0, 30.0, 60.0, 120.0)
LEAST_FIXES = 30


def validate(
    run_path: Path,
    vehicle_path: Path | None,
    result: Path,
    *,
    lengths: tuple[float, ...] = LENGTHS_S,
    progress: Stages | None = None,
) -> tuple[dict[str, Any], Path]:
    """Withhold fixes in blocks of each of `lengths` s; what was found and the file it is kept in.

    The file lies in the directory `result` where that is one of graphnav's, else beside the run.
    Raises InputError when the run has too few fixes to withhold any.
    """
    progress = progress or Stages(show=False)
    progress("reading")
    vehicle = load_vehicle(vehicle_path, run_path)
    read = read_run(run_path, vehicle)
    check_solution(read)
    run = measured(read)
    check(run, vehicle)
    if run.gnss is None or not vehicle.gnss.use or len(run.gnss.time) < LEAST_FIXES:
        raise InputError(f"{run_path}: needs at least {LEAST_FIXES} fixes in use to withhold some")
    found = promises(run, vehicle, lengths, progress)
    if not found:
        raise InputError(
            f"{run_path}: its fixes span too little time to withhold {min(lengths):g} s of them"
        )
    said = {
        "run": str(run_path),
        "said": withheld.in_words(found),
        "blocks": [p.as_dict() for p in found],
    }
    file = keep_in_result(result, NAME, run_path, json.dumps(said, indent=1, allow_nan=False))
    return said, file


def promises(
    run: Run, vehicle: Vehicle, lengths: tuple[float, ...], progress: Stages
) -> list[Promise]:
    """Smooth the run whole and once for each block length; lengths without a block are left out."""
    assert run.gnss is not None
    progress("all fixes")
    fixes = withheld.believed(solve(run, vehicle))
    found = []
    for length in lengths:
        held = withheld.blocks(run.gnss.time, length)
        if held:
            progress(f"without {length:g} s")
            outages = [(a + run.clock_start, b + run.clock_start) for a, b in held]
            without = solve(run, vehicle, SmoothOptions(outages=outages))
            each = withheld.promise(without, fixes, held, length)
            found += [each] if each else []
    return found
