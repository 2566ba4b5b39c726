"""`convoy compare`."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scenarios.cli.common_options import json_option, output_option, rerun_option
from scenarios.cli.output import clear_errors, warn_of_log
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from scenarios.studies.comparison.run_comparison import RunComparison


@click.command(
    epilog="""\b
Examples:
  convoy compare runs/first runs/second
  convoy compare runs/first runs/second --save both.rrd
  convoy compare runs/a runs/b runs/c -o errors.pdf      a figure for a paper
"""
)
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path))
@output_option("Draw a figure into this new file: .svg, .pdf or .png.")
@click.option(
    "--vehicles",
    default="",
    metavar="NAMES",
    help="Vehicles with curves in the figure, such as v2,v5. Default: the four followers that"
    " differ most.",
)
@click.option(
    "--tolerance",
    "tolerance_m",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.1,
    show_default=True,
    metavar="METRES",
    help="Difference of the lateral positions from which runs diverge.",
)
@rerun_option("", "Show the runs in Rerun", "Default without -o and --json.")
@json_option("Print divergences and differences as JSON.")
def compare(
    logs: tuple[Path, ...],
    *,
    output: Path | None,
    vehicles: str,
    tolerance_m: float,
    rerun: str,
    as_json: bool,
) -> None:
    """Compare two or more runs in a picture.

    LOGS are logs or folders of runs; the first one is A. The picture has both convoys, their
    errors, gaps and modes over time (timeline run_time) and over the distance along the path of A
    (timeline path_m), the difference of their lateral positions at the same place, and the place
    where they first differ.
    """
    from scenarios.cli.output import progress_of, wait_until_stopped
    from scenarios.studies.comparison.comparison_picture import show_comparison
    from scenarios.studies.comparison.run_comparison import compare_runs, to_json
    from scenarios.studies.picture_style import require_new_picture
    from transport.picture.option import parse_rerun_option, refuse_foreign_file
    from transport.picture.viewer_process import require_display

    with clear_errors():
        option = parse_rerun_option(rerun or ("off" if output or as_json else "spawn"))
        if option.sink != "off":
            require("compare with a picture in Rerun", "viewer", "rerun")
        if option.sink == "spawn":
            require_display()
        refuse_foreign_file(option)
        if output:
            require("--output", "studies", "matplotlib")
            require_new_picture(output)
        comparison = compare_runs(logs, tolerance_m, progress_of("runs read"))
        for fault in comparison.faults:
            warn_of_log(fault)
        if as_json:
            click.echo(to_json(comparison), nl=False)
        else:
            _print(comparison)
        if output:
            from scenarios.studies.comparison.comparison_figure import draw_comparison

            draw_comparison(comparison, output, vehicles.split(",") if vehicles else ())
            click.echo(f"written: {output}", err=as_json)
        show_comparison(comparison, option, wait=wait_until_stopped)


def _print(comparison: "RunComparison") -> None:
    from rich.console import Console

    from scenarios.cli.output import Column, print_whole, table_of

    columns: list[Column[Mapping[str, Any]]] = [
        Column("run", lambda row: row["label"], left=True),
        Column("vehicle", lambda row: row["vehicle"], left=True),
        Column("diverges\nat, m", lambda row: row["diverges_at_m"], ".1f"),
        Column("at, s", lambda row: row["diverges_at_s"], ".2f"),
        Column("largest\ndifference, m", lambda row: row["difference_m_max"], "+.3f"),
        Column("at, m", lambda row: row["difference_at_m"], ".1f"),
    ]
    for run in comparison.runs:
        click.echo(f"{run.title} ({run.record.log})")
    print_whole(table_of(columns, list(comparison.rows())), Console())
    click.echo(comparison.sentence)


# ---- `convoy diff`


@click.command(
    epilog="""\b
Examples:
  convoy diff runs/first runs/second
  convoy diff runs/alpha-0.5 runs/alpha-0.8      two folders of runs, such as a run per seed
  convoy diff 'runs/before-*' 'runs/after-*' --json
"""
)
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option("--all", "all_figures", is_flag=True, help="Print all differing figures.")
@json_option("Print the differences as JSON.")
def diff(a: Path, b: Path, *, all_figures: bool, as_json: bool) -> None:
    """List the differences of two runs.

    A and B are logs, folders of a run, folders of several runs, or quoted patterns. Lists differing
    settings and figures; `compare` shows where two runs diverge. Of several runs a side, it lists
    the figures whose difference exceeds the noise over the seeds (99 % interval of the difference
    of the means, from pairs of equal seeds where both sides have them).

    The exit code is 0 for equal runs (of several: no difference beyond the noise), 1 for different
    ones, and 2 for an error.
    """
    from rich.console import Console

    from scenarios.cli.comparison_tables import print_diff
    from scenarios.cli.output import progress_of
    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.comparison.run_diff import diff_runs, to_json

    with clear_errors():
        result = diff_runs(a, b, progress_of("runs read"))
        for fault in result.faults:
            warn_of_log(fault)
        if as_json:
            click.echo(to_json(result), nl=False)
        else:
            print_diff(result, Console(), all_figures=all_figures)
    raise SystemExit(0 if result.is_equal else EXIT_FAILED)
