"""Which losses were to blame, by metres: of groups first, then of the parts of those that matter.

A run for each burst would be too many. Bursts in order of time are given back half by half, and a
half is only looked into where giving it back mends something: bisection, the best half first.
Bursts that overlap in time are a moment and stay together until a moment is all that is left.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from scenarios.studies.many.blame.losses import Burst, Losses, moments_of
from scenarios.studies.many.blame.rerun import BlameAnswer
from scenarios.studies.many.blame.trials import Trials

Group = tuple[Burst, ...]
NEGLIGIBLE_M = 0.01
"""Groups that mend less are not looked into."""
MOST_RUNS = 24
"""With groups given back."""
ALONE = 6
"""So many of the worst are also lost alone."""
AT_ONCE = 2
"""So many groups are looked into together, whatever the number of workers: so that what is found
does not depend on it."""


@dataclass(slots=True)
class Attribution:
    """A burst, a moment, or an undivided group, and the metres that it cost.

    `mended_m` is the improvement of the worst figure when the group is restored; `alone` is the run
    with no other losses, if it ran.
    """

    group: Group
    mended_m: float
    alone: BlameAnswer | None = None

    @property
    def messages(self) -> int:
        return sum(len(burst.messages) for burst in self.group)

    @property
    def losses(self) -> Losses:
        return losses_of(self.group)

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first and the last message were sent (s after the start)."""
        return (
            min(burst.span_s[0] for burst in self.group),
            max(burst.span_s[1] for burst in self.group),
        )

    @property
    def kind(self) -> str:
        if len(self.group) == 1:
            return "burst"
        return "moment" if len(moments_of(self.group)) == 1 else "group"


def losses_of(bursts: Iterable[Burst]) -> Losses:
    return frozenset(one for burst in bursts for one in burst.messages)


def halves(group: Group) -> list[Group]:
    """Split a group by moments in two, a moment by its bursts; empty for a single burst."""
    parts: Sequence[Group] = moments_of(group)
    if len(parts) == 1:
        parts = [(burst,) for burst in group]
    if len(parts) == 1:
        return []
    middle = len(parts) // 2
    return [
        tuple(burst for part in some for burst in part) for some in (parts[:middle], parts[middle:])
    ]


@dataclass(slots=True)
class _Half:
    """A group and the metres that it may cost: its own, or what its halves leave unexplained."""

    blamed: Attribution
    promise_m: float
    is_open: bool = True


def ranked(
    trials: Trials, bursts: Group, recorded: BlameAnswer, mended_m: float
) -> list[Attribution]:
    """Rank bursts, moments, and undivided groups, the costliest first.

    `mended_m` is the improvement when all are restored. If two halves improve nothing one by one
    but do together, both are divided.
    """
    every = losses_of(bursts)
    halves_seen = [_Half(Attribution(bursts, mended_m), mended_m)]
    most = trials.runs + MOST_RUNS
    while trials.runs < most and not trials.are_enough:
        promising = [
            half
            for half in halves_seen
            if half.is_open and half.promise_m >= NEGLIGIBLE_M and len(half.blamed.group) > 1
        ]
        if not promising:
            break
        promising.sort(key=lambda half: (-half.promise_m, half.blamed.span_s, half.blamed.messages))
        halves_seen += _looked_into(trials, promising[:AT_ONCE], every, recorded)
    shown = [half.blamed for half in halves_seen if half.is_open or half.blamed.kind == "moment"]
    return sorted(shown, key=lambda one: (-one.mended_m, one.messages, one.span_s))


def _looked_into(
    trials: Trials, some: Sequence[_Half], every: Losses, recorded: BlameAnswer
) -> Iterator[_Half]:
    """Close each of the groups, and yield its halves."""
    parts = [halves(one.blamed.group) for one in some]
    answers = iter(trials.answers(every - losses_of(part) for pair in parts for part in pair))
    for whole, pair in zip(some, parts, strict=True):
        whole.is_open = False
        mended = [recorded.badness_m - next(answers).badness_m for _ in pair]
        unexplained = 0.5 * (whole.promise_m - max(mended))
        for part, metres in zip(pair, mended, strict=True):
            yield _Half(Attribution(part, metres), max(metres, unexplained))


def try_alone(trials: Trials, rows: Sequence[Attribution]) -> None:
    """Run with the losses of each of the worst rows alone."""
    worst = rows[:ALONE]
    for row, answer in zip(worst, trials.answers(row.losses for row in worst), strict=True):
        row.alone = answer
