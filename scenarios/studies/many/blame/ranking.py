"""Ranking of losses by their effect in metres, by bisection.

One run per burst would take too long. Bursts in order of time are restored half by half; only
halves whose restoration reduces the error are divided further, the best half first. Bursts that
overlap in time are divided last.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from scenarios.studies.many.blame.losses import Burst, Losses, overlaps_of
from scenarios.studies.many.blame.rerun import RerunResult
from scenarios.studies.many.blame.trials import Trials

Group = tuple[Burst, ...]
NEGLIGIBLE_M = 0.01
"""Groups with a smaller effect are not divided."""
MAX_RUNS = 24
"""Maximum number of runs with restored groups."""
MAX_ALONE = 6
"""Number of top rows that are also simulated without other losses."""
DIVIDED_TOGETHER = 2
"""Groups divided in parallel; fixed, so that the result does not depend on the workers."""


@dataclass(slots=True)
class Attribution:
    """A burst, overlapping bursts, or an undivided group, and its effect in metres.

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
        """Sending times of the first and the last message (s after the start)."""
        return (
            min(burst.span_s[0] for burst in self.group),
            max(burst.span_s[1] for burst in self.group),
        )

    @property
    def kind(self) -> str:
        if len(self.group) == 1:
            return "burst"
        return "overlap" if len(overlaps_of(self.group)) == 1 else "group"


def losses_of(bursts: Iterable[Burst]) -> Losses:
    return frozenset(message for burst in bursts for message in burst.messages)


def halves(group: Group) -> list[Group]:
    """Split a group in two between overlaps, or within one; empty for a single burst."""
    parts: Sequence[Group] = overlaps_of(group)
    if len(parts) == 1:
        parts = [(burst,) for burst in group]
    if len(parts) == 1:
        return []
    middle = len(parts) // 2
    return [
        tuple(burst for part in half for burst in part) for half in (parts[:middle], parts[middle:])
    ]


def rank_losses(
    trials: Trials, bursts: Group, recorded: RerunResult, reduction_m: float
) -> list[Attribution]:
    """Rank bursts, overlaps and undivided groups by their effect.

    `reduction_m` is the effect of restoring all `bursts`. If two halves have an effect only when
    both are restored, both are divided.
    """
    all_losses = losses_of(bursts)
    groups = [Attribution(bursts, reduction_m, potential_m=reduction_m)]
    most = trials.runs + MAX_RUNS
    while trials.runs < most and not trials.is_exhausted:
        promising = [
            row
            for row in groups
            if row.is_undivided and row.potential_m >= NEGLIGIBLE_M and len(row.group) > 1
        ]
        if not promising:
            break
        promising.sort(key=lambda row: (-row.potential_m, row.span_s, row.messages))
        groups += _divide(trials, promising[:DIVIDED_TOGETHER], all_losses, recorded)
    shown = [row for row in groups if row.is_undivided or row.kind == "overlap"]
    return sorted(shown, key=lambda row: (-row.reduction_m, row.messages, row.span_s))


def _divide(
    trials: Trials, rows: Sequence[Attribution], all_losses: Losses, recorded: RerunResult
) -> Iterator[Attribution]:
    parts = [halves(row.group) for row in rows]
    results = iter(trials.results(all_losses - losses_of(part) for pair in parts for part in pair))
    for whole, pair in zip(rows, parts, strict=True):
        whole.is_undivided = False
        reductions = [recorded.badness_m - next(results).badness_m for _ in pair]
        unexplained = 0.5 * (whole.potential_m - max(reductions))
        for part, metres in zip(pair, reductions, strict=True):
            yield Attribution(part, metres, potential_m=max(metres, unexplained))


def run_alone(trials: Trials, rows: Sequence[Attribution]) -> None:
    """Simulate each of the top rows without other losses."""
    worst = rows[:MAX_ALONE]
    for row, result in zip(worst, trials.results(row.losses for row in worst), strict=True):
        row.alone = result
