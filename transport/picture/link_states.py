"""State of a directed link over each half second, by the verdicts' own instants.

A window is over when the receiver's own messages have passed its end. So neither the recorder's
clock nor a slow reader of the log makes a link look silent.
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
"""Time past its end after which a window is judged: verdicts and poses of one vehicle come under
different topics."""


def message_state(verdict: LinkVerdict) -> str:
    """State of one message: "ok", "lost", "late", or "" if it was not carried."""
    if verdict.outcome == "dropped":
        return "lost" if counts_as_loss(verdict.reason) else ""
    return LATE if verdict.late else OK


class LinkWindow(NamedTuple):
    """A link over the half second that begins at `at` (ns): its state, and the share lost.

    The share is None where no message was carried.
    """

    link: str
    at: int
    state: str
    loss_ratio: float | None


@dataclass(slots=True)
class _Counts:
    """Messages of one window."""

    ok: int = 0
    lost: int = 0
    late: int = 0


@dataclass(slots=True)
class _Link:
    """The next window of a link, and counts by window."""

    start: int
    counts: dict[int, _Counts] = field(default_factory=dict)


@dataclass(slots=True)
class LinkStates:
    """All links, by receiver."""

    receivers: dict[str, dict[str, _Link]] = field(default_factory=dict)

    def count(self, link: str, verdict: LinkVerdict) -> None:
        """Count a verdict in the window of the tick that judged the message."""
        state = message_state(verdict)
        if not state:
            return
        start = verdict.received_at_ns // WINDOW_NS * WINDOW_NS
        links = self.receivers.setdefault(verdict.vehicle, {})
        one = links.setdefault(link, _Link(start))
        counts = one.counts.setdefault(max(start, one.start), _Counts())
        setattr(counts, state, getattr(counts, state) + 1)

    def passed(self, receiver: str, now: int) -> Iterator[LinkWindow]:
        """Yield the windows that are over when `receiver` is at its instant `now` (ns)."""
        for link, one in self.receivers.get(receiver, {}).items():
            while one.start + WINDOW_NS + MARGIN_NS <= now:
                counts = one.counts.pop(one.start, _Counts())
                yield _judged(link, one.start, counts)
                one.start += WINDOW_NS


def _judged(link: str, at: int, counts: _Counts) -> LinkWindow:
    carried = counts.ok + counts.lost + counts.late
    if not carried:
        return LinkWindow(link, at, SILENT, None)
    share = counts.lost / carried
    if counts.lost:
        tenths = 10 if share == 1.0 else min(max(round(10.0 * share), 1), 9)
        return LinkWindow(link, at, LOSSES[tenths - 1], share)
    return LinkWindow(link, at, LATE if counts.late else OK, 0.0)
