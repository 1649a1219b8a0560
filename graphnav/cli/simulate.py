"""`graphnav simulate`: what may be chosen of a simulated run."""

from pathlib import Path
from typing import Any

import click

from graphnav.cli.command import Finite, Place

PATH = Place()


@click.command(short_help="A run with known truth, to try things on.")
@click.argument("scenario", metavar="SCENARIO")
@click.option("--out", type=PATH, help="Directory.  [default: <scenario>_<seed>]")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, show_default=True)
@click.option("--grade", help="IMU: navigation, fog, tactical, mems.  [default: the scenario's]")
@click.option("--ground", default="concrete", show_default=True, help="concrete or soil (tracked).")
@click.option("--duration", type=Finite(), metavar="S", help="Seconds to drive.")
@click.option("--gnss", is_flag=True, help="Satellite fixes too.")
@click.option("--slips", is_flag=True, help="Side slips and hops (wheeled).")
@click.option(
    "--rate",
    "rate_hz",
    type=int,
    default=100,
    show_default=True,
    metavar="HZ",
    help="Of the IMU, 10 to 1000.",
)
@click.option(
    "--noise",
    type=Finite(),
    default=1.0,
    show_default=True,
    metavar="TIMES",
    help="White noise of the IMU over its data sheet's.",
)
@click.option("--sampled", is_flag=True, help="IMU values of an instant, not means: they alias.")
@click.option(
    "--vibration",
    type=Finite(),
    default=1.0,
    show_default=True,
    metavar="TIMES",
    help="Field: vibration over the vehicle's own.",
)
@click.option(
    "--without", multiple=True, metavar="EFFECT", help="Field: leave an effect out; repeatable."
)
def simulate(scenario: str, out: Path | None, seed: int, **more: Any) -> None:
    """Drive a simulated vehicle: run.csv.gz, truth.csv.gz and vehicle.toml with known answers.

    SCENARIO is tracked, wheeled, slip or rover, or, as recorded vehicles are, field-tracked,
    field-wheeled or field-skid (a robot with the speeds of both sides). Their EFFECTs: vibration,
    bumps, hills, scale, misalignment, g-sensitivity, instability, quantisation, jitter, losses,
    slip.

    \b
    Examples:
      graphnav simulate tracked --out demo --seed 1 --ground soil
      graphnav simulate field-skid --rate 20 --sampled --without jitter --without losses
    """
    from graphnav.simulation import simulate as simulated
    from graphnav.simulation.files import kept_aside

    out = out or Path(f"{scenario}_{seed}")
    kept = kept_aside(out)
    simulated(scenario, out, seed, **more)
    click.echo(f"wrote {out}")
    if kept:
        click.echo(f"- {kept}")
