"""The smallest set of losses that still breaks the limit: bursts first, then messages in them.

By delta debugging: Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", IEEE
Transactions on Software Engineering 28(2), 2002. Only complements are tried: subsets cost as many
tests again and are not needed for a result that is 1-minimal (Hodován and Kiss, "Practical
improvements to the minimizing delta debugging algorithm", ICSOFT 2016).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Generic, TypeVar

from scenarios.studies.many.blame.losses import Burst, Losses, LostMessage
from scenarios.studies.many.blame.ranking import Attribution, losses_of
from scenarios.studies.many.blame.trials import Trials

Item = TypeVar("Item")
FirstFailing = Callable[[Sequence[tuple[Item, ...]]], int | None]
"""Returns the index of the first set with which the test still fails, None if all pass.

It must not depend on the order in which they were tried.
"""


@dataclass(frozen=True, slots=True)
class SmallestSet(Generic[Item]):
    """The remaining items, in their order.

    With `is_minimal` the test passes without any one of them: each was left out and tried.
    """

    items: tuple[Item, ...]
    is_minimal: bool


def ddmin(
    items: Sequence[Item],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool] = lambda: False,
    chunks: int = 2,
) -> SmallestSet[Item]:
    """Leave out items while the test, which fails with all of them, goes on failing.

    Chunks are left out one after another, down to single items, each half as long as before once
    none can be left out; `chunks` is their first number. Once it is `enough` the set so far is
    returned. A single remaining item is minimal only if the test passes without any, which the
    caller has to know.
    """
    left = tuple(items)
    while len(left) > 1:
        parts = split(left, min(chunks, len(left)))
        kept = _remove_parts(parts, first_failing, is_exhausted)
        if is_exhausted():
            return SmallestSet(_concatenated(kept), is_minimal=False)
        if len(parts) == len(left) and len(kept) == len(parts):
            break
        # Removing items may make others redundant: single items are tried again.
        left, chunks = _concatenated(kept), 2 * len(kept)
    return SmallestSet(left, is_minimal=True)


def _remove_parts(
    parts: Sequence[tuple[Item, ...]],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool],
) -> list[tuple[Item, ...]]:
    """Leave out each part in turn that can be, but for the last one; returns the others."""
    kept, begin = list(parts), 0
    while begin < len(kept) > 1 and not is_exhausted():
        without = [_concatenated([*kept[:k], *kept[k + 1 :]]) for k in range(begin, len(kept))]
        place = first_failing(without)
        if place is None:
            break
        begin += place
        del kept[begin]
    return kept


def trim(
    items: Sequence[Item],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool] = lambda: False,
) -> tuple[Item, ...]:
    """Cut off items at the end and at the beginning while the test goes on failing.

    By bisection, two cuts at once: for successive causes it finds their ends in a few tests. The
    test fails with the result in any case.
    """
    left = tuple(items)
    for _ in range(2):
        left = left[::-1][_longest_cut(left[::-1], first_failing, is_exhausted) :]
    return left


def _longest_cut(
    items: tuple[Item, ...],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool],
) -> int:
    """Number of leading items that can be left out, if leaving out more makes the test pass."""
    fails, passes = 0, len(items)
    while passes - fails > 1 and not is_exhausted():
        third = max((passes - fails) // 3, 1)
        cuts = sorted({passes - third, fails + third}, reverse=True)
        place = first_failing([items[cut:] for cut in cuts])
        if place != 0:
            passes = cuts[-1] if place is None else cuts[place - 1]
        if place is not None:
            fails = cuts[place]
    return fails


def _concatenated(parts: Sequence[tuple[Item, ...]]) -> tuple[Item, ...]:
    return tuple(one for part in parts for one in part)


def split(items: tuple[Item, ...], chunks: int) -> list[tuple[Item, ...]]:
    """Split into `chunks` parts, none empty, of lengths that differ by one at most."""
    size = len(items)
    edges = [size * k // chunks for k in range(chunks + 1)]
    return [items[a:b] for a, b in pairwise(edges)]


def smallest_set(
    trials: Trials, bursts: Sequence[Burst], rows: Sequence[Attribution]
) -> SmallestSet[LostMessage]:
    """Shrink `bursts`, which break the limit while no loss does not.

    Starts from the row with the fewest messages that breaks it alone, if there is one.
    """
    alone = [row for row in rows if row.alone is not None and trials.is_breach(row.alone)]
    start = min(alone, key=lambda row: (row.messages, row.span_s)).group if alone else bursts
    trials.set_stage("the smallest set of bursts")
    first = partial(_first_breaking, trials, losses_of)
    of_bursts = ddmin(start, first, lambda: trials.is_exhausted)
    trials.set_stage("the smallest set of messages")
    messages = sorted(losses_of(of_bursts.items))
    first_of_messages = partial(_first_breaking, trials, frozenset)
    left = trim(messages, first_of_messages, lambda: trials.is_exhausted)
    # Without its ends most of a burst is needed, so single messages are tried at once.
    return ddmin(left, first_of_messages, lambda: trials.is_exhausted, chunks=len(left))


def _first_breaking(
    trials: Trials, losses: Callable[[Iterable[Item]], Losses], sets: Sequence[tuple[Item, ...]]
) -> int | None:
    return trials.first_breaking([losses(one) for one in sets])
