"""Parallel reruns with other losses; none is repeated."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf
from operator import itemgetter
from typing import Literal

import numpy as np

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.limits import first_breach
from scenarios.results.tables import RunTables
from scenarios.results.vehicle_figures import true_errors, true_gaps
from scenarios.runs.virtual import run_tables
from scenarios.studies.engine import Engine
from scenarios.studies.job import Job
from scenarios.studies.many.losses import (
    NO_END,
    Burst,
    Losses,
    LossFreeScenario,
    overlaps_of,
)
from vehicles.schedule import SECOND

# ---- One run with other losses: its worst figure, and whether it breaks a limit


FigureName = Literal["error", "gap"]
"""The largest true cross-track error of a follower, or the smallest true gap to its predecessor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RerunCriteria:
    """Figure and limit to evaluate, until an instant (ns after the start)."""

    figure: FigureName
    limit: Limit
    until: int = NO_END


@dataclass(frozen=True, slots=True, kw_only=True)
class RerunResult:
    """The worst figure of a run (m), its vehicle and instant, and the breach of the limit.

    `badness_m` is the error or the negative gap. Instants are in ns after the start; `broken_at` is
    None if the limit was kept. `series` are instants (s) and figures (m) of each vehicle, if
    requested.
    """

    badness_m: float
    vehicle: str
    worst_at: int
    broken_at: int | None
    series: dict[str, list[list[float]]] = field(default_factory=dict)

    @property
    def figure_m(self) -> float:
        return abs(self.badness_m)


def result_of(run: RunTables, criteria: RerunCriteria, *, whole: bool = False) -> RerunResult:
    """Evaluate a run up to `criteria.until`; `whole`: with series."""
    start_at = run.beginning
    if criteria.until < run.ran_ns:
        run = run.until(start_at + criteria.until)
    worst, series = (-inf, "", 0), dict[str, list[list[float]]]()
    for name in run.followers:
        at, values = (true_errors if criteria.figure == "error" else true_gaps)(run, name)
        known = ~np.isnan(values)
        after, sizes = at[known] - start_at, np.abs(values[known])
        series[name] = np.column_stack((after / SECOND, sizes)).tolist()
        if len(sizes):
            badness = sizes if criteria.figure == "error" else -sizes
            row = int(np.argmax(badness))
            worst = max(worst, (float(badness[row]), name, int(after[row])), key=itemgetter(0))
    badness_m, vehicle, at_worst = worst
    broken_at = first_breach(run, criteria.limit)
    return RerunResult(
        badness_m=badness_m if vehicle else 0.0,
        vehicle=vehicle,
        worst_at=at_worst,
        broken_at=None if broken_at is None else broken_at - start_at,
        series=series if whole else {},
    )


def rerun(scenario: Scenario, criteria: RerunCriteria, *, whole: bool = False) -> RerunResult:
    """Run in virtual time until `criteria.until`; `whole`: with series.

    A failed vehicle ends the run.
    """
    run, _ = run_tables(scenario, is_over=lambda run: run.ran_ns > criteria.until)
    return result_of(run, criteria, whole=whole)


# ---- Trials


@dataclass(slots=True)
class Trials:
    """Reruns of one recorded run, each with other losses.

    There are up to `max_runs` runs, `parallel` at a time. A set of losses breaks the limit if that
    happens by `breaks_by` (ns after the start).
    """

    convoy: LossFreeScenario
    criteria: RerunCriteria
    breaks_by: int
    engine: Engine
    parallel: int
    max_runs: int
    runs: int = 0
    _results: dict[Losses, RerunResult] = field(default_factory=dict)

    @property
    def is_exhausted(self) -> bool:
        return self.runs >= self.max_runs

    def results(self, sets: Iterable[Losses], *, whole: bool = False) -> list[RerunResult]:
        """Return the results of runs with exactly these losses; `whole`: with series."""
        wanted = list(sets)
        new = [losses for losses in dict.fromkeys(wanted) if whole or losses not in self._results]
        texts = [self.convoy.with_losses(losses).text for losses in new]
        jobs = [
            Job(key=f"run {number}", work=partial(_rerun, text, self.criteria, whole=whole))
            for number, text in enumerate(texts, self.runs + 1)
        ]
        self.runs += len(jobs)
        self._results |= zip(new, self.engine.results(jobs), strict=True)
        return [self._results[losses] for losses in wanted]

    def first_breaking(self, sets: Sequence[Losses]) -> int | None:
        """Return the index of the first set of losses that breaks the limit, or None.

        The result does not depend on `parallel`. Sets that `max_runs` leaves unsimulated count as
        not breaking it.
        """
        for start in range(0, len(sets), self.parallel):
            chunk = sets[start : start + self.parallel]
            if not self.is_exhausted:
                self.results(chunk)
            for index, losses in enumerate(chunk, start):
                if losses in self._results and self.is_breach(self._results[losses]):
                    return index
        return None

    def is_breach(self, result: RerunResult) -> bool:
        return result.broken_at is not None and result.broken_at <= self.breaks_by


def _rerun(text: str, criteria: RerunCriteria, *, whole: bool) -> RerunResult:
    return rerun(scenario_from_text(text), criteria, whole=whole)


# ---- Ranking of losses by their effect in metres, by bisection
#
# One run per burst would take too long. Bursts in order of time are restored half by half; only
# halves whose restoration reduces the error are divided further, the best half first. Bursts that
# overlap in time are divided last.


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
