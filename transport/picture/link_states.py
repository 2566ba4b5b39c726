"""How a directed link was over each half second, from the verdicts on its messages."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from transport.reasons import counts_as_loss
from vehicles.messages import LinkVerdict
from vehicles.schedule import SECOND

WINDOW_NS = SECOND // 2
WAIT_NS = SECOND // 2
"""A window is judged so long after its end: verdicts on the wall clock take time to arrive."""
MANY_LOST_RATIO = 0.5


def message_state(verdict: LinkVerdict) -> str:
    """Name what happened to one message: "ok", "lost", "late", or "" if it was not carried."""
    if verdict.outcome == "dropped":
        return "lost" if counts_as_loss(verdict.reason) else ""
    return "late" if verdict.late else "ok"


@dataclass(slots=True)
class _Window:
    """The half second of a link that verdicts are counted in, and the state shown last."""

    start: int
    shown: str = ""
    counts: dict[int, list[int]] = field(default_factory=dict)  # of a window: heard, lost, late


@dataclass(slots=True)
class LinkStates:
    """State of every link, window by window.

    "silent": not one message; "many lost": half of them or more; "some lost"; "late": all heard,
    but some physically too late; "ok".
    """

    links: dict[str, _Window] = field(default_factory=dict)

    def count(self, link: str, verdict: LinkVerdict) -> None:
        """Count a verdict on a message of `link` in the window in which it was due."""
        state = message_state(verdict)
        if not state:
            return
        start = verdict.heard_at_ns // WINDOW_NS * WINDOW_NS
        window = self.links.setdefault(link, _Window(start))
        counts = window.counts.setdefault(max(start, window.start), [0, 0, 0])
        counts[("ok", "lost", "late").index(state)] += 1

    def changes(self, now: int) -> Iterator[tuple[str, int, str]]:
        """Give (link, start of the window, state) of the windows over by `now` that changed it."""
        for link, window in self.links.items():
            while window.start + WINDOW_NS + WAIT_NS <= now:
                state = _state(window.counts.pop(window.start, [0, 0, 0]))
                if state != window.shown:
                    window.shown = state
                    yield link, window.start, state
                window.start += WINDOW_NS


def _state(counts: list[int]) -> str:
    heard, lost, late = counts
    if not heard + lost + late:
        return "silent"
    if lost:
        many = lost >= MANY_LOST_RATIO * (heard + lost + late)
        return "many lost" if many else "some lost"
    return "late" if late else "ok"
