"""Observers of a run: each receives the messages of the kinds that it wants, with their instants.

The log, and the tables of which metrics are made, are observers. Watchers show the metrics of a
running convoy after each evaluation.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Protocol

from scenarios.definition.scenario import Scenario
from scenarios.runs.live import LiveRun
from transport.topics import TOPIC_OF
from vehicles.messages import Change, LogText, Message, RunEnd, RunStart

Kinds = frozenset[type[Message]]
Listen = Callable[[int, Message], None]
"""Takes the instant (ns) at which a message was sent or recorded, and the message."""
ALL_KINDS: Kinds = frozenset(TOPIC_OF)
ALWAYS: Kinds = frozenset({Change, LogText, RunEnd, RunStart})
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


class ThrottledObservers:
    """Observer that passes messages to others, but only those of ALWAYS while the log is behind.

    So a slow picture loses messages; the log never does. `skipped` counts them.
    """

    def __init__(self, observers: Sequence[Observer], is_behind: Callable[[], bool]) -> None:
        self.kinds = kinds_of(observers)
        self.skipped = 0
        self._listeners = listeners_by_kind(observers)
        self._is_behind = is_behind

    def listen(self, at: int, message: Message) -> None:
        kind = type(message)
        if kind not in ALWAYS and self._is_behind():
            self.skipped += 1
            return
        for listen in self._listeners[kind]:
            listen(at, message)


class Watcher(Protocol):
    """Shows the metrics of a running convoy."""

    def update(self, live: LiveRun, /) -> None:
        """Take the metrics after an evaluation."""
        ...


# ---- The progress of a run as a line of text every few seconds


LINE_EVERY_S = 5.0


class ProgressLines:
    """Reports the time, the worst metrics and the messages of a run, and texts of the recorder."""

    kinds: frozenset[type[Message]] = frozenset({LogText})

    def __init__(self, scenario: Scenario, report: Callable[[str], object]) -> None:
        """Report to `report`, such as `print`."""
        self._names = scenario.vehicle_names
        self._duration_s = scenario.duration_s
        self._report = report
        self._every_s = LINE_EVERY_S
        self._drawn = 0.0

    def listen(self, _at: int, text: Message) -> None:
        if not isinstance(text, LogText) or text.level == "debug":  # debug: for the log only
            return
        if text.level in {"error", "alert", "fatal"} or text.vehicle not in self._names:
            self._report(f"{text.vehicle}: {text.text}")

    def update(self, live: LiveRun) -> None:
        now = time.monotonic()
        if now - self._drawn >= self._every_s:
            self._drawn = now
            self._show(live)

    def _show(self, live: LiveRun) -> None:
        self._report(f"{self._title(live)} · {self._of_all(live)}")

    def _of_all(self, live: LiveRun) -> str:
        """Format the worst metrics of all vehicles, and the sums of their messages."""
        values = list(live.values.values())
        now, largest = (
            max([metres for metres in column if not isnan(metres)], default=0.0)
            for column in (
                [abs(row.error_m) for row in values],
                [row.error_m_max for row in values],
            )
        )
        gap = min([row.gap_m_min for row in values if not isnan(row.gap_m_min)], default=None)
        min_gap = "" if gap is None else f" · min gap {gap:.1f} m"
        delivered, dropped, late = (
            sum([getattr(row, name) for row in values]) for name in ("delivered", "dropped", "late")
        )
        return (
            f"largest true error now {now * 100:.1f} cm, so far {largest * 100:.1f} cm{min_gap}"
            f" · delivered {delivered} · dropped {dropped} · late {late}"
        )

    def _title(self, live: LiveRun) -> str:
        return f"{live.seconds:.1f} of {self._duration_s:.1f} s"
