"""Display of a run during recording and at its end, for both clocks."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import click
from rich.console import Console

from scenarios.cli.display_options import DisplayOptions, start_line
from scenarios.cli.error_lines import print_error
from scenarios.cli.running.progress import Progress
from scenarios.cli.summary_tables import print_summary
from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.metrics import Metrics
from scenarios.results.pictures.run_drawing import open_drawing
from scenarios.results.summary import RunSummary
from scenarios.runs.observer import Observer, OnMessage
from transport.picture.option import parse_rerun_option
from transport.picture.viewer_process import UnwritableRecordingError


@contextmanager
def observers(
    scenario: Scenario,
    metrics: Metrics,
    display: DisplayOptions,
    folder: Path,
    lost: list[str],
) -> Iterator[list[Observer]]:
    """Open the viewer and the progress line, which receive each recorded message.

    A saved recording that is incomplete is reported, and added to `lost`: the run continues.
    """
    with recording_reported(lost), ExitStack() as stack:
        option = parse_rerun_option(display.rerun)
        view = stack.enter_context(open_drawing(option, scenario, folder / LOG_NAME, metrics))
        receivers: list[Observer] = [] if option.sink == "off" else [OnMessage(view.draw)]
        if view.destination and not display.quiet:
            Console(stderr=True).print(
                f"watch it: {view.destination}", soft_wrap=True, highlight=False, markup=False
            )
        if not display.quiet:
            progress = stack.enter_context(Progress(metrics, scenario.duration_s))
            receivers.append(progress)
        yield receivers


@contextmanager
def recording_reported(lost: list[str]) -> Iterator[None]:
    try:
        yield
    except UnwritableRecordingError as error:
        print_error(str(error))
        lost.append(str(error))


def print_start(run: str, folder: Path, display: DisplayOptions, endpoint: str = "") -> None:
    if not display.quiet:
        click.echo(start_line(run, folder, endpoint), err=True)


def show(summary: RunSummary, folder: Path, display: DisplayOptions) -> None:
    if not display.quiet:
        print_summary(summary, folder / LOG_NAME, Console(), display.tables)
