"""The progress of a run as a line of text every few seconds."""

import time
from collections.abc import Callable
from math import inf, isfinite

from scenarios.results.metrics import Metrics
from transport.reasons import counts_as_loss
from vehicles.messages import LogText, Message, RunStart, TruePose
from vehicles.schedule import SECOND

LINE_EVERY_S = 5.0


class ProgressLines:
    """Reports the time, the worst figures and the messages of a run, and the texts of the recorder.

    The figures are those of `metrics`, which takes each message first.
    """

    kinds: frozenset[type[Message]] = frozenset({LogText, RunStart, TruePose})

    def __init__(
        self, metrics: Metrics, duration_s: float, report: Callable[[str], object]
    ) -> None:
        """Report to `report`, such as `print`."""
        self._metrics = metrics
        self._duration_s = duration_s
        self._report = report
        self._every_s = LINE_EVERY_S
        self._start_at: int | None = None
        self._now = 0
        self._backlog = 0
        self._drawn = 0.0

    def listen(self, _at: int, message: Message) -> None:
        known = message.vehicle in self._metrics.vehicles
        match message:
            case RunStart():
                self._start_at = message.start_at_ns
            case LogText() if message.level == "debug":
                pass  # for the log only
            case LogText() if message.level in {"error", "alert", "fatal"} or not known:
                self._report(f"{message.vehicle}: {message.text}")
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
        if now - self._drawn < self._every_s:
            return
        self._drawn = now
        self._show()

    def _show(self) -> None:
        self._report(f"{self._title()} · {self._of_all()}")

    def _of_all(self) -> str:
        """Format the worst figures of all vehicles, and the sums of their messages."""
        figures = self._metrics.vehicles.values()
        worst = max(abs(vehicle.cross_track_error.latest) for vehicle in figures)
        largest = max(vehicle.cross_track_error.largest for vehicle in figures)
        gap = min([gap.min_m for gap in self._metrics.stream.gaps.values()], default=inf)
        min_gap = f" · min gap {gap:.1f} m" if isfinite(gap) else ""
        counts = map(self._messages, self._metrics.vehicles)
        delivered, dropped, late = map(sum, zip(*counts, strict=True))
        return (
            f"largest true error now {worst * 100:.1f} cm, so far {largest * 100:.1f} cm{min_gap}"
            f" · delivered {delivered} · dropped {dropped} · late {late}"
        )

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
