"""The live table of a run; without a terminal, a line every few seconds."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite

from rich.console import Console
from rich.live import Live
from rich.table import Table

from scenarios.definition.scenario import Scenario
from scenarios.results.bodies import BodySize
from scenarios.results.encounters import Encounters
from scenarios.results.events import sizes_of
from transport.reasons import counts_as_loss
from vehicles.geometry.driven_path import CrossTrackError
from vehicles.messages import Health, LinkVerdict, LogText, Message, RunStart, Tracking, TruePose
from vehicles.schedule import SECOND

REDRAW_S = 0.25
PLAIN_EVERY_S = 5.0
"""Without a terminal, a plain line this often."""


@dataclass(slots=True)
class Row:
    """What is shown of one vehicle."""

    speed_mps: float = 0.0
    true_error_m: float | None = None
    true_error_m_max: float = 0.0
    believed_error_m: float = 0.0
    mode: str = ""
    heard: int = 0
    lost: int = 0
    late: int = 0
    late_ticks: int = 0


class Progress:
    """Shows time, true error and gap, speed and messages of each vehicle, live."""

    def __init__(
        self, sizes: Mapping[str, BodySize], duration_s: float, road_yaw: float | None = None
    ) -> None:
        """Show nothing until the run starts; `sizes` are the vehicles' bodies, the lead first.

        `road_yaw` (rad) is the direction of the road on which the convoy starts.
        """
        vehicles = list(sizes)
        self._paths = CrossTrackError(vehicles[0], road_yaw)
        self._encounters = Encounters(sizes)
        self._rows = {name: Row() for name in vehicles}
        self._duration_s = duration_s
        self._start_at: int | None = None
        self._now = 0
        self._drawn = 0.0
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)

    @classmethod
    def of(cls, scenario: Scenario) -> "Progress":
        """Progress of a run of `scenario`."""
        return cls(sizes_of(scenario), scenario.duration_s, scenario.route.start_yaw)

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
                self._console.print(
                    line, highlight=False, markup=False, emoji=False, soft_wrap=True
                )
            case TruePose() if row:
                row.speed_mps = message.speed_mps
                self._now = max(self._now, message.true_at_ns)
                self._add_truth(message)
            case Tracking() if row:
                row.believed_error_m = message.lateral_error_m
                row.mode = message.mode
            case LinkVerdict() if row:
                row.heard += message.outcome == "delivered"
                row.lost += message.outcome == "dropped" and counts_as_loss(message.reason)
                row.late += message.late
            case Health() if row:
                row.late_ticks = message.late_ticks
        self._refresh()

    def _add_truth(self, pose: TruePose) -> None:
        for foot in self._paths.add(pose):
            row = self._rows[foot.vehicle]
            row.true_error_m = foot.lateral
            row.true_error_m_max = max(row.true_error_m_max, abs(foot.lateral))
        self._encounters.add(pose)

    def _gap(self, name: str) -> float:
        """True gap (m) to the vehicle ahead by now, infinite without one."""
        known = self._encounters.gaps.get(name)
        return known.now_m if known else inf

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
            rows = self._rows.values()
            worst = max(abs(row.true_error_m or 0.0) for row in rows)
            largest = max(row.true_error_m_max for row in rows)
            gap = _metres(min(map(self._gap, self._rows)))
            heard, lost = sum(row.heard for row in rows), sum(row.lost for row in rows)
            late = sum(row.late + row.late_ticks for row in rows)
            self._console.print(
                f"{self._seconds():6.1f} of {self._duration_s:.1f} s"
                f"  true lateral error {worst * 100:.1f} cm, largest {largest * 100:.1f} cm"
                f"  true gap {gap} m  heard {heard}  lost {lost}  late {late}",
                highlight=False,
                soft_wrap=True,
            )

    def _seconds(self) -> float:
        return max(self._now - (self._start_at or 0), 0) / SECOND

    def _table(self) -> Table:
        title = f"{self._seconds():.1f} of {self._duration_s:.1f} s"
        table = Table(title=title, box=None, padding=(0, 1, 0, 0))  # lines would cost columns
        table.add_column("vehicle", no_wrap=True)
        for heading in ("true\nerror cm", "largest\ncm", "true\ngap m", "believed\nerror cm"):
            table.add_column(heading, justify="right", no_wrap=True)
        table.add_column("steers\nalong", no_wrap=True)
        for heading in ("speed\nm/s", "heard", "lost", "late"):
            table.add_column(heading, justify="right", no_wrap=True)
        for name, row in self._rows.items():
            unknown = row.true_error_m is None
            table.add_row(
                name,
                "-" if row.true_error_m is None else f"{row.true_error_m * 100:.1f}",
                "-" if unknown else f"{row.true_error_m_max * 100:.1f}",
                _metres(self._gap(name)),
                f"{row.believed_error_m * 100:.1f}",
                row.mode,
                f"{row.speed_mps:.1f}",
                str(row.heard),
                str(row.lost),
                str(row.late + row.late_ticks),
            )
        return table


def _metres(gap: float) -> str:
    return f"{gap:.1f}" if isfinite(gap) else "-"
