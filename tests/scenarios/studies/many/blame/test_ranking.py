"""Ranking and shrinking for synthetic runs whose error is a formula of the losses."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import pytest

from scenarios.definition.run_limits import Limit
from scenarios.studies.job import Job
from scenarios.studies.many.blame import SmallestSet, smallest_set
from scenarios.studies.many.losses import (
    Losses,
    LossFreeScenario,
    LostMessage,
    bursts_of,
    overlaps_of,
)
from scenarios.studies.many.trials import (
    Attribution,
    RerunCriteria,
    RerunResult,
    Trials,
    losses_of,
    rank_losses,
    run_alone,
)
from tests.made.many.engines import SyntheticEngine

ErrorOf = Callable[[Losses], float]
LANE_M = 0.8
PERIOD = 50_000_000


class NoConvoy:
    def with_losses(self, losses: Losses) -> SimpleNamespace:
        return SimpleNamespace(text=losses)


def answer(error: float) -> RerunResult:
    broken = 1 if error > LANE_M else None
    return RerunResult(badness_m=error, vehicle="v3", worst_at=2, broken_at=broken)


def trials_of(error_of: ErrorOf, parallel: int = 1, max_runs: int = 1000) -> Trials:
    def result(job: Job) -> RerunResult:
        (losses, *_) = cast("partial[Any]", job.work).args
        return answer(error_of(losses))

    return Trials(
        convoy=cast("LossFreeScenario", NoConvoy()),
        criteria=RerunCriteria(figure="error", limit=Limit("lane_departures_max", 0), until=2),
        breaks_by=2,
        engine=SyntheticEngine(result),
        parallel=parallel,
        max_runs=max_runs,
    )


def lost(sender: str, first: int, count: int) -> list[LostMessage]:
    numbers = range(first, first + count)
    return [LostMessage(number * PERIOD, (sender, "v3"), number) for number in numbers]


HARMLESS = [one for number in range(0, 600, 6) for one in lost("v2", number, 1)]


def found(
    error_of: ErrorOf, messages: list[LostMessage], **how: int
) -> tuple[list[Attribution], SmallestSet[LostMessage], Trials]:
    trials, bursts = trials_of(error_of, **how), bursts_of(messages)
    whole = error_of(losses_of(bursts))
    rows = rank_losses(trials, bursts, answer(whole), whole - error_of(frozenset()))
    run_alone(trials, rows)
    return rows, smallest_set(trials, bursts, rows), trials


def test_bursts_are_consecutive_numbers_grouped_by_overlap() -> None:
    bursts = bursts_of([*lost("v1", 10, 5), *lost("v2", 13, 4), *lost("v1", 17, 1), *HARMLESS[:1]])
    assert [one.line for one in bursts] == [
        "v2 → v3 0",
        "v1 → v3 10-14",
        "v2 → v3 13-16",
        "v1 → v3 17",
    ]
    overlaps = overlaps_of(bursts)
    assert [len(one) for one in overlaps] == [1, 2, 1]
    assert [one for moment in overlaps for one in moment] == list(bursts)


@pytest.mark.parametrize("first", [0, 271, 580])
def test_the_harmful_one_of_a_hundred_bursts_is_found_in_few_runs(first: int) -> None:
    burst = frozenset(lost("v1", first, 20))
    rows, smallest, trials = found(
        lambda losses: 0.1 * len(losses & burst), [*HARMLESS, *burst], parallel=2
    )
    assert rows[0].losses == burst
    assert rows[0].reduction_m == pytest.approx(2.0)
    assert rows[0].alone is not None
    assert rows[0].alone.broken_at is not None
    assert len(smallest.items) == 9  # 0.1 m each, 0.8 m allowed
    assert smallest.is_minimal
    assert trials.runs < 60


def test_two_bursts_that_are_harmful_together_are_both_found() -> None:
    lead, ahead = frozenset(lost("v1", 300, 10)), frozenset(lost("v2", 302, 6))
    rows, smallest, _ = found(
        lambda losses: 1.5 * (lead | ahead <= losses), [*lost("v1", 100, 9), *lead, *ahead]
    )
    costly = {row.losses for row in rows if row.reduction_m > 1.0}
    assert {lead, ahead, lead | ahead} <= costly
    assert set(smallest.items) == lead | ahead


@pytest.mark.parametrize("parallel", [2, 3, 8])
def test_the_result_does_not_depend_on_the_number_of_parallel_runs(parallel: int) -> None:
    def error_of(losses: Losses) -> float:
        numbers = sorted(one.number for one in losses if one.link[0] == "v1")
        return 0.3 * sum(b - a == 1 for a, b in pairwise(numbers))

    messages = [*HARMLESS, *lost("v1", 50, 3), *lost("v1", 200, 9), *lost("v1", 400, 4)]
    one_by_one, smallest, _ = found(error_of, messages)
    rows, again, _ = found(error_of, messages, parallel=parallel)
    assert [row.losses for row in rows] == [row.losses for row in one_by_one]
    assert again == smallest


def test_a_set_is_not_minimal_when_the_runs_are_used_up() -> None:
    burst = frozenset(lost("v1", 271, 40))
    _, smallest, trials = found(
        lambda losses: 1.5 * (burst <= losses), [*HARMLESS, *burst], max_runs=30
    )
    assert burst <= set(smallest.items)
    assert not smallest.is_minimal
    assert trials.runs <= 31


def test_two_bursts_that_are_each_sufficient_are_both_divided() -> None:
    """Restoring one of them has no effect while the other is lost."""
    early, late = frozenset(lost("v1", 100, 8)), frozenset(lost("v1", 500, 8))
    rows, smallest, _ = found(
        lambda losses: 1.5 * (early <= losses or late <= losses), [*HARMLESS[:8], *early, *late]
    )
    alone = {row.losses for row in rows if row.alone and row.alone.broken_at is not None}
    assert {early, late} <= alone | {row.losses for row in rows}
    assert set(smallest.items) in (early, late)
