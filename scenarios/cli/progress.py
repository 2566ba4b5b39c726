"""The live table of a run; without a terminal, a line every few seconds."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.live import Live
from rich.table import Table

from transport.reasons import counts_as_loss
from vehicles.messages import Health, LinkVerdict, LogText, Message, RunStart, Tracking, TruePose
from vehicles.schedule import SECOND

REDRAW_S = 0.25
PLAIN_EVERY_S = 5.0
"""Without a terminal, a plain line this often."""


@dataclass(slots=True)
class Row:
    """What is shown of one vehicle."""

    speed_mps: float = 0.0
    lateral_error_m: float = 0.0
    lateral_error_m_max: float = 0.0
    mode: str = ""
    heard: int = 0
    lost: int = 0
    late: int = 0
    late_ticks: int = 0


class Progress:
    """Shows time, speed, cross-track error and messages of each vehicle, live."""

    def __init__(self, vehicles: Sequence[str], duration_s: float) -> None:
        """Shows nothing until the run starts."""
        self._rows = {name: Row() for name in vehicles}
        self._duration_s = duration_s
        self._start_at: int | None = None
        self._now = 0
        self._drawn = 0.0
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)

    def __enter__(self) -> "Progress":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._live.stop()

    def listen(self, _at: int, message: Message) -> None:
        """Take one recorded message."""
        row = self._rows.get(message.vehicle)
        match message:
            case RunStart():
                self._start_at = message.start_at_ns
            case LogText() if message.level == "debug":
                pass  # for the log only
            case LogText() if message.level in {"error", "fatal"} or row is None:
                line = f"{message.vehicle}: {message.text}"
                self._console.print(line, highlight=False, markup=False, emoji=False)
            case TruePose() if row:
                row.speed_mps = message.speed_mps
                self._now = max(self._now, message.true_at_ns)
            case Tracking() if row:
                row.lateral_error_m = message.lateral_error_m
                row.lateral_error_m_max = max(row.lateral_error_m_max, abs(message.lateral_error_m))
                row.mode = message.mode
            case LinkVerdict() if row:
                row.heard += message.outcome == "delivered"
                row.lost += message.outcome == "dropped" and counts_as_loss(message.reason)
                row.late += message.late
            case Health() if row:
                row.late_ticks = message.late_ticks
        self._refresh()

    def _refresh(self) -> None:
        if self._start_at is None:
            return
        now = time.monotonic()
        terminal = self._console.is_terminal
        if now - self._drawn < (REDRAW_S if terminal else PLAIN_EVERY_S):
            return
        self._drawn = now
        if terminal:
            self._live.update(self._table(), refresh=True)
        else:
            worst = max(abs(row.lateral_error_m) for row in self._rows.values())
            heard = sum(row.heard for row in self._rows.values())
            lost = sum(row.lost for row in self._rows.values())
            late = sum(row.late + row.late_ticks for row in self._rows.values())
            self._console.print(
                f"{self._seconds():6.1f} of {self._duration_s:.1f} s"
                f"  lateral error {worst * 100:.1f} cm  heard {heard}  lost {lost}  late {late}",
                highlight=False,
            )

    def _seconds(self) -> float:
        return max(self._now - (self._start_at or 0), 0) / SECOND

    def _table(self) -> Table:
        table = Table(title=f"{self._seconds():.1f} of {self._duration_s:.1f} s")
        table.add_column("vehicle")
        table.add_column("steers along")
        for title in ("speed m/s", "error cm", "largest cm", "heard", "lost", "late", "late ticks"):
            table.add_column(title, justify="right")
        for name, row in self._rows.items():
            table.add_row(
                name,
                row.mode,
                f"{row.speed_mps:.1f}",
                f"{row.lateral_error_m * 100:.1f}",
                f"{row.lateral_error_m_max * 100:.1f}",
                str(row.heard),
                str(row.lost),
                str(row.late),
                str(row.late_ticks),
            )
        return table
