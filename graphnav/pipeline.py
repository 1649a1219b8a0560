"""`graphnav smooth`: run file and vehicle file in, result directory out. Disk only at both ends."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graphnav.common.errors import InputError
from graphnav.common.progress import Stages
from graphnav.common.run import Run
from graphnav.reading.check import check
from graphnav.reading.outages import Outages
from graphnav.reading.outages import told as outages_told
from graphnav.reading.read import read_run
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import tables, trajectory
from graphnav.result.quality import Quality
from graphnav.result.solved import Calibrated, Solved
from graphnav.result.writing import whole_directory
from graphnav.views.views import Views

if TYPE_CHECKING:
    from pandas import DataFrame

COMPARED_HZ = 10.0  # truth is compared at this rate at least, whatever is written


def smooth(
    run_path: Path,
    *,
    vehicle_path: Path | None = None,
    out: Path,
    mode: str = "batch",
    truth: Path | None = None,
    rate_hz: float = 10.0,
    nodes_hz: float = 1.0,
    rrd: bool = True,
    report: bool = False,
    outages: Outages = (),
    use_gnss: bool = True,
    csv: bool = False,
    lag: float | None = None,
    progress: Stages | None = None,
) -> Quality:
    """Smooth one run and write its result directory; see interface.md for every option.

    What is returned says how far the result can be relied on; a rejected one is written too.

    Raises `InputError` when the input or the options are at fault, `SolutionError` when the sensors
    leave the solution undetermined.
    """
    told = progress or Stages(show=False)
    told("reading")
    vehicle = load_vehicle(vehicle_path, run_path)
    run = read_run(run_path, vehicle)
    reference = _truth(truth)
    findings = check(run, vehicle, use_gnss) + outages_told(run, outages)
    kinds = [kind for kind, on in (("recording", rrd), ("report", report)) if on]
    with Views(kinds) as views:
        solved = solve(run, vehicle, use_gnss, outages, rate_hz, told, mode, lag, nodes_hz)
        told("trajectory")
        columns = trajectory.table(solved, rate_hz)
        dense = columns if rate_hz >= COMPARED_HZ else trajectory.table(solved, COMPARED_HZ)
        quality = judge(solved, dense, told)
        with whole_directory(out) as directory:
            told("writing")
            judged = Judged(solved, quality, findings)
            write(judged, columns, dense, reference, csv, directory, told)
            views.make(directory, told)
            told.done()
            _update_stages(directory, told)
    return quality


@dataclass(frozen=True)
class Judged:
    """A solved run with all that is said about it."""

    solved: Solved
    quality: Quality
    findings: list[str]  # about what was read


def judge(solved: Solved, columns: dict[str, Any], told: Stages) -> Quality:
    """The result's grade; `columns` of its trajectory."""
    from graphnav.batch import judgement

    told("judging")
    return judgement.judge(solved, columns)


def solve(
    run: Run,
    vehicle: Vehicle,
    use_gnss: bool,
    outages: Outages,
    rate_hz: float,
    told: Stages,
    mode: str = "batch",
    lag: float | None = None,
    nodes_hz: float = 1.0,
) -> Solved:
    """The solver for this kind of vehicle and these sensors."""
    if lag is not None and mode != "incremental":
        raise InputError("--lag is for --mode incremental: give both or neither")
    if vehicle.kind == "rover" and run.rover is not None:
        if mode == "incremental":
            raise InputError(f"{run.path}: rovers are smoothed in batch only: leave out --mode")
        from graphnav.rover.result import solve_rover

        return solve_rover(run, vehicle, use_gnss=use_gnss, outages=outages, told=told)
    from graphnav.batch.finish import finish
    from graphnav.batch.smoother import smooth as smooth_prepared
    from graphnav.graph.preparation import prepare

    told("preparing")
    prep = prepare(
        run, vehicle, use_gnss=use_gnss, outages=outages, rate_hz=rate_hz, interval=1 / nodes_hz
    )
    if mode == "incremental":
        from graphnav.stream import replay as incremental

        replay = incremental.smooth(prep, lag, told)
        told.beside(replay.peak_memory_mb, since="dead reckoning")
        solved = finish(replay.smoothed, run)
        known = incremental.causal(replay, prep)
        said = solved.verdicts + incremental.verdicts(replay)
        solver = solved.solver | replay.solver
        return replace(solved, solver=solver, causal=known, verdicts=said)
    return finish(smooth_prepared(prep, told), run)


def write(
    judged: Judged,
    columns: dict[str, Any],
    comparable: dict[str, Any],
    reference: "DataFrame | None",
    csv: bool,
    directory: Path,
    told: Stages,
) -> None:
    """Every file of the result directory but the views made from them.

    `columns` is the trajectory to write, `comparable` the one dense enough to hold against truth.
    """
    import pandas as pd

    solved = judged.solved
    table = pd.DataFrame(columns)
    table.attrs["quality"] = judged.quality.grade
    table.to_parquet(directory / "trajectory.parquet", index=False)
    if csv:
        table.to_csv(directory / "trajectory.csv", index=False)
    tables.states(solved).to_csv(directory / "states.csv", index=False)
    slips = [*tables.slips(solved), *solved.wheel_events]
    tables.event_table(slips, solved.run.clock_start).to_csv(directory / "events.csv", index=False)
    optional = {
        "residuals": tables.residuals(solved),
        "dead_reckoning": tables.reckoned(solved),
        "odometer": tables.odometer(solved),
        "gnss": tables.fixes(solved),
        "truth": None if reference is None else tables.truth(solved, reference),
        "trajectory_causal": None if solved.causal is None else pd.DataFrame(solved.causal),
    }
    for name, frame in optional.items():
        if frame is not None:
            frame.to_parquet(directory / f"{name}.parquet", index=False)
    comparison = None
    if reference is not None:
        from graphnav.result.compare import compare

        told("comparing")
        comparison = compare(pd.DataFrame(comparable), reference).as_dict()
    _write_json(directory / "calibration.json", calibration(solved))
    said = summary(judged, table, len(slips), comparison)
    _write_json(directory / "summary.json", said)


def calibration(solved: Solved) -> dict[str, Any]:
    """calibration.json."""
    return {c.name: _told(c, solved.run.clock_start) for c in solved.calibrated}


def _told(c: Calibrated, clock: float) -> dict[str, Any]:
    return {
        "unit": c.unit,
        "components": list(c.components),
        "constant": c.constant,
        "time": np.round(c.time + clock, 3).tolist(),
        "value": c.value.tolist(),
        "sd": c.sd.tolist(),
        "prior": c.prior.tolist(),
        "prior_sd": c.prior_sd.tolist(),
        "observable": c.observable,
    }


def summary(
    judged: Judged,
    table: "DataFrame",
    slips: int,
    comparison: dict[str, Any] | None,
) -> dict[str, Any]:
    """summary.json, stages left out."""
    from graphnav.batch import doubts

    solved = judged.solved
    origin = solved.origin
    step = np.diff(table[["e", "n", "u"]].to_numpy(), axis=0)
    quiet = np.hypot(table["v_e"], table["v_n"]).to_numpy()[1:] > 0.02
    found = {
        "graphnav": 1,
        "quality": judged.quality.as_dict(),
        "run": str(solved.run.path),
        "vehicle": solved.vehicle.body.name or solved.vehicle.kind,
        "kind": solved.vehicle.kind,
        "origin": {
            "lat": float(np.rad2deg(origin.lat)),
            "lon": float(np.rad2deg(origin.lon)),
            "height": origin.height,
        },
        "duration_s": float(solved.path.time[-1] - solved.path.time[0]),
        "distance_m": float(np.linalg.norm(step, axis=1)[quiet].sum()),
        "states": {
            name: {"count": count, "seconds": round(seconds, 3)}
            for name, (count, seconds) in solved.timeline.totals().items()
        },
        "events": slips,
        "solver": solved.solver,
        "residuals": _residuals(solved),
        "warnings": judged.findings,
        "verdicts": [*solved.verdicts, *doubts.where(solved)],
    }
    if comparison is not None:
        found["comparison"] = comparison
        # interface.md names these at the top
        found |= {k: comparison[k] for k in PROMISED}
    return found


PROMISED = (
    "horizontal_rms_m",
    "horizontal_max_m",
    "horizontal_end_m",
    "permille_of_distance",
    "heading_rms_deg",
    "nees_horizontal",
)


def _residuals(solved: Solved) -> dict[str, Any]:
    """Root mean square of the whitened residuals and share of doubted rows, by factor kind."""
    found = {}
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        if len(block.time):
            found[block.kind] = {
                "count": len(block.time),
                "rms": float(np.sqrt(np.mean(weight * block.residual**2))),
                "doubted": float(np.mean(weight < 0.5)),
            }
    return found


def _update_stages(directory: Path, told: Stages) -> None:
    """Seconds and memory by stage, once all of them have ended."""
    path = directory / "summary.json"
    said = json.loads(path.read_text(encoding="utf-8"))
    said["stages"] = {name: round(seconds, 3) for name, seconds in told.seconds.items()}
    said["stage_memory_mb"] = {name: round(mb, 1) for name, mb in told.memory_mb.items()}
    said["peak_memory_mb"] = round(told.peak_memory_mb, 1)
    _write_json(path, said)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def _truth(path: Path | None) -> "DataFrame | None":
    if path is None:
        return None
    from graphnav.reading.truth import read_truth

    return read_truth(path)
