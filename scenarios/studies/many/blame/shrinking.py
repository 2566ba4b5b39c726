"""The smallest set of losses that still breaks the limit: bursts first, then messages in them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from scenarios.studies.many.blame.ddmin import Item, ddmin, trimmed
from scenarios.studies.many.blame.losses import Burst, Losses, LostMessage, bursts_of
from scenarios.studies.many.blame.ranking import Blamed, losses_of
from scenarios.studies.many.blame.trials import Trials


@dataclass(frozen=True, slots=True)
class SmallestSet:
    """Losses that break the limit; with `is_minimal` it holds without any one of them."""

    messages: tuple[LostMessage, ...]
    is_minimal: bool

    @property
    def bursts(self) -> tuple[Burst, ...]:
        """The same as bursts."""
        return bursts_of(self.messages)


def shrunk(trials: Trials, bursts: Sequence[Burst], rows: Sequence[Blamed]) -> SmallestSet:
    """Shrink `bursts`, all of which break the limit, while none does not.

    A row that breaks it alone is where to begin from, the one with the fewest messages.
    """
    alone = [row for row in rows if row.alone is not None and trials.is_breach(row.alone)]
    start = min(alone, key=lambda row: (row.messages, row.span_s)).group if alone else bursts
    trials.doing = "the smallest set of bursts"
    first = partial(_first_that_breaks, trials, losses_of)
    of_bursts = ddmin(start, first, lambda: trials.are_enough)
    trials.doing = "the smallest set of messages"
    messages = sorted(losses_of(of_bursts.items))
    first_of_messages = partial(_first_that_breaks, trials, frozenset)
    left = trimmed(messages, first_of_messages, lambda: trials.are_enough)
    # Most of a burst is needed once its ends are gone: single messages from the start.
    found = ddmin(left, first_of_messages, lambda: trials.are_enough, chunks=len(left))
    return SmallestSet(found.items, found.is_minimal)


def _first_that_breaks(
    trials: Trials, losses: Callable[[Iterable[Item]], Losses], sets: Sequence[tuple[Item, ...]]
) -> int | None:
    return trials.first_that_breaks([losses(one) for one in sets])
