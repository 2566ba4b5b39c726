"""`convoy figure`, and its table."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import override_options, picture_format_option
from scenarios.cli.error_lines import clear_errors
from scenarios.cli.guide import completion
from scenarios.cli.many.study_options import engine_options, selected_workers
from scenarios.definition.errors import require

if TYPE_CHECKING:
    from scenarios.studies.figures.study import FigurePoint

MOST_ROWS = 80
"""Rows that are printed; the file has all of them."""


@click.group(
    epilog="""\b
Examples:
  convoy figure cacc
  convoy figure error-along-string --seeds 20
  convoy figure loss-over-gap --vary convoy.gap_m=3:30:3
"""
)
def figure() -> None:
    """Draw standard figures of the field.

    Each is simulated by a few sweeps, whose commands are printed. Writes a picture, a table and
    JSON with means and 95 % intervals over the seeds. By default a figure is small and takes about
    a minute on two cores; raise --seeds and the values of --vary for publication.
    """


def _figure_command(name: str, axes: str, text: str, examples: Sequence[str]) -> click.Command:
    """Make the command of one figure; `axes` lists the keys that --vary accepts."""

    def command(
        *,
        scenario: str,
        seeds: int | None,
        overrides: tuple[str, ...],
        out: Path | None,
        workers: int | None,
        scheduler: str,
        picture_format: str,
        vary: tuple[str, ...],
    ) -> None:
        with clear_errors():
            require(f"figure {name}", "studies", "matplotlib", "scipy")
        from rich.console import Console

        from scenarios.studies.figures.registry import FIGURE_STUDIES
        from scenarios.studies.figures.simulated import run_figure
        from scenarios.studies.figures.study import FigureOptions

        with clear_errors():
            study = FIGURE_STUDIES[name](
                FigureOptions(scenario=scenario, seeds=seeds, vary=vary, sets=overrides)
            )
            report = partial(click.echo, err=True)
            report(f"{study.runs} runs; the sweeps are:")
            for line in study.commands:
                report(line)
            fleet = selected_workers(workers, scheduler)
            result, written = run_figure(
                study, out or Path(name), fleet, report, picture_format=picture_format
            )
            console = Console()
            for number, panel in enumerate(study.panels):
                points = [one for one in result.points if one.panel == number]
                title = f"{panel.title}: {panel.y_label}"
                columns = (Column(panel.x_label, lambda row: row.x, "g"), *POINT_COLUMNS)
                print_whole(
                    table_of(columns, points[:MOST_ROWS], title=title, title_justify="left"),
                    console,
                )
                if len(points) > MOST_ROWS:
                    click.echo(f"{len(points) - MOST_ROWS} more rows are in the file")
            click.echo(f"{name}: {result.outcome}")
            click.echo(f"written: {', '.join(map(str, written))}")

    decorate: list[Callable[[Any], Any]] = [
        click.argument("scenario", required=False, default="", shell_complete=completion.scenarios),
        click.option(
            "--vary",
            multiple=True,
            metavar="KEY=START:STOP:STEP|a,b,c",
            help=f"Other values of an axis: {axes}. Repeatable.",
        ),
        click.option(
            "--seeds",
            type=click.IntRange(2, 100_000),
            metavar="N",
            help="Simulate each combination with the seeds 1 to N. Default: that of the figure.",
        ),
        override_options,
        click.option(
            "--out",
            type=click.Path(file_okay=False, path_type=Path),
            help=f"Folder for picture, table and JSON.  [default: {name}]",
        ),
        engine_options,
        picture_format_option,
    ]
    for option in reversed(decorate):
        command = option(command)
    lines = "\n".join(f"  convoy figure {name}{example}" for example in examples)
    return click.command(name, help=text, epilog=f"\b\nExamples:\n{lines}")(command)


POINT_COLUMNS: "Sequence[Column[FigurePoint]]" = (
    Column("series", lambda row: row.series, left=True),
    Column("mean", lambda row: row.mean, ".3g"),
    Column("95 %\nfrom", lambda row: row.low, ".3g"),
    Column("to", lambda row: row.high, ".3g"),
    Column("runs", lambda row: row.count),
)

for _command in (
    _figure_command(
        "cacc",
        "links.loss_ratio, gnss.rate_hz",
        "Compare longitudinal laws over loss and rate.\n\n"
        "Amplification of spacing errors and accelerations of ACC at 0.3 s, CACC, Ploeg, flatbed "
        "and consensus over loss and beacon rate, behind a lead whose speed oscillates (SCENARIO, "
        "by default Plexe's).",
        (
            "",
            " --set convoy.vehicles=8 --seeds 20 --vary links.loss_ratio=0:0.9:0.1",
            " plexe_braking --vary gnss.rate_hz=2,5,10",
        ),
    ),
    _figure_command(
        "error-along-string",
        "information_flow.lateral",
        "Compare lateral errors along the string.\n\n"
        "True lateral errors of followers that steer behind the predecessor, the lead, or both. "
        "SCENARIO is by default the paper's base case.",
        (
            "",
            " --set convoy.vehicles=12 --seeds 20 --loss 0.4",
            " --vary information_flow.lateral=predecessor,{ahead=2},{ahead=3},all_ahead",
        ),
    ),
    _figure_command(
        "loss-over-gap",
        "convoy.gap_m, links.loss_ratio, links.latency_ms",
        "Compare the cost of loss over the gap.\n\n"
        "Largest lateral error of the last vehicle over the gap, for several losses and latencies. "
        "Only messages about the road within the preview matter. SCENARIO is by default "
        "lossy_lane_change.",
        ("", " --seeds 20 --vary convoy.gap_m=3:30:3"),
    ),
):
    figure.add_command(_command)
