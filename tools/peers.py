"""The same run by others, beside graphnav: dead reckoning, plain GTSAM, pyins' Kalman filter.

    python tools/peers.py                                   # every recorded run in ../shared/data
    python tools/peers.py kingston2008 warthog_grass
    python tools/peers.py run.csv --truth truth.csv --outage 120:180 --outage 300:360
    python tools/peers.py run.csv --truth truth.csv --no-gnss --odometer-scale 1.011

Each cell is horizontal rms / max [m] / z, the root mean square of error over its own sigma by axis.
`naive` is ten lines: mean wheel speed along the z gyro less its median at rest, begun where the
truth begins with the heading stated, or else the one that fits best. GTSAM (ImuFactor, GPSFactor)
and pyins (PyPI `python-ins`) get the same samples, start, noise figures and lever arms, GTSAM with
ten times the IMU's noise, pyins with three times the fixes' sigma, which suits them. pyins has no
state for the odometer's scale: give the true one to be kind. Its loop is in pandas, a quarter of
an hour for all runs: `--only naive,graphnav` leaves it out.
"""

import argparse
import runpy
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from normalised_errors import normalised
from pandas import DataFrame
from peer_methods import kalman, naive, plain_gtsam
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table
from smoothed_runs import NoResult, smoothed

from graphnav.common.earth import Origin
from graphnav.common.errors import GraphnavError
from graphnav.common.run import Array, Run
from graphnav.graph.preparation import Prepared, prepare
from graphnav.reading.read import read_run
from graphnav.reading.truth import read_truth
from graphnav.reading.vehicle_file import load_vehicle

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
METHODS = ("naive", "plain GTSAM", "pyins", "graphnav")
Spans = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Trial:
    """A run and what is withheld of it; errors count inside the outages, where there are any."""

    name: str
    run: Path
    truth: Path
    vehicle: Path
    use_gnss: bool = True
    outages: Spans = ()
    scale: float = 1.0  # true over indicated distance, told to pyins


def recorded(scratch: Path) -> Iterator[Trial]:
    """The recorded runs, with fixes and without, or with outages."""

    def trial(name: str, folder: Path, **more: object) -> Trial:
        run, truth = (next(folder.glob(f"{stem}.csv*")) for stem in ("run", "truth"))
        files = (run, truth, folder / "vehicle.toml")
        return Trial(name, *files, **more)  # type: ignore[arg-type]

    kingston = DATA / "kingston2008"
    yield trial("kingston2008", kingston, scale=1.011)
    yield trial("kingston2008, no fixes", kingston, use_gnss=False, scale=1.011)
    yield trial("comma2k19", DATA / "comma2k19")
    yield trial("comma2k19, outage 20-50 s", DATA / "comma2k19", outages=((20.0, 50.0),))
    yield trial("husky", DATA / "husky")
    yield trial("husky, outage 60-360 s", DATA / "husky", outages=((60.0, 360.0),))
    for vehicle in sorted((DATA / "field").glob("*/vehicle.toml")):
        yield trial(vehicle.parent.name, vehicle.parent, use_gnss=False)
    kitti = scratch / "kitti00"
    words, sys.argv = sys.argv, ["kitti00.py", str(kitti)]
    runpy.run_path(str(DATA / "field" / "kitti00.py"))
    sys.argv = words
    yield trial("kitti00", kitti)
    gaps = ((60.0, 120.0), (170.0, 230.0), (280.0, 340.0), (390.0, 450.0))
    yield trial("kitti00, 4 outages of 60 s", kitti, outages=gaps)


def fitted_heading(run: Run, truth: DataFrame, origin: Origin) -> float:
    """Start heading [rad] that turns the naive path onto the truth, where nothing states it."""
    path = naive(run, 0.0, origin)
    own, true = (local(table, origin) for table in (path, truth))
    at = np.stack([np.interp(truth["time"], path["time"], x) for x in own.T], -1)
    a, b = ((x - x[0]) @ [1, 1j] for x in (at, true))
    return float(-np.angle(np.sum(b * a.conj())))


def local(table: DataFrame, origin: Origin) -> Array:
    """East and north (N, 2) m."""
    lla = np.deg2rad(table["lat"]), np.deg2rad(table["lon"]), table["height"]
    return origin.local(*(np.asarray(x) for x in lla))[:, :2]


def begun(truth: DataFrame) -> Origin:
    """The frame at the truth's first point."""
    first = truth.iloc[0]
    return Origin(np.deg2rad(first["lat"]), np.deg2rad(first["lon"]), first["height"])


def figures(found: DataFrame, truth: DataFrame, spans: Spans, shift: bool = False) -> str:
    """rms / max / z of a path, inside the spans where there are any; `shift`: starts at truth's."""
    time = truth["time"].to_numpy()
    chosen = (time >= found["time"].iloc[0]) & (time <= found["time"].iloc[-1])
    if spans:
        chosen &= np.any([(time >= a) & (time <= b) for a, b in spans], axis=0)
    kept = truth[chosen].reset_index(drop=True)
    origin = begun(truth)
    path = local(found, origin)
    at = np.stack([np.interp(kept["time"], found["time"], x) for x in path.T], -1)
    error = at - local(kept, origin)
    error -= error[0] if shift else 0.0
    size = np.hypot(*error.T)
    if "sd_e" not in found:
        return f"{np.sqrt(np.mean(size**2)):.2f} / {size.max():.2f}"
    table = found.assign(e=path[:, 0], n=path[:, 1])[["time", "e", "n", "sd_e", "sd_n"]]
    z = normalised(table, kept[["time", "lat", "lon", "height"]], origin)["position"]
    return f"{np.sqrt(np.mean(size**2)):.2f} / {size.max():.2f} / {np.sqrt(np.mean(z**2)):.1f}"


def cells(trial: Trial, chosen: list[str]) -> list[str]:
    """What each method makes of a trial."""
    vehicle = load_vehicle(trial.vehicle, trial.run)
    run = read_run(trial.run, vehicle)
    truth = read_truth(trial.truth)
    prep = prepare(run, vehicle, use_gnss=trial.use_gnss, outages=trial.outages)
    stated = vehicle.start.heading_deg
    methods: dict[str, Callable[[], str]] = {
        "naive": lambda: _naive(run, truth, stated, trial.outages),
        "plain GTSAM": lambda: _gtsam(prep, truth, trial.outages),
        "pyins": lambda: figures(kalman(prep, trial.scale), truth, trial.outages),
        "graphnav": lambda: _graphnav(trial, truth),
    }
    found = []
    for method in chosen:
        try:
            found.append(methods[method]())
        except (GraphnavError, NoResult, RuntimeError, ValueError, IndexError) as error:
            print(f"{trial.name}: {method}: {str(error).splitlines()[0]}", file=sys.stderr)
            found.append("no result")
    return found


def _naive(run: Run, truth: DataFrame, stated: float | None, spans: Spans) -> str:
    if run.odometer is None or spans:  # through an outage it would begin anew: another method
        return ""
    origin = begun(truth)
    heading = fitted_heading(run, truth, origin) if stated is None else np.deg2rad(stated)
    return figures(naive(run, float(heading), origin), truth, spans, shift=True)


def _gtsam(prep: Prepared, truth: DataFrame, spans: Spans) -> str:
    if prep.sensed.gnss is None:
        return ""
    return figures(plain_gtsam(prep), truth, spans)


def _graphnav(trial: Trial, truth: DataFrame) -> str:
    options = [f"--outage={start:g}:{end:g}" for start, end in trial.outages]
    options += [] if trial.use_gnss else ["--no-gnss"]
    result = smoothed(trial.run, trial.vehicle, *options)
    grade = result.summary.get("quality", {}).get("grade", "")
    mark = "" if grade == "good" else f" ({grade})"
    return figures(result.trajectory, truth, trial.outages) + mark


def trials(options: argparse.Namespace, scratch: Path) -> Iterator[Trial]:
    """What the command line asks for."""
    if not options.truth:
        for trial in recorded(scratch):
            if not options.runs or trial.name.split(",")[0] in options.runs:
                yield trial
        return
    outages = tuple((float(a), float(b)) for a, b in (o.split(":") for o in options.outage))
    for name in options.runs:
        run = Path(name)
        vehicle = options.vehicle or run.with_name("vehicle.toml")
        use_gnss, scale = not options.no_gnss, options.odometer_scale
        yield Trial(name, run, options.truth, vehicle, use_gnss, outages, scale)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", metavar="RUN", help="recorded runs, or a file")
    parser.add_argument("--truth", type=Path, help="of the file")
    parser.add_argument("--vehicle", type=Path)
    parser.add_argument("--no-gnss", action="store_true")
    parser.add_argument("--outage", action="append", default=[], metavar="START:END")
    parser.add_argument("--odometer-scale", type=float, default=1.0)
    parser.add_argument(
        "--only", default=",".join(METHODS), help="naive,plain GTSAM,pyins,graphnav"
    )
    options = parser.parse_args()
    chosen = [method for method in METHODS if method in options.only.split(",")]
    table = Table(box=MARKDOWN)
    table.add_column("rms / max [m] / z")
    for method in chosen:
        table.add_column(method, justify="right")
    with tempfile.TemporaryDirectory() as scratch:
        for trial in trials(options, Path(scratch)):
            try:
                table.add_row(trial.name, *cells(trial, chosen))
            except GraphnavError as error:
                print(f"{trial.name}: {error}", file=sys.stderr)
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
