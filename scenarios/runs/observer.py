"""Observers of a run: each receives the messages of the kinds that it wants, with their instants.

The log, the figures, the picture, the progress table and the limits of a run are observers.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Protocol, runtime_checkable

from scenarios.results.metrics import Metrics
from transport.topics import TOPIC_OF, counts_as_loss
from vehicles.messages import Change, LogText, Message, RunEnd, RunStart, TruePose
from vehicles.schedule import SECOND

Kinds = frozenset[type[Message]]
Listen = Callable[[int, Message], None]
"""Takes the instant (ns) at which a message was sent or recorded, and the message."""
ALL_KINDS: Kinds = frozenset(TOPIC_OF)
ALWAYS = (Change, LogText, RunEnd, RunStart)
"""Few messages, needed to understand the others."""


class Observer(Protocol):
    """Receives the messages of a run in the order in which they are sent or recorded."""

    @property
    def kinds(self) -> Kinds:
        """Kinds of message to pass to `listen`; a virtual run builds no others."""
        ...

    def listen(self, at: int, message: Message, /) -> None:
        """Take a message and its instant (ns)."""
        ...


@dataclass(frozen=True, slots=True)
class OnMessage:
    """A function as an observer."""

    listen: Listen
    kinds: Kinds = ALL_KINDS


def listeners_by_kind(observers: Sequence[Observer]) -> dict[type[Message], list[Listen]]:
    return {
        kind: [observer.listen for observer in observers if kind in observer.kinds]
        for kind in TOPIC_OF
    }


def kinds_of(observers: Sequence[Observer]) -> Kinds:
    return frozenset[type[Message]]().union(*(observer.kinds for observer in observers))


@runtime_checkable
class ShowsBacklog(Protocol):
    """Observer that shows how far the log is behind, instead of the messages that it misses."""

    def show_backlog(self, at: int, waiting: int, /) -> None:
        """Take the instant (ns) of the latest recorded message and the number of waiting ones."""
        ...


class ThrottledObservers:
    """Observer that passes messages to others, but only a few while the log is behind.

    So a slow picture loses messages; the log never does.
    """

    def __init__(
        self, observers: Sequence[Observer], waiting: Callable[[], int], most_waiting: int
    ) -> None:
        """`waiting` counts messages to be recorded; beyond `most_waiting` the log is behind."""
        self._listeners = listeners_by_kind(observers)
        self.kinds = kinds_of(observers)
        """Messages that at least one observer wants."""
        self._waiting, self._most_waiting = waiting, most_waiting
        self._shows_backlog = [
            observer for observer in observers if isinstance(observer, ShowsBacklog)
        ]
        self.skipped = 0
        """Number of messages not passed on."""

    def listen(self, at: int, message: Message) -> None:
        listeners = self._listeners[type(message)]
        if not listeners:
            return
        waiting = self._waiting()
        if waiting > self._most_waiting and not isinstance(message, ALWAYS):
            self.skipped += 1
            for observer in self._shows_backlog:
                observer.show_backlog(at, waiting)
            return
        for listener in listeners:
            listener(at, message)

    def skipped_line(self) -> str:
        """Report the number of skipped messages; empty without any."""
        if not self.skipped:
            return ""
        return (
            f"picture and progress skipped {self.skipped} messages while the log was behind; "
            "the log holds them"
        )


# ---- The progress of a run as a line of text every few seconds


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
