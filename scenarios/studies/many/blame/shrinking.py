"""The smallest set of losses that still breaks the limit: bursts first, then messages in them.

Delta debugging: Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", IEEE
Transactions on Software Engineering 28(2), 2002. Only complements are tested: subsets double the
number of tests and are not needed for a 1-minimal result (Hodován and Kiss, "Practical
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
"""Returns the index of the first set with which the test fails, or None.

The result must not depend on the order of the tests.
"""


@dataclass(frozen=True, slots=True)
class SmallestSet(Generic[Item]):
    """The remaining items in their order.

    If `is_minimal`, the test passes as soon as any one item is removed.
    """

    items: tuple[Item, ...]
    is_minimal: bool


def ddmin(
    items: Sequence[Item],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool] = lambda: False,
    chunks: int = 2,
) -> SmallestSet[Item]:
    """Remove items as long as the test, which fails with all of them, still fails.

    Removes chunks, `chunks` of them at first, and halves their length when none can be removed.
    Returns the current set once `is_exhausted`. The caller must know that the test passes without
    any items.
    """
    left = tuple(items)
    while len(left) > 1:
        parts = split(left, min(chunks, len(left)))
        kept = _remove_parts(parts, first_failing, is_exhausted)
        if is_exhausted():
            return SmallestSet(_concatenated(kept), is_minimal=False)
        if len(parts) == len(left) and len(kept) == len(parts):
            break
        # Removed items can make others redundant, so test single items again.
        left, chunks = _concatenated(kept), 2 * len(kept)
    return SmallestSet(left, is_minimal=True)


def _remove_parts(
    parts: Sequence[tuple[Item, ...]],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool],
) -> list[tuple[Item, ...]]:
    """Remove each part in turn if possible, but not all; return the others."""
    kept, start = list(parts), 0
    while start < len(kept) > 1 and not is_exhausted():
        without = [_concatenated([*kept[:k], *kept[k + 1 :]]) for k in range(start, len(kept))]
        index = first_failing(without)
        if index is None:
            break
        start += index
        del kept[start]
    return kept


def trim(
    items: Sequence[Item],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool] = lambda: False,
) -> tuple[Item, ...]:
    """Remove items at the end and at the beginning as long as the test fails.

    Uses bisection with two cuts at a time, which takes few tests if the causes are consecutive.
    The test fails with the result in any case.
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
    """Number of leading items that can be removed, assuming that removing more passes."""
    fails, passes = 0, len(items)
    while passes - fails > 1 and not is_exhausted():
        third = max((passes - fails) // 3, 1)
        cuts = sorted({passes - third, fails + third}, reverse=True)
        index = first_failing([items[cut:] for cut in cuts])
        if index != 0:
            passes = cuts[-1] if index is None else cuts[index - 1]
        if index is not None:
            fails = cuts[index]
    return fails


def _concatenated(parts: Sequence[tuple[Item, ...]]) -> tuple[Item, ...]:
    return tuple(item for part in parts for item in part)


def split(items: tuple[Item, ...], chunks: int) -> list[tuple[Item, ...]]:
    """Split into `chunks` parts whose lengths differ by at most one."""
    size = len(items)
    edges = [size * k // chunks for k in range(chunks + 1)]
    return [items[a:b] for a, b in pairwise(edges)]


def smallest_set(
    trials: Trials, bursts: Sequence[Burst], rows: Sequence[Attribution]
) -> SmallestSet[LostMessage]:
    """Return the smallest set of losses that breaks the limit, which `bursts` break.

    Starts from the smallest row that breaks it alone, if any.
    """
    alone = [row for row in rows if row.alone is not None and trials.is_breach(row.alone)]
    start = min(alone, key=lambda row: (row.messages, row.span_s)).group if alone else bursts
    trials.set_stage("reducing the set of bursts")
    first = partial(_first_breaking, trials, losses_of)
    of_bursts = ddmin(start, first, lambda: trials.is_exhausted)
    trials.set_stage("reducing the set of messages")
    messages = sorted(losses_of(of_bursts.items))
    first_of_messages = partial(_first_breaking, trials, frozenset)
    left = trim(messages, first_of_messages, lambda: trials.is_exhausted)
    # Most of a trimmed burst is needed, so test single messages first.
    return ddmin(left, first_of_messages, lambda: trials.is_exhausted, chunks=len(left))


def _first_breaking(
    trials: Trials, losses: Callable[[Iterable[Item]], Losses], sets: Sequence[tuple[Item, ...]]
) -> int | None:
    return trials.first_breaking([losses(items) for items in sets])
