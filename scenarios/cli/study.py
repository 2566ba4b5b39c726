"""Commands of the science: steering gains, and the paper's experiments."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import click

from scenarios.cli.failure import clear_errors, require

SLOWEST, FASTEST = 2.0, 100.0
"""Speeds (m/s) that can be studied; the model, which divides by the speed, needs no more."""
STUDIES = ("studies", "matplotlib", "scipy")
"""The extra without which there are no studies, and what it brings."""
GAINS = {"KE": (0.001, 10.0), "KTHETA": (0.0, 100.0), "KOMEGA": (0.0, 10.0)}
"""Least and largest gains (rad/m, rad/rad, s); without KE nothing leads back to the path."""


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
    "--speed",
    "speeds",
    type=float,
    multiple=True,
    help=f"Speeds in m/s, {SLOWEST:g} to {FASTEST:g}.",
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
    with clear_errors():
        require("gains", *STUDIES)
    from rich.console import Console

    from scenarios.cli.tables import gains_table
    from scenarios.definition.errors import ScenarioError
    from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report
    from vehicles.car.parameters import LINCOLN_MKZ, Gains

    with clear_errors():
        if refused := [*_refused_gains(gains), *_refused_speeds(speeds)]:
            raise ScenarioError(refused)
        wanted = tuple(dict.fromkeys(speeds)) or DEFAULT_SPEEDS
        try:
            report = gains_report(LINCOLN_MKZ, Gains(*gains), wanted, out_dir=out)
        except ScenarioError:
            raise  # about the folder
        except (ValueError, ArithmeticError) as error:
            given = f"gains {', '.join(map(str, gains))} at {', '.join(map(str, wanted))} m/s"
            raise ScenarioError([f"{given}: cannot be studied: {error}"]) from error
        Console().print(gains_table(report))
        click.echo(f"written: {out / 'gains.json'} and {len(report.pictures)} pictures")


def _refused_gains(gains: Sequence[float]) -> Iterator[str]:
    """Give a line for each gain that no law has; written so that NaN is refused as well."""
    for gain, (name, (least, largest)) in zip(gains, GAINS.items(), strict=True):
        if not least <= gain <= largest:
            yield f"--gains: {name}: given {gain}, allowed {least:g} to {largest:g}"


def _refused_speeds(speeds: Sequence[float]) -> Iterator[str]:
    for speed in speeds:
        if not SLOWEST <= speed <= FASTEST:
            yield f"--speed: given {speed}, allowed {SLOWEST:g} to {FASTEST:g} m/s"


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
    with clear_errors():
        require("reproduce", *STUDIES)
    from scenarios.studies.paper.reproduce import reproduce as carry_out

    with clear_errors():
        sys.exit(carry_out(cases, out, click.echo))
