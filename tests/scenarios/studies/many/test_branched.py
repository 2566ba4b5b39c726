"""Branched runs: copies equal their parents up to the branch, and known risks are estimated."""

from dataclasses import replace
from functools import cache, partial
from math import inf, sqrt
from random import Random

import numpy as np
import pytest

from scenarios.definition.run_limits import Limit
from scenarios.studies.many.limit_history import watch_limit
from scenarios.studies.many.risk import RiskQuery, estimate_risk
from scenarios.studies.many.splitting import Splitting, continue_run, run_repetition, split
from scenarios.studies.many.statistics import Mean, mean_of
from tests.made.many.engines import engine_here
from tests.made.many.known_runs import KnownRuns, SilentRuns, small_convoy
from tests.scenarios.studies.many.lost_path_runs import (
    MESSAGES,
    loses_path,
    lost_path_convoy,
    probability,
)

RATIO = 0.1
WORK = Splitting(
    variant=small_convoy("links.loss_ratio=0.3", "gnss.position_noise_m=0.02"),
    limit=Limit("cross_track_error_m_max", 4.0),
    measure="limit",
    paths=4,
    max_runs=30,
)
RARE = {"1e-3": (2.0, 1.592848e-3, 40), "1e-6": (4.2, 1.0e-6, 10)}
"""Bounds of the true error (m), the probability of exceeding it at the loss RATIO, and the
repetitions of one estimate. With ten repetitions one of 70 estimates is three standard errors off
(Student's t)."""
RARE_RATIO = 0.17
"""Ratio of independent losses with nine in a row about once in a million runs."""


@cache
def known_runs() -> SilentRuns:
    return SilentRuns(RATIO, 1.0)


def test_a_copy_equals_its_parent_until_it_exceeds_the_level() -> None:
    parent = WORK.run(5)
    records = parent.history.records
    level = records[len(records) // 2].value
    for seed in range(3):
        copy = continue_run(WORK.run, parent, level, seed)
        same = [record for record in records if record.at <= copy.branches[-1].at]
        assert list(copy.history.records[: len(same)]) == same
        assert copy.severity > level
        again = continue_run(WORK.run, copy, copy.history.records[0].value, seed)
        assert [branch.at for branch in again.branches] == sorted(
            {branch.at for branch in again.branches}
        )
    assert len({continue_run(WORK.run, parent, level, seed).history for seed in range(6)}) > 1


def test_a_repetition_depends_only_on_its_number() -> None:
    once, again, other = (run_repetition(WORK, number) for number in (1, 1, 2))
    assert once == again != other
    assert once["runs"] <= WORK.max_runs + WORK.paths
    assert {*once["worst"]} == {"broken", "seed", "branches"}


def test_known_runs_lose_the_same_messages_as_branched_runs() -> None:
    known = KnownRuns(0.4, 4.0)
    work = replace(WORK, variant=small_convoy("links.loss_ratio=0.4"))
    one, other = known.run(3), work.run(3)
    for seed in range(8):
        assert [record.at for record in one.history.records] == [
            record.at for record in other.history.records
        ]
        assert one.severity == pytest.approx(other.severity)
        level = one.history.records[-2].value
        crossed = next(at for at in one.history.records if at.value > level - 1e-9)
        assert crossed.value < inf
        one = continue_run(known.run, one, level - 1e-9, seed)
        other = continue_run(work.run, other, level - 1e-9, seed)
        assert one.branches == other.branches


@pytest.mark.long
@pytest.mark.campaign(0, 20)
@pytest.mark.parametrize("rare", RARE)
def test_splitting_estimates_a_known_risk(rare: str, campaign: int) -> None:
    """Over twenty seeds, against the exact probability and a count of 10⁵ runs."""
    if not campaign:
        pytest.skip("simulates a thousand runs; use --campaign")
    bound, expected, repetitions = RARE[rare]
    known = SilentRuns(RATIO, bound, known_runs().simulated)
    truth = known.truth()
    assert truth == pytest.approx(expected, rel=1e-6)
    found = [estimate(known, seed, repetitions) for seed in range(1, campaign + 1)]
    whole = mean_of([mean.value for mean, _ in found])
    assert abs(whole.value - truth) < 3.0 * whole.standard_error
    assert whole.standard_error < 0.25 * truth
    if rare == "1e-6":
        assert max(runs for _, runs in found) < 20_000
    else:
        count = 100_000
        counted = known.counted(range(1, count + 1)) / count
        assert abs(counted - truth) < 3.0 * sqrt(truth / count)
        away = [abs(mean.value - counted) / mean.standard_error for mean, _ in found]
        print("standard errors from the counted share:", *[f"{one:.1f}" for one in away])
        assert max(away) < 3.0


def estimate(known: KnownRuns, seed: int, repetitions: int) -> tuple[Mean, int]:
    """Mean of several repetitions, and their number of runs."""
    found = [
        split(
            100,
            known.run,
            partial(continue_run, known.run),
            np.random.Generator(np.random.PCG64([seed, number])),
        )
        for number in range(repetitions)
    ]
    return mean_of([one.estimate for one in found]), sum(one.runs for one in found)


@pytest.mark.campaign(20, 1000)
def test_nine_losses_in_a_row_always_lose_the_path(campaign: int) -> None:
    random, found = Random(3), set[bool]()
    for _ in range(campaign):
        ratio = random.choice((0.75, 0.85, 0.9))
        lost = [number for number in range(MESSAGES) if random.random() < ratio]
        law = f"links.loss={{kind='listed', lost_numbers='{','.join(map(str, lost))}'}}"
        run = lost_path_convoy("links.loss_ratio=0", *([law] if lost else []))
        broken = watch_limit(run.scenario, Limit("paths_lost_max", 0)).broken
        assert broken == loses_path(lost), lost
        found.add(broken)
    assert found == {False, True}


def test_the_probability_of_a_row_matches_random_losses() -> None:
    random, count, ratio = np.random.default_rng(5), 20_000, 0.5
    lost = random.random((count, MESSAGES)) < ratio
    share = sum(loses_path(np.flatnonzero(one).tolist()) for one in lost) / count
    expected = probability(ratio)
    assert abs(share - expected) < 4.0 * sqrt(expected * (1.0 - expected) / count)


@pytest.mark.long
@pytest.mark.campaign(0, 8)
def test_one_in_a_million_is_estimated_within_half_by_twenty_thousand_runs(campaign: int) -> None:
    """Takes two minutes per seed on two cores."""
    if not campaign:
        pytest.skip("simulates 20 000 runs per seed; use --campaign")
    truth = probability(RARE_RATIO)
    assert 0.5e-6 < truth < 2e-6
    inside = 0
    with engine_here(None) as engine:
        for seed in range(1, campaign + 1):
            query = RiskQuery(
                variant=replace(lost_path_convoy(f"links.loss_ratio={RARE_RATIO}"), seed=seed),
                limit=Limit("paths_lost_max", 0),
                method="splitting",
                measure="silence",
                precision=1e-9,
                max_runs=20_000,
                paths=120,
            )
            risk = estimate_risk(query, engine)
            assert risk.runs <= 20_000
            assert risk.relative_half_width < 0.5
            assert abs(risk.probability - truth) < 3.0 * risk.standard_error
            inside += risk.low < truth < risk.high
    assert inside >= campaign - 2
