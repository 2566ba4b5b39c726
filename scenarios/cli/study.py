"""Commands of the science: steering gains, and the paper's experiments."""

import sys
from pathlib import Path

import click

from scenarios.cli.failure import clear_errors


@click.command(
    epilog="""\b
Examples:
  convoy gains                                   the paper's gains on the paper's car
  convoy gains --gains 0.1 0.9 0.1 --speed 15 --speed 30 --out gains-new
"""
)
@click.option(
    "--gains",
    type=float,
    nargs=3,
    default=(0.06, 0.96, 0.08),
    show_default=True,
    metavar="KE KTHETA KOMEGA",
    help="Feedback gains: rad/m, rad/rad, s.",
)
@click.option(
    "--speed", "speeds", type=click.FloatRange(min=1.0), multiple=True, help="Speeds in m/s."
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("gains"),
    show_default=True,
    help="Folder for gains.json and the pictures.",
)
def gains(*, gains: tuple[float, float, float], speeds: tuple[float, ...], out: Path) -> None:
    """Stabilising gain sets, margins, varying speed, loadings and propagation, with pictures."""
    from rich.console import Console

    from scenarios.cli.tables import gains_table
    from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report
    from vehicles.car.parameters import LINCOLN_MKZ, Gains

    with clear_errors():
        report = gains_report(LINCOLN_MKZ, Gains(*gains), speeds or DEFAULT_SPEEDS, out_dir=out)
        Console().print(gains_table(report))
        click.echo(f"written: {out / 'gains.json'} and {len(report.pictures)} pictures")


@click.command(
    epilog="""\b
Examples:
  convoy reproduce --out paper                   all of it, in a minute or two
  convoy reproduce --case base --case a
"""
)
@click.option("--case", "cases", multiple=True, metavar="NAME", help="Only this case; repeatable.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("paper"),
    show_default=True,
    help="Folder for the report, its pictures and the logs.",
)
def reproduce(*, cases: tuple[str, ...], out: Path) -> None:
    """Run the paper's experiments and write a report: each claim against what comes out here."""
    from scenarios.studies.paper.reproduce import reproduce as carry_out

    with clear_errors():
        sys.exit(carry_out(cases, out, click.echo))
