"""The `graphnav` command. Every import that takes time waits until its command runs."""

import gc
import sys
from pathlib import Path
from typing import Any

import click

from graphnav import __version__
from graphnav.cli.command import Finite, Numbers, OneLine, Place, ResultPlace, report_failures
from graphnav.cli.simulate import simulate

FORMATS = ("kml", "geojson", "gpx", "tum", "csv", "sbet", "nmea")
PATH = Place()
result = click.argument("directory", type=ResultPlace(), metavar="RESULT")
vehicle_file = click.option(
    "--vehicle", type=PATH, help="Vehicle file.  [default: vehicle.toml beside RUN]"
)
result_directory = click.option(
    "--out", type=PATH, help="Result directory.  [default: <run stem>_graphnav beside RUN]"
)


@click.group(cls=OneLine, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="graphnav")
def cli() -> None:
    """Where did the vehicle drive? Post-mission trajectories without satellites.

    graphnav takes the recording of an IMU and an odometer (GNSS where there was any), recognises
    how the vehicle moved, and smooths the whole mission at once in a factor graph.

    \b
    Try it on a simulated tracked vehicle:
      graphnav simulate tracked --out demo --seed 1
      graphnav smooth demo/run.csv.gz --truth demo/truth.csv.gz
      graphnav show demo/run_graphnav

    \b
    Your own run: a CSV or Parquet file with the columns
      time [s]  gyro_x gyro_y gyro_z [rad/s]  accel_x accel_y accel_z [m/s^2]
      odo_speed [m/s] or odo_pulses           gnss_lat gnss_lon gnss_height (optional)
    blank cells where a sensor has no sample, and beside it vehicle.toml with at least
      [vehicle]
      kind = "wheeled"        # or tracked, rover

    Exit status: 0 done, 1 no solution, 2 input or option at fault, 3 written but rejected.
    """


@cli.command(short_help="A run file into a result directory.")
@click.argument("run", type=PATH)
@vehicle_file
@result_directory
@click.option(
    "--mode",
    type=click.Choice(["batch", "incremental"]),
    default="batch",
    show_default=True,
    help="Whole mission at once, or iSAM2 with a causal preview.",
)
@click.option("--truth", type=PATH, help="Reference to compare with: time lat lon height ...")
@click.option(
    "--rate",
    type=Finite(0.1, 1000),
    default=10.0,
    show_default=True,
    metavar="HZ",
    help="Rows per second of trajectory.parquet.",
)
@click.option(
    "--nodes",
    type=Finite(0.2, 10),
    default=1.0,
    show_default=True,
    metavar="HZ",
    help="States solved for per second of driving; time and memory grow with it.",
)
@click.option(
    "--lag",
    type=Finite(0, 1e6, min_open=True),
    metavar="S",
    help="Incremental: seconds kept open behind the newest node.",
)
@click.option(
    "--outage",
    type=Numbers(2, ":", "START:END"),
    multiple=True,
    metavar="START:END",
    help="Withhold GNSS fixes in this span of the run's clock [s]; repeatable.",
)
@click.option("--gnss/--no-gnss", default=True, help="Ignore every fix, except in the report.")
@click.option("--csv", is_flag=True, help="Write trajectory.csv too.")
@click.option("--rrd/--no-rrd", default=True, help="Recording for the rerun viewer.")
@click.option("--report/--no-report", default=False, help="One-page report.html too.")
def smooth(
    run: Path, vehicle: Path | None, out: Path | None, truth: Path | None, **more: Any
) -> None:
    """Smooth the run file RUN (.csv, .csv.gz, .parquet) into a result directory.

    \b
    Examples:
      graphnav smooth run.csv
      graphnav smooth run.csv --truth truth.csv --outage 600:660 --outage 900:960
      graphnav smooth run.csv --no-gnss --out results/without

    The directory appears at once when all is done, and replaces an earlier result only. It holds
    trajectory.parquet, states.csv, calibration.json, summary.json and run.rrd;
    `graphnav report RESULT` adds a page to read or print.
    """
    from graphnav.common.progress import Stages
    from graphnav.result.writing import check_replaceable, default_out, restore

    out = out or default_out(run)
    restore(out)
    check_replaceable(out, (run, vehicle, truth))
    with Stages() as stages:
        stages("starting")
        from graphnav import pipeline

        options = pipeline.SmoothOptions(
            vehicle_path=vehicle,
            truth=truth,
            mode=more["mode"],
            lag=more["lag"],
            rate_hz=more["rate"],
            nodes_hz=more["nodes"],
            use_gnss=more["gnss"],
            outages=more["outage"],
            csv=more["csv"],
            rrd=more["rrd"],
            report=more["report"],
        )
        quality = pipeline.smooth(run, out, options, stages)
    from graphnav.cli.digest import digest, raise_if_rejected

    click.echo(digest(out))
    raise_if_rejected(run, quality)


@cli.command(short_help="What is noteworthy about a run file, without smoothing.")
@click.argument("run", type=PATH)
@vehicle_file
@click.option("--gnss/--no-gnss", default=True, help="Check as if without fixes.")
def check(run: Path, vehicle: Path | None, gnss: bool) -> None:
    """Read RUN and its vehicle file and say what is noteworthy, without smoothing."""
    from graphnav.inertial.measured import measured
    from graphnav.reading.bounds import check_solution
    from graphnav.reading.check import check as findings_of
    from graphnav.reading.read import read_run
    from graphnav.reading.vehicle_file import load_vehicle

    described = load_vehicle(vehicle, run)
    read = read_run(run, described)
    check_solution(read)
    recorded = measured(read)
    findings = findings_of(recorded, described, gnss)
    for finding in findings:
        click.echo(f"- {finding}")
    click.echo(f"{run}: {recorded.end:.1f} s, {len(findings)} finding(s)")


@cli.command(short_help="Are a run's deviations honest? Fixes withheld in turn.")
@click.argument("run", type=PATH)
@vehicle_file
@result_directory
@click.option(
    "--block",
    "lengths",
    type=Finite(1, 3600),
    multiple=True,
    default=(10.0, 30.0, 60.0, 120.0),
    show_default=True,
    metavar="S",
    help="Length of the blocks of fixes withheld; repeatable.",
)
def validate(run: Path, vehicle: Path | None, out: Path | None, lengths: tuple[float, ...]) -> None:
    """Smooth RUN with fixes withheld in turn, and hold the path against them.

    Says how far the path was off at the withheld fixes and what it had promised, by the length of
    the blocks; kept as validation.json in the result directory, or beside RUN where there is none.
    """
    from graphnav.cli import validation_table
    from graphnav.common.progress import Stages
    from graphnav.result.writing import default_out
    from graphnav.validation import validate as validated

    with Stages() as stages:
        said, file = validated(run, vehicle, out or default_out(run), progress=stages)
    validation_table.show(said["blocks"], run.name)
    click.echo(said["said"])
    click.echo(f"wrote {file}")


@cli.command(short_help="A result against a reference.")
@click.argument("result_path", type=ResultPlace(), metavar="RESULT")
@click.argument("truth", type=PATH)
@click.option("--json", "as_json", is_flag=True, help="For machines.")
def compare(result_path: Path, truth: Path, as_json: bool) -> None:
    """Compare RESULT (a result directory or a trajectory file) with the file TRUTH."""
    from graphnav.cli import comparison_table
    from graphnav.reading.truth import read_trajectory, read_truth
    from graphnav.result.compare import compare as compared

    comparison = compared(read_trajectory(result_path), read_truth(truth))
    if as_json:
        import json

        click.echo(json.dumps(comparison.as_dict(), indent=1))
    else:
        comparison_table.show(comparison, result_path.name)


cli.add_command(simulate)


@cli.command(short_help="Open a result in the rerun viewer.")
@result
def show(directory: Path) -> None:
    """Open run.rrd of RESULT in the rerun viewer."""
    from graphnav.result.writing import own_files
    from graphnav.views.show import open_viewer

    with own_files(directory):
        click.echo(open_viewer(directory))


@cli.command(short_help="Make run.rrd of a result anew.")
@result
def rrd(directory: Path) -> None:
    """Make run.rrd of RESULT anew."""
    from graphnav.result.writing import own_files
    from graphnav.views.show import rebuild

    with own_files(directory):
        click.echo(f"wrote {rebuild(directory)}")


@cli.command(short_help="Make report.html of a result anew.")
@result
def report(directory: Path) -> None:
    """Make report.html of RESULT anew."""
    from graphnav.result import result_directory as results
    from graphnav.result.writing import adopt, own_files
    from graphnav.views import report as one_page

    with own_files(directory):
        one_page.write(results.load(directory), directory / "report.html")
    adopt(directory, directory / "report.html")
    click.echo(f"wrote {directory / 'report.html'}")


@cli.command(short_help="A trajectory for Google Earth, GIS, evo and others.")
@result
@click.option("--to", "form", type=click.Choice(FORMATS), required=True, help="Format.")
@click.option(
    "--at",
    type=Numbers(3, ",", "X,Y,Z"),
    metavar="X,Y,Z",
    help="Point of the vehicle, from the IMU: right, forward, up [m].",
)
@click.option("--file", type=PATH, help="File to write.  [default: RESULT/export/trajectory.*]")
def export(
    directory: Path, form: str, at: tuple[float, float, float] | None, file: Path | None
) -> None:
    """Write the trajectory of RESULT for another program.

    \b
    Examples:
      graphnav export run_graphnav --to kml
      graphnav export run_graphnav --to gpx --at 0,-1.2,1.8 --file antenna.gpx
    """
    from graphnav import export as exports
    from graphnav.result import result_directory as results
    from graphnav.result.writing import adopt, own_files

    with own_files(directory):
        loaded = results.load(directory)
        file = file or directory / "export" / f"trajectory{exports.SUFFIX[form]}"
        file.parent.mkdir(parents=True, exist_ok=True)
        exports.write(loaded, form, file, at)
    adopt(directory, file)
    click.echo(f"wrote {file}")


def main() -> None:
    """Entry point of the `graphnav` script."""
    gc.set_threshold(200_000)  # many small arrays, hardly a cycle: a tenth of the time otherwise
    sys.exit(report_failures(cli, sys.argv[1:]))


if __name__ == "__main__":
    main()
