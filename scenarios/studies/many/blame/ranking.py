"""Which losses were to blame, by metres: of groups first, then of the parts of those that matter.

One run for each burst would be too many. Bursts in order of time are restored half by half, and a
half is only divided if restoring it reduces the error: bisection, the best half first. Bursts that
overlap in time are a moment and stay together until a moment is all that is left.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from scenarios.studies.many.blame.losses import Burst, Losses, overlaps_of
from scenarios.studies.many.blame.rerun import RerunResult
from scenarios.studies.many.blame.trials import Trials

Group = tuple[Burst, ...]
NEGLIGIBLE_M = 0.01
"""Groups that reduce the error by less are not divided."""
MAX_RUNS = 24
"""Most runs with restored groups."""
MAX_ALONE = 6
"""Number of the worst groups that also run with no other losses."""
DIVIDED_TOGETHER = 2
"""Groups divided together, whatever the number of workers: the result must not depend on it."""


@dataclass(slots=True)
class Attribution:
    """A burst, a moment, or an undivided group, and the metres that it cost.

    Restoring the group reduces the worst figure by `reduction_m`. `alone` is the result with no
    other losses, if simulated.
    """

    group: Group
    reduction_m: float
    alone: RerunResult | None = None
    potential_m: float = 0.0
    is_undivided: bool = True

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
        return "moment" if len(overlaps_of(self.group)) == 1 else "group"


def losses_of(bursts: Iterable[Burst]) -> Losses:
    return frozenset(one for burst in bursts for one in burst.messages)


def halves(group: Group) -> list[Group]:
    """Split a group by moments in two, a moment by its bursts; empty for a single burst."""
    parts: Sequence[Group] = overlaps_of(group)
    if len(parts) == 1:
        parts = [(burst,) for burst in group]
    if len(parts) == 1:
        return []
    middle = len(parts) // 2
    return [
        tuple(burst for part in some for burst in part) for some in (parts[:middle], parts[middle:])
    ]


def rank_losses(
    trials: Trials, bursts: Group, recorded: RerunResult, reduction_m: float
) -> list[Attribution]:
    """Rank bursts, moments, and undivided groups, the costliest first.

    `reduction_m` is the improvement when all are restored. If two halves improve nothing one by one
    but do together, both are divided.
    """
    every = losses_of(bursts)
    groups = [Attribution(bursts, reduction_m, potential_m=reduction_m)]
    most = trials.runs + MAX_RUNS
    while trials.runs < most and not trials.is_exhausted:
        promising = [
            one
            for one in groups
            if one.is_undivided and one.potential_m >= NEGLIGIBLE_M and len(one.group) > 1
        ]
        if not promising:
            break
        promising.sort(key=lambda one: (-one.potential_m, one.span_s, one.messages))
        groups += _divide(trials, promising[:DIVIDED_TOGETHER], every, recorded)
    shown = [one for one in groups if one.is_undivided or one.kind == "moment"]
    return sorted(shown, key=lambda one: (-one.reduction_m, one.messages, one.span_s))


def _divide(
    trials: Trials, some: Sequence[Attribution], every: Losses, recorded: RerunResult
) -> Iterator[Attribution]:
    """Close each of the groups, and yield its halves."""
    parts = [halves(one.group) for one in some]
    results = iter(trials.results(every - losses_of(part) for pair in parts for part in pair))
    for whole, pair in zip(some, parts, strict=True):
        whole.is_undivided = False
        reductions = [recorded.badness_m - next(results).badness_m for _ in pair]
        unexplained = 0.5 * (whole.potential_m - max(reductions))
        for part, metres in zip(pair, reductions, strict=True):
            yield Attribution(part, metres, potential_m=max(metres, unexplained))


def run_alone(trials: Trials, rows: Sequence[Attribution]) -> None:
    """Run with the losses of each of the worst rows alone."""
    worst = rows[:MAX_ALONE]
    for row, result in zip(worst, trials.results(row.losses for row in worst), strict=True):
        row.alone = result
