"""`graphnav smooth`: run file and vehicle file in, result directory out. Disk only at both ends."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.linalg import LinAlgError

from graphnav.common.errors import InputError, SolutionError
from graphnav.common.progress import Stages
from graphnav.common.run import Run
from graphnav.inertial.measured import measured
from graphnav.reading.bounds import check_solution
from graphnav.reading.check import check
from graphnav.reading.outages import Outages, described, in_use
from graphnav.reading.plain_file import check_file
from graphnav.reading.read import read_run
from graphnav.reading.vehicle import Vehicle
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import tables, trajectory
from graphnav.result.quality import Quality
from graphnav.result.solved import Solved
from graphnav.result.summary import Judged, calibration, summary, write_json
from graphnav.result.writing import kept_aside, whole_directory
from graphnav.views.views import Views

if TYPE_CHECKING:
    from pandas import DataFrame

    from graphnav.graph.preparation import Prepared

COMPARED_HZ = 10.0  # truth is compared at this rate at least, whatever is written


@dataclass(frozen=True)
class SmoothOptions:
    """How a run is to be smoothed and what is to be written; interface.md says more of each."""

    vehicle_path: Path | None = None
    truth: Path | None = None
    mode: str = "batch"
    lag: float | None = None  # s kept open behind the newest node of an incremental solution
    rate_hz: float = 10.0  # rows of the trajectory
    nodes_hz: float = 1.0
    use_gnss: bool = True
    outages: Outages = ()
    csv: bool = False
    rrd: bool = True
    report: bool = False

    @property
    def views(self) -> list[str]:
        """The views to make."""
        return [kind for kind, on in (("recording", self.rrd), ("report", self.report)) if on]


DEFAULT = SmoothOptions()


def smooth(
    run_path: Path, out: Path, options: SmoothOptions = DEFAULT, progress: Stages | None = None
) -> Quality:
    """Smooth one run and write its result directory.

    What is returned says how far the result can be relied on; a rejected one is written too.

    Raises `InputError` when the input or the options are at fault, `SolutionError` when the sensors
    leave the solution undetermined.
    """
    progress = progress or Stages(show=False)
    progress("reading")
    vehicle = load_vehicle(options.vehicle_path, run_path)
    read = read_run(run_path, vehicle)
    check_solution(read, options.mode, options.nodes_hz, options.rate_hz)
    run = measured(read)
    reference, of_truth = _truth(options.truth)
    findings = check(run, vehicle, options.use_gnss) + described(run, options.outages) + of_truth
    with Views(options.views) as views:
        solved = solve(run, vehicle, options, progress)
        progress("trajectory")
        columns = trajectory.table(solved, options.rate_hz)
        dense = columns
        if options.rate_hz < COMPARED_HZ:
            dense = trajectory.table(solved, COMPARED_HZ)
        used = replace(run, gnss=in_use(run, vehicle, options.use_gnss, options.outages))
        quality = judge(solved, dense, used, progress)
        reference, comparison, misfit = _compared(dense, reference, progress)
        findings += misfit
        with whole_directory(out) as directory:
            progress("writing")
            judged = Judged(solved, quality, findings + kept_aside(out), said_of(solved))
            write(judged, columns, reference, comparison, options.csv, directory)
            views.make(directory, progress)
            progress.done()
            _update_stages(directory, progress)
    return quality


def judge(solved: Solved, columns: dict[str, Any], used: Run, progress: Stages) -> Quality:
    """The result's grade; `columns` of its trajectory, `used` the run with the fixes in use."""
    from graphnav.batch import judgement

    progress("judging")
    with _cause_named(used):  # likely causes are tried by solving again
        return judgement.judge(solved, columns, used)


def said_of(solved: Solved) -> list[str]:
    """What a reader of the result should know, in sentences."""
    from graphnav.batch import fix_doubts

    return [*solved.verdicts, *fix_doubts.where(solved)]


def solve(
    run: Run, vehicle: Vehicle, options: SmoothOptions = DEFAULT, progress: Stages | None = None
) -> Solved:
    """The solver for this kind of vehicle and these sensors.

    Raises SolutionError, naming the likeliest sensor, where its linear algebra breaks down.
    """
    with _cause_named(run):
        return _solved(run, vehicle, options, progress)


@contextmanager
def _cause_named(run: Run) -> Iterator[None]:
    """Linear algebra that breaks down, told as a SolutionError with the likeliest sensor."""
    try:
        yield
    except (LinAlgError, OverflowError, FloatingPointError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "ndeterminate linear system" not in str(error):
            raise
        from graphnav.graph.contradiction import most_unusual

        raise SolutionError(
            f"the sensors leave the solution undetermined; {most_unusual(run)}"
        ) from error


def _solved(run: Run, vehicle: Vehicle, options: SmoothOptions, progress: Stages | None) -> Solved:
    """As `solve`, whatever it raises."""
    progress = progress or Stages(show=False)
    use_gnss, outages = options.use_gnss, options.outages
    if options.lag is not None and options.mode != "incremental":
        raise InputError("--lag is for --mode incremental: give both or neither")
    if vehicle.kind == "rover" and run.rover is not None:
        if options.mode == "incremental":
            raise InputError(f"{run.path}: rovers are smoothed in batch only: leave out --mode")
        from graphnav.rover.result import solve_rover

        return solve_rover(run, vehicle, use_gnss=use_gnss, outages=outages, progress=progress)
    from graphnav.batch.finish import finish
    from graphnav.batch.smoother import smooth_batch
    from graphnav.graph.preparation import prepare

    progress("preparing")
    prep = prepare(
        run,
        vehicle,
        use_gnss=use_gnss,
        outages=outages,
        interval=1 / options.nodes_hz,
    )
    if options.mode == "incremental":
        return _solve_incremental(run, prep, options, progress)
    return finish(smooth_batch(prep, progress), run, options.rate_hz)


def _solve_incremental(
    run: Run, prep: "Prepared", options: SmoothOptions, progress: Stages
) -> Solved:
    """The batch solution with what a stream knew of it."""
    from graphnav.batch.finish import finish
    from graphnav.stream import replay

    replayed = replay.smooth_incremental(prep, options.lag, progress)
    progress.beside(replayed.peak_memory_mb)
    solved = finish(replayed.smoothed, run, options.rate_hz)
    return replace(
        solved,
        solver=solved.solver | replayed.solver,
        causal=replay.causal(replayed, prep),
        verdicts=solved.verdicts + replay.verdicts(replayed),
    )


def write(
    judged: Judged,
    columns: dict[str, Any],
    reference: "DataFrame | None",
    comparison: dict[str, Any] | None,
    csv: bool,
    directory: Path,
) -> None:
    """Every file of the result directory but the views made from them.

    `columns` is the trajectory to write.
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
    write_json(directory / "calibration.json", calibration(solved))
    said = summary(judged, table, len(slips), comparison)
    write_json(directory / "summary.json", said)


def _update_stages(directory: Path, progress: Stages) -> None:
    """Seconds by stage and memory in all, once every stage has ended."""
    path = directory / "summary.json"
    said = json.loads(path.read_text(encoding="utf-8"))
    said["stages"] = {name: round(seconds, 3) for name, seconds in progress.seconds.items()}
    said["peak_memory_mb"] = round(progress.peak_memory_mb, 1)
    write_json(path, said)


def _truth(path: Path | None) -> tuple["DataFrame | None", list[str]]:
    """The reference and findings on it; one that cannot be read costs the comparison only."""
    if path is None:
        return None, []
    from graphnav.reading.truth import read_truth

    check_file(path, "truth file", "give one with --truth, or leave it out")
    try:
        truth = read_truth(path)
    except InputError as error:
        return None, [f"not compared with truth: {error}"]
    return truth, list(truth.attrs["notes"])


def _compared(
    columns: dict[str, Any], reference: "DataFrame | None", progress: Stages
) -> tuple["DataFrame | None", dict[str, Any] | None, list[str]]:
    """The reference where it fits the trajectory, the comparison with it, and why there is none."""
    if reference is None:
        return None, None, []
    import pandas as pd

    from graphnav.result.compare import compare

    progress("comparing")
    try:
        return reference, compare(pd.DataFrame(columns), reference).as_dict(), []
    except InputError as error:
        return None, None, [f"not compared with truth: {error}"]
