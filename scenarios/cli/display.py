"""Display of a run during recording and at its end, for both clocks."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from math import isnan
from pathlib import Path
from typing import NamedTuple

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table

from scenarios.cli.common_options import DisplayOptions, start_line
from scenarios.cli.output import print_error, table_of, worst_rows
from scenarios.cli.summary_tables import print_summary
from scenarios.definition.errors import require
from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.summary import RunSummary
from scenarios.results.summary_columns import Column
from scenarios.runs.live import LiveRun, LiveValues
from scenarios.runs.observer import Observer, ProgressLines, Watcher
from transport.picture.option import parse_rerun_option, refuse_foreign_file, spelled
from transport.picture.viewer_process import UnwritableRecordingError, ViewerError, require_display

# ---- The live table of a run; without a terminal, a line every few seconds


REDRAW_S = 0.25
MOST_ROWS = 10
"""Of more vehicles than this only the worst have a row."""


class _Row(NamedTuple):
    """A vehicle and its current metrics."""

    name: str
    now: LiveValues


COLUMNS: Sequence[Column[_Row]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("true\nerror\ncm", lambda row: known(row.now.error_m), ".1f", 100),
    Column("max\nerror\ncm", lambda row: known(row.now.error_m_max), ".1f", 100),
    Column("true\ngap\nm", lambda row: known(row.now.gap_m), ".1f"),
    Column("estimated\nerror\ncm", lambda row: known(row.now.estimated_error_m), ".1f", 100),
    Column("mode", lambda row: row.now.mode, left=True),
    Column("speed\nm/s", lambda row: known(row.now.speed_mps), ".1f"),
    Column("delivered", lambda row: row.now.delivered),
    Column("dropped", lambda row: row.now.dropped),
    Column("late", lambda row: row.now.late),
)


def known(value: float) -> float | None:
    return None if isnan(value) else value


class Progress(ProgressLines):
    """A live table of time, true error and gap, speed and messages of each vehicle.

    Of a long convoy it shows the vehicles that were furthest off the lead's path so far, and a line
    about all. Without a terminal it prints a line every few seconds.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        super().__init__(scenario, self._print)
        self._terminal = self._console.is_terminal
        if self._terminal:
            self._every_s = REDRAW_S

    def __enter__(self) -> "Progress":
        if self._terminal:
            self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._live.stop()

    def _print(self, line: str) -> None:
        self._console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)

    def _show(self, live: LiveRun) -> None:
        if self._terminal:
            self._live.update(self._table(live), refresh=True)
        else:
            super()._show(live)

    def _table(self, live: LiveRun) -> Table:
        names = worst_rows(
            list(live.values), lambda name: known(live.values[name].error_m_max) or 0.0, MOST_ROWS
        )
        caption = None
        if len(names) < len(live.values):
            caption = f"the worst {len(names)} of {len(live.values)}; all: {self._of_all(live)}"
        rows = [_Row(name, live.values[name]) for name in names]
        # without lines, which would cost columns
        return table_of(COLUMNS, rows, title=self._title(live), caption=caption, box=None)


# ---- Checks of the destination of a run's picture


def refuse_picture(rerun: str, out: Path | None) -> None:
    """Raise ViewerError if a run into `out` cannot draw at the requested destination."""
    option = parse_rerun_option(rerun)
    if option.sink != "off":
        require(spelled(rerun), "viewer", "rerun")
    if option.sink == "spawn":
        require_display()
    refuse_foreign_file(option)
    own = [(out / name).resolve() for name in (LOG_NAME, SUMMARY_NAME)] if out else []
    if option.sink == "save" and Path(option.target).resolve() in own:
        raise ViewerError(f"{spelled(rerun)}: the run writes this file itself; give another one")


# ---- Display


@contextmanager
def displays(
    scenario: Scenario, display: DisplayOptions, folder: Path, lost: list[str]
) -> Iterator[tuple[list[Observer], list[Watcher]]]:
    """Open the viewer and the progress line: observers of messages, and watchers of metrics.

    A saved recording that is incomplete is reported, and added to `lost`: the run continues.
    """
    with recording_reported(lost), ExitStack() as stack:
        observers, watchers = list[Observer](), list[Watcher]()
        option = parse_rerun_option(display.rerun)
        if option.sink != "off":
            from scenarios.runs.run_drawing import open_drawing

            drawing = stack.enter_context(open_drawing(option, scenario, folder / LOG_NAME))
            observers.append(drawing)
            watchers.append(drawing)
            if not display.quiet:
                line = f"watch it: {drawing.destination}"
                Console(stderr=True).print(line, soft_wrap=True, highlight=False, markup=False)
        if not display.quiet:
            progress = stack.enter_context(Progress(scenario))
            observers.append(progress)
            watchers.append(progress)
        yield observers, watchers


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
