"""`convoy paper gains` and `convoy paper reproduce`."""

import sys
from pathlib import Path
from typing import Any

import click

from scenarios.cli.common_options import FiniteRange, folder_option, picture_format_option
from scenarios.cli.output import clear_errors, table_of
from scenarios.definition.errors import require
from scenarios.results.summary_columns import Column, figure

SLOWEST, FASTEST = 2.0, 100.0
"""Speeds (m/s) that can be studied; the model divides by the speed."""
STUDIES = ("studies", "scipy")
"""Extra of the studies, and its packages."""
GAINS = (FiniteRange(0.001, 10.0), FiniteRange(0.0, 100.0), FiniteRange(0.0, 10.0))
"""Least and largest gains (rad/m, rad/rad, s); a KE of 0 does not lead back to the path."""
CASES = (
    *("base", "a", "b", "c", "d", "variable_speed", "lead_data"),
    *("information", "laws", "radius"),
    *("propagation", "gains", "field"),
)
"""Cases of the paper; a constant because their module needs SciPy."""


@click.group(
    epilog="""\b
Examples:
  convoy paper gains
  convoy paper reproduce --out paper
"""
)
def paper() -> None:
    """Analyse the paper's gains and experiments."""


@paper.command(
    epilog="""\b
Examples:
  convoy paper gains                                   the paper's gains and car
  convoy paper gains --gains 0.1 0.9 0.1 --speed 15 --speed 30 --out gains-new
"""
)
@click.option(
    "--gains",
    type=GAINS,
    default=(0.06, 0.96, 0.08),
    show_default=True,
    metavar="KE KTHETA KOMEGA",
    help="Feedback gains KE (rad/m), KTHETA (rad/rad) and KOMEGA (s).",
)
@click.option(
    "--speed",
    "speeds",
    type=FiniteRange(SLOWEST, FASTEST),
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
        require("paper gains", *STUDIES)
    from rich.console import Console

    from scenarios.definition.errors import ScenarioError
    from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report
    from vehicles.car.parameters import LINCOLN_MKZ, Gains

    with clear_errors():
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
        at_all = report["stabilising_set"]["inside_at_all_speeds_and_loadings"]
        title = (
            f"gains {', '.join(f'{value:g}' for value in gains)} "
            f"{'stabilise' if at_all else 'do NOT stabilise'} all speeds and loadings"
        )
        rows = [
            at_speed | along | sampled
            for at_speed, along, sampled in zip(
                report["speeds"], report["propagation"], report["sampled"], strict=True
            )
        ]
        Console().print(
            table_of(GAINS_COLUMNS, rows, title=title, min_width=len(title), padding=(0, 1))
        )
        click.echo(f"written: {out / 'gains.json'} and {len(report['pictures'])} plots")


def _peak(row: dict[str, Any]) -> str:
    peak = row.get("second_order")
    return f"{peak['norm_ratio']:.3f} @ {peak['peak_radps']:.2f}" if peak else "unstable"


def _lowest_rates(row: dict[str, Any]) -> str:
    names = ("lowest_imu_rate_hz", "lowest_rate_without_imu_hz", "lowest_control_rate_hz")
    return ", ".join(figure(row[name]) for name in names)


GAINS_COLUMNS: tuple[Column[dict[str, Any]], ...] = (
    Column("speed\nm/s", lambda row: row["speed_mps"], ".1f", wraps=True),
    Column("slowest pole\n1/s", lambda row: row["abscissa_per_s"], ".2f", wraps=True),
    Column("gain ball\nradius", lambda row: row["ball_radius"], ".3f", wraps=True),
    Column("predecessor only\npeak |G|, rad/s", _peak, wraps=True),
    Column("lowest rate, Hz\nIMU, no IMU, control", _lowest_rates, wraps=True),
)


@paper.command(
    epilog="""\b
Examples:
  convoy paper reproduce --out paper                   all cases: 7 minutes of processor time
  convoy paper reproduce --case base --case a
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
        require("paper reproduce", *STUDIES)
    from scenarios.studies.paper.reproduce import reproduce as carry_out

    with clear_errors():
        sys.exit(carry_out(cases, out, click.echo, picture_format=picture_format))
