"""`convoy compare`."""

from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scenarios.cli.common_options import FiniteRange, json_option, output_option, rerun_option
from scenarios.cli.output import clear_errors, print_whole, progress_of, table_of, warn_of_log
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from scenarios.studies.comparison.runs import RunComparison

MOST_SETTINGS = 30
"""Printed settings at most; the JSON has them all."""


@click.command(
    epilog="""\b
Examples:
  convoy compare runs/first runs/second
  convoy compare runs/alpha-0.5 runs/alpha-0.8      two folders of runs, such as a run per seed
  convoy compare 'runs/before-*' 'runs/after-*' --json
  convoy compare runs/first runs/second --save both.rrd
  convoy compare runs/a runs/b runs/c -o errors.pdf      a figure for a paper
"""
)
@click.argument("logs", nargs=-1, required=True, metavar="RUN...", type=click.Path(path_type=Path))
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
    type=FiniteRange(min=0.0),
    default=1e-9,
    show_default=True,
    metavar="RATIO",
    help="Difference of metrics, relative to their size, that is none.",
)
@click.option(
    "--apart",
    "apart_m",
    type=FiniteRange(min=0.0, min_open=True),
    default=0.1,
    show_default=True,
    metavar="METRES",
    help="Difference of the lateral positions from which vehicles part.",
)
@click.option("--all", "all_metrics", is_flag=True, help="Print all differing metrics.")
@rerun_option("off", "Show the runs in Rerun")
@json_option("Print the differences as JSON.")
def compare(
    logs: tuple[Path, ...],
    *,
    output: Path | None,
    vehicles: str,
    tolerance: float,
    apart_m: float,
    all_metrics: bool,
    rerun: str,
    as_json: bool,
) -> None:
    """Compare two or more runs.

    Lists settings and metrics that differ from those of the first run, A, and where along the road
    the vehicles part. A RUN is a log, the folder of a run, or a folder or quoted pattern of runs of
    one setting, such as one per seed; runs that differ in the seed only form a group, too. Metrics
    of groups are compared by the 99 % interval of the difference of their means, from pairs of
    equal seeds where both have them. The picture has errors, gaps and modes over time and place.

    The exit code is 1 if a metric or a position differs, or a log is damaged, and 0 otherwise.
    Counters of processes and times of the real transport are not compared, and other settings alone
    are no difference.
    """
    from scenarios.cli.output import wait_until_stopped
    from scenarios.results.figure_style import require_new_picture
    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.comparison.runs import compare_runs, to_json
    from transport.picture.option import parse_rerun_option, refuse_foreign_file
    from transport.picture.viewer_process import require_display

    with clear_errors():
        option = parse_rerun_option(rerun)
        if option.sink != "off":
            require("compare with a picture in Rerun", "viewer", "rerun")
        if option.sink == "spawn":
            require_display()
        refuse_foreign_file(option)
        if output:
            require_new_picture(output)
        comparison = compare_runs(logs, tolerance, apart_m, progress_of("runs read"))
        for fault in comparison.faults:
            warn_of_log(fault)
        if as_json:
            click.echo(to_json(comparison), nl=False)
        else:
            _print(comparison, all_metrics=all_metrics)
        if output:
            from scenarios.studies.comparison.figure import draw_comparison

            draw_comparison(comparison, output, vehicles.split(",") if vehicles else ())
            click.echo(f"written: {output}", err=as_json)
        if option.sink != "off":
            from scenarios.studies.comparison.recording import show_comparison

            show_comparison(comparison, option, wait=wait_until_stopped)
    raise SystemExit(0 if comparison.is_equal else EXIT_FAILED)


def _print(comparison: "RunComparison", *, all_metrics: bool) -> None:
    """Print settings, metrics and positions that differ, and the result."""
    from rich.console import Console

    from scenarios.results.summary_columns import Column

    console = Console()

    def print_table(columns: Sequence[Column[Any]], rows: Sequence[Any], more: str) -> None:
        if rows:
            print_whole(table_of(columns, rows, caption=more or None), console)

    for group in comparison.groups:
        click.echo(f"{group.title} ({group.record.log})")
    labels = ["setting", *(group.label for group in comparison.groups)]
    columns: list[Column[Any]] = [
        Column(label, itemgetter(number), left=True, wraps=True)
        for number, label in enumerate(labels)
    ]
    settings = [
        (key, *(text or "not set" for text in texts)) for key, texts in comparison.settings.items()
    ]
    more = len(settings) - MOST_SETTINGS
    print_table(columns, settings[:MOST_SETTINGS], f"{more} more, see --json" if more > 0 else "")
    differing = [row for row in comparison.metrics if row.differs]
    shown = [row for row in differing if all_metrics or row.is_main]
    columns = [
        Column("metric", lambda row: row.name, left=True),
        Column("run", lambda row: row.label, left=True),
        Column("A", lambda row: row.a, ".4g"),
        Column("value", lambda row: row.b, ".4g"),
        Column("minus A", lambda row: row.difference, "+.3g"),
    ]
    if any(row.low is not None for row in shown):
        columns.append(Column("99 % interval", lambda row: (row.low, row.high), "+.3g"))
    more = len(differing) - len(shown)
    print_table(columns, shown, f"{more} more differ, see --all or --json" if more else "")
    columns = [
        Column("run", lambda row: row["label"], left=True),
        Column("vehicle", lambda row: row["vehicle"], left=True),
        Column("parts\nat, m", lambda row: row["parts_at_m"], ".1f"),
        Column("at, s", lambda row: row["parts_at_s"], ".2f"),
        Column("largest\ndifference, m", lambda row: row["difference_m_max"], "+.3f"),
        Column("at, m", lambda row: row["difference_at_m"], ".1f"),
    ]
    print_table(columns, [one.row() for one in comparison.positions], "")
    click.echo(comparison.sentence)
