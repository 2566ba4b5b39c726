"""`convoy recompute`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.common_options import json_option, output_option, partial_option, rerun_option
from scenarios.cli.error_lines import clear_errors, warn_of_log
from scenarios.cli.guide import completion
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from scenarios.studies.comparison.recomputation import Recomputation


@click.command(
    epilog="""\b
Examples:
  convoy recompute runs/first --vehicle v3 --controller mine.PurePursuit
  convoy recompute runs/first --vehicle v3 --set control.preview_s=1.2 -o v3.svg
  convoy recompute runs/first --vehicle v3        repeats its decisions, to the bit
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--vehicle", required=True, metavar="NAME", help="Vehicle that decides again.")
@click.option(
    "--controller",
    default="",
    metavar="CLASS",
    help="Another controller, such as stanley or mine.PurePursuit. Short for"
    " --set control.controller=CLASS.",
)
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    shell_complete=completion.settings,
    help="Override a key of [control] or [information_flow] for this vehicle, such as"
    " information_flow.lateral=predecessor. Repeatable.",
)
@output_option("Draw both commands into this new file: .svg, .pdf or .png.")
@rerun_option("off", "Show both commands in Rerun")
@partial_option
@json_option("Print the differences as JSON.")
def recompute(
    log: Path,
    *,
    vehicle: str,
    controller: str,
    overrides: tuple[str, ...],
    output: Path | None,
    rerun: str,
    partial: bool,
    as_json: bool,
) -> None:
    """Recompute a vehicle's recorded decisions.

    LOG is a run.mcap or its folder. Feeds the inputs of the vehicle in the log to other software in
    open loop: the messages that it received, and the measurements of its sensors. The car moves as
    recorded, whatever the software decides. Lists the differences of commands and self-estimates,
    and where they begin. With the same software all decisions are equal to the bit, also those of a
    run in real time.
    """
    from scenarios.cli.output import wait_until_stopped
    from scenarios.cli.running.destination import refuse_picture
    from scenarios.results.log_summary import log_in
    from scenarios.studies.comparison import recomputation
    from scenarios.studies.comparison.recomputation_picture import show_recomputation
    from scenarios.studies.picture_style import require_new_picture
    from transport.picture.option import parse_rerun_option

    with clear_errors():
        option = parse_rerun_option(rerun)
        refuse_picture(rerun, None)
        if output:
            require("--output", "studies", "matplotlib")
            require_new_picture(output)
        result = recomputation.recompute(
            log_in(log),
            vehicle,
            controller=controller,
            overrides=overrides,
            partial=partial,
        )
        for line in result.warnings:
            warn_of_log(line)
        if as_json:
            click.echo(recomputation.to_json(result), nl=False)
        else:
            _print(result)
        if output:
            from scenarios.studies.comparison.recomputation_plot import draw_recomputation

            draw_recomputation(result, output)
            click.echo(f"written: {output}", err=as_json)
        show_recomputation(result, option, wait=wait_until_stopped)


def _print(result: "Recomputation") -> None:
    from rich.console import Console

    from scenarios.cli.columns import Column, print_whole, table_of
    from scenarios.studies.comparison.recomputation import DecisionDifference

    columns: list[Column[DecisionDifference]] = [
        Column("field", lambda row: row.field, left=True),
        Column("differs\nfrom, s", lambda row: row.first_at_s, ".2f"),
        Column("difference\nrms", lambda row: row.rms, ".3g"),
        Column("largest", lambda row: row.largest, ".3g"),
        Column("at, s", lambda row: row.largest_at_s if row.largest else None, ".2f"),
        Column("there\nrecorded", lambda row: row.recorded if row.largest else None, ".4g"),
        Column("there\nrecomputed", lambda row: row.recomputed if row.largest else None, ".4g"),
    ]
    settings = ", ".join(result.settings) or "the recorded settings"
    click.echo(f"{result.log}: {result.vehicle} with {settings}")
    if not result.is_equal:
        print_whole(table_of(columns, result.differences), Console())
    if result.other_modes:
        count = len(result.at_s)
        click.echo(f"the mode differs in {result.other_modes} of {count} decisions")
    click.echo(result.sentence)
