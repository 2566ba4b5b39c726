"""The live table of a run; without a terminal, a line every few seconds."""

import time
from collections.abc import Sequence
from math import inf, isfinite
from typing import NamedTuple

from rich.console import Console
from rich.live import Live
from rich.table import Table

from scenarios.cli.columns import Column, table_of, worst_rows
from scenarios.results.metrics import Metrics
from scenarios.results.vehicles.accumulators import Extremes
from scenarios.results.vehicles.vehicle_figures import VehicleFigures
from transport.reasons import counts_as_loss
from vehicles.messages import LogText, Message, RunStart, TruePose
from vehicles.schedule import SECOND

REDRAW_S = 0.25
PLAIN_EVERY_S = 5.0
"""Without a terminal, a plain line this often."""
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


class Progress:
    """A live table of time, true error and gap, speed and messages of each vehicle.

    Of a long convoy it shows the vehicles that were furthest off the lead's path so far, and a line
    about all. The figures are those of `metrics`, which takes each message first.
    """

    kinds: frozenset[type[Message]] = frozenset({LogText, RunStart, TruePose})

    def __init__(self, metrics: Metrics, duration_s: float) -> None:
        self._metrics = metrics
        self._duration_s = duration_s
        self._start_at: int | None = None
        self._now = 0
        self._backlog = 0
        self._drawn = 0.0
        self._console = Console(stderr=True)
        self._terminal = self._console.is_terminal
        self._live = Live(console=self._console, auto_refresh=False, transient=True)

    def __enter__(self) -> "Progress":
        if self._terminal:
            self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._live.stop()

    def listen(self, _at: int, message: Message) -> None:
        known = message.vehicle in self._metrics.vehicles
        match message:
            case RunStart():
                self._start_at = message.start_at_ns
            case LogText() if message.level == "debug":
                pass  # for the log only
            case LogText() if message.level in {"error", "alert", "fatal"} or not known:
                line = f"{message.vehicle}: {message.text}"
                self._console.print(
                    line, highlight=False, markup=False, emoji=False, soft_wrap=True
                )
            case TruePose() if known:
                self._now = max(self._now, message.true_at_ns)
        self._backlog = 0
        self._refresh()

    def show_backlog(self, at: int, waiting: int) -> None:
        """Take the instant (ns) of the latest recorded message, and the number of waiting ones."""
        self._now, self._backlog = max(self._now, at), waiting
        self._refresh()

    def _refresh(self) -> None:
        if self._start_at is None:
            return
        now = time.monotonic()
        if now - self._drawn < (REDRAW_S if self._terminal else PLAIN_EVERY_S):
            return
        self._drawn = now
        if self._terminal:
            self._live.update(self._table(), refresh=True)
        else:
            line = f"{self._title()} · {self._of_all()}"
            self._console.print(line, highlight=False, soft_wrap=True)

    def _of_all(self) -> str:
        """Format the worst figures of all vehicles, and the sums of their messages."""
        figures = self._metrics.vehicles.values()
        worst = max(abs(vehicle.cross_track_error.latest) for vehicle in figures)
        largest = max(vehicle.cross_track_error.largest for vehicle in figures)
        gap = min([gap.min_m for gap in self._metrics.stream.gaps.values()], default=inf)
        min_gap = f" · min gap {_metres(gap)} m" if isfinite(gap) else ""
        counts = map(self._messages, self._metrics.vehicles)
        delivered, dropped, late = map(sum, zip(*counts, strict=True))
        return (
            f"largest true error now {worst * 100:.1f} cm, so far {largest * 100:.1f} cm{min_gap}"
            f" · delivered {delivered} · dropped {dropped} · late {late}"
        )

    def _gap(self, name: str) -> float:
        """True gap (m) to the vehicle ahead, infinite if it is unknown."""
        known = self._metrics.stream.gaps.get(name)
        return known.now_m if known else inf

    def _messages(self, name: str) -> tuple[int, int, int]:
        """Count delivered, dropped and late messages of a vehicle; late ticks count as late."""
        links = [link for (_, receiver), link in self._metrics.links.items() if receiver == name]
        health = self._metrics.vehicles[name].health
        return (
            sum(link.delivered for link in links),
            sum(n for link in links for word, n in link.dropped.items() if counts_as_loss(word)),
            sum(link.late for link in links) + (health.late_ticks if health else 0),
        )

    def _seconds(self) -> float:
        return max(self._now - (self._start_at or 0), 0) / SECOND

    def _title(self) -> str:
        backlog = f", log behind by {self._backlog} messages" if self._backlog else ""
        return f"{self._seconds():.1f} of {self._duration_s:.1f} s{backlog}"

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
