"""Display of a run during recording and at its end, for both clocks."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from math import inf, isfinite
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
from scenarios.results.accumulators import Extremes
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.metrics import Metrics
from scenarios.results.run_drawing import open_drawing
from scenarios.results.summary import RunSummary
from scenarios.results.summary_columns import Column
from scenarios.results.vehicle_figures import VehicleFigures
from scenarios.runs.observer import Observer, OnMessage, ProgressLines
from transport.picture.option import parse_rerun_option, refuse_foreign_file, spelled
from transport.picture.viewer_process import UnwritableRecordingError, ViewerError, require_display

# ---- The live table of a run; without a terminal, a line every few seconds


REDRAW_S = 0.25
MOST_ROWS = 10
"""Of more vehicles than this only the worst have a row."""


class _Row(NamedTuple):
    """A vehicle now: its figures, its true gap (m), infinite if unknown, and its messages."""

    name: str
    figures: VehicleFigures
    gap: float
    delivered: int
    dropped: int
    late: int

    @property
    def error(self) -> Extremes | None:
        """True error, None if there is none yet."""
        return self.figures.cross_track_error if self.figures.cross_track_error.count else None


def _metres(gap: float) -> str:
    return f"{gap:.1f}" if isfinite(gap) else "-"


COLUMNS: Sequence[Column[_Row]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("true\nerror\ncm", lambda row: row.error.latest if row.error else None, ".1f", 100),
    Column("max\nerror\ncm", lambda row: row.error.largest if row.error else None, ".1f", 100),
    Column("true\ngap\nm", lambda row: _metres(row.gap)),
    Column("estimated\nerror\ncm", lambda row: row.figures.lateral_error.latest, ".1f", 100),
    Column("mode", lambda row: row.figures.mode, left=True),
    Column("speed\nm/s", lambda row: row.figures.speed, ".1f"),
    Column("delivered", lambda row: row.delivered),
    Column("dropped", lambda row: row.dropped),
    Column("late", lambda row: row.late),
)


class Progress(ProgressLines):
    """A live table of time, true error and gap, speed and messages of each vehicle.

    Of a long convoy it shows the vehicles that were furthest off the lead's path so far, and a line
    about all. Without a terminal it prints a line every few seconds.
    """

    def __init__(self, metrics: Metrics, duration_s: float) -> None:
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        super().__init__(metrics, duration_s, self._print)
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

    def _show(self) -> None:
        if self._terminal:
            self._live.update(self._table(), refresh=True)
        else:
            super()._show()

    def _gap(self, name: str) -> float:
        """True gap (m) to the vehicle ahead, infinite if it is unknown."""
        known = self._metrics.stream.gaps.get(name)
        return known.now_m if known else inf

    def _table(self) -> Table:
        vehicles = self._metrics.vehicles
        names = worst_rows(
            list(vehicles), lambda name: vehicles[name].cross_track_error.largest, MOST_ROWS
        )
        caption = None
        if len(names) < len(vehicles):
            caption = f"the worst {len(names)} of {len(vehicles)}; all: {self._of_all()}"
        rows = [
            _Row(name, vehicles[name], self._gap(name), *self._messages(name)) for name in names
        ]
        # without lines, which would cost columns
        return table_of(COLUMNS, rows, title=self._title(), caption=caption, box=None)


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
