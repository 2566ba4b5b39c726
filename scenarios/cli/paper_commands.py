"""Commands for the paper: steering gains and experiments."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.common_options import folder_option, picture_format_option
from scenarios.cli.output import clear_errors, table_of
from scenarios.definition.errors import require
from scenarios.results.summary_columns import Column, figure

if TYPE_CHECKING:  # brings scipy
    from rich.table import Table

    from scenarios.studies.gains.results import AtSpeed, GainsReport, PropagationAt, SampledAt

SLOWEST, FASTEST = 2.0, 100.0
"""Speeds (m/s) that can be studied; the model divides by the speed."""
STUDIES = ("studies", "scipy")
"""Extra of the studies, and its packages."""
GAINS = {"KE": (0.001, 10.0), "KTHETA": (0.0, 100.0), "KOMEGA": (0.0, 10.0)}
"""Least and largest gains (rad/m, rad/rad, s); a KE of 0 does not lead back to the path."""

CASES = (
    *("base", "a", "b", "c", "d", "variable_speed", "lead_data"),
    *("information", "laws", "radius"),
    *("propagation", "gains", "field"),
)
"""Cases of the paper; a constant because their module needs SciPy."""


@click.command(
    epilog="""\b
Examples:
  convoy gains                                   the paper's gains and car
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
    help="Feedback gains KE (rad/m), KTHETA (rad/rad) and KOMEGA (s).",
)
@click.option(
    "--speed",
    "speeds",
    type=float,
    multiple=True,
    metavar="M_PER_S",
    help=f"Speed to analyse, {SLOWEST:g} to {FASTEST:g} m/s. Repeatable.",
)
@folder_option("gains", "Folder for gains.json and the plots.")
@picture_format_option
def gains(
    *, gains: tuple[float, float, float], speeds: tuple[float, ...], out: Path, picture_format: str
) -> None:
    """Analyse the steering gains.

    Computes stabilising gain sets, margins and the propagation of errors along the convoy, for
    several loadings and for varying speed. Also computes the lowest stable rates of the inertial
    sensor, of fixes without it, and of control.
    """
    with clear_errors():
        require("gains", *STUDIES)
    from rich.console import Console

    from scenarios.definition.errors import ScenarioError
    from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report
    from vehicles.car.parameters import LINCOLN_MKZ, Gains

    with clear_errors():
        if refused := [*_refused_gains(gains), *_refused_speeds(speeds)]:
            raise ScenarioError(refused)
        chosen = tuple(dict.fromkeys(speeds)) or DEFAULT_SPEEDS
        try:
            report = gains_report(
                LINCOLN_MKZ, Gains(*gains), chosen, out_dir=out, picture_format=picture_format
            )
        except ScenarioError:
            raise  # the folder is refused
        except (ValueError, ArithmeticError) as error:
            given = f"gains {', '.join(map(str, gains))} at {', '.join(map(str, chosen))} m/s"
            raise ScenarioError([f"{given}: cannot be analysed: {error}"]) from error
        Console().print(gains_table(report))
        click.echo(f"written: {out / 'gains.json'} and {len(report.pictures)} plots")


def gains_table(report: "GainsReport") -> "Table":
    at_all = report.stabilising_set.inside_at_all_speeds_and_loadings
    title = (
        f"gains {', '.join(f'{value:g}' for value in report.gains)} "
        f"{'stabilise' if at_all else 'do NOT stabilise'} all speeds and loadings"
    )
    rows = zip(report.speeds, report.propagation, report.sampled, strict=True)
    on_one_line = len(title)
    return table_of(GAINS_COLUMNS, rows, title=title, min_width=on_one_line, padding=(0, 1))


def _peak(at: "PropagationAt") -> str:
    peak = at.second_order
    return f"{peak.norm_ratio:.3f} @ {peak.peak_radps:.2f}" if peak else "unstable"


def _lowest_rates(at: "SampledAt") -> str:
    rates = (at.lowest_imu_rate_hz, at.lowest_rate_without_imu_hz, at.lowest_control_rate_hz)
    return ", ".join(figure(rate) for rate in rates)


GAINS_COLUMNS: "Sequence[Column[tuple[AtSpeed, PropagationAt, SampledAt]]]" = (
    Column("speed\nm/s", lambda row: row[0].speed_mps, ".1f", wraps=True),
    Column("slowest pole\n1/s", lambda row: row[0].abscissa_per_s, ".2f", wraps=True),
    Column("gain ball\nradius", lambda row: row[0].ball_radius, ".3f", wraps=True),
    Column("predecessor only\npeak |G|, rad/s", lambda row: _peak(row[1]), wraps=True),
    Column("lowest rate, Hz\nIMU, no IMU, control", lambda row: _lowest_rates(row[2]), wraps=True),
)


def _refused_gains(gains: Sequence[float]) -> Iterator[str]:
    """One line for each gain out of range, NaN included."""
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
  convoy reproduce --out paper                   all cases: 7 minutes of processor time
  convoy reproduce --case base --case a
"""
)
@click.option(
    "--case",
    "cases",
    multiple=True,
    metavar="NAME",
    help=f"Run this case only: {', '.join(CASES)}. Repeatable.",
)
@folder_option("paper", "Folder for the report, the plots and the logs.")
@picture_format_option
def reproduce(*, cases: tuple[str, ...], out: Path, picture_format: str) -> None:
    """Reproduce the paper's experiments.

    Simulates the experiments and writes a report that compares each claim with the result.
    """
    with clear_errors():
        require("reproduce", *STUDIES)
    from scenarios.studies.paper.reproduce import reproduce as carry_out

    with clear_errors():
        sys.exit(carry_out(cases, out, click.echo, picture_format=picture_format))
