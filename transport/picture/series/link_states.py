"""State of a directed link in each half second, by the instants of the verdicts.

A window ends when the receiver's own messages pass its end, so a slow recorder or reader does not
make a link look silent.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from transport.panels import LATE, LOSSES, OK, SILENT
from transport.reasons import counts_as_loss
from vehicles.messages import LinkVerdict
from vehicles.schedule import MILLISECOND, SECOND

WINDOW_NS = SECOND // 2
MARGIN_NS = 100 * MILLISECOND
"""Delay after the end of a window before it is evaluated: verdicts and poses of a vehicle arrive on
different topics."""


def message_state(verdict: LinkVerdict) -> str:
    """State of a message: "ok", "lost", "late", or "" if the link did not carry it."""
    if verdict.outcome == "dropped":
        return "lost" if counts_as_loss(verdict.reason) else ""
    return LATE if verdict.late else OK


class LinkWindow(NamedTuple):
    """State of a link in the half second that begins at `at` (ns), and its loss ratio.

    The ratio is None if the link carried no message.
    """

    link: str
    at: int
    state: str
    loss_ratio: float | None


@dataclass(slots=True)
class WindowCounts:
    ok: int = 0
    lost: int = 0
    late: int = 0


@dataclass(slots=True)
class _Link:
    """The next window of a link, and counts by window."""

    start: int
    counts: dict[int, WindowCounts] = field(default_factory=dict)


@dataclass(slots=True)
class LinkStates:
    """All links, by receiver."""

    receivers: dict[str, dict[str, _Link]] = field(default_factory=dict)

    def count(self, link: str, verdict: LinkVerdict) -> None:
        """Count a verdict in the window of the tick at which it was made."""
        state = message_state(verdict)
        if not state:
            return
        start = verdict.received_at_ns // WINDOW_NS * WINDOW_NS
        links = self.receivers.setdefault(verdict.vehicle, {})
        entry = links.setdefault(link, _Link(start))
        counts = entry.counts.setdefault(max(start, entry.start), WindowCounts())
        setattr(counts, state, getattr(counts, state) + 1)

    def passed(self, receiver: str, now: int) -> Iterator[LinkWindow]:
        """Yield the windows into `receiver` that have ended at its instant `now` (ns)."""
        for link, entry in self.receivers.get(receiver, {}).items():
            while entry.start + WINDOW_NS + MARGIN_NS <= now:
                counts = entry.counts.pop(entry.start, WindowCounts())
                yield window_of(link, entry.start, counts)
                entry.start += WINDOW_NS


def window_of(link: str, at: int, counts: WindowCounts) -> LinkWindow:
    """State of the window of a link that begins at instant `at` (ns)."""
    carried = counts.ok + counts.lost + counts.late
    if not carried:
        return LinkWindow(link, at, SILENT, None)
    share = counts.lost / carried
    if counts.lost:
        tenths = 10 if share == 1.0 else min(max(round(10.0 * share), 1), 9)
        return LinkWindow(link, at, LOSSES[tenths - 1], share)
    return LinkWindow(link, at, LATE if counts.late else OK, 0.0)
