"""Runs as paths: a copy is its parent until that came nearer; and a risk that is known."""

from dataclasses import replace
from functools import cache, partial
from math import inf, sqrt

import numpy as np
import pytest

from scenarios.studies.many.limit import parsed_limit
from scenarios.studies.many.risk.branched import Splitting, gone_on, repeated
from scenarios.studies.many.risk.splitting import Mean, mean_of, split
from tests.made.scenarios.known_runs import KnownRuns, SilentRuns, small_convoy

RATIO = 0.1
WORK = Splitting(
    variant=small_convoy("links.loss_ratio=0.3", "gnss.position_noise_m=0.02"),
    limit=parsed_limit("error_m=4"),
    measure="limit",
    paths=4,
    most_runs=30,
)
RARE = {"1e-3": (1.0, 1.107271e-3), "1e-6": (4.0, 1.0e-6)}
"""Bounds of the true error (m), and the probability that a run with RATIO of losses is beyond."""


@cache
def known_runs() -> SilentRuns:
    return SilentRuns(RATIO, 1.0)


def test_a_copy_is_its_parent_until_that_came_nearer_than_the_level() -> None:
    parent = WORK.run(5)
    records = parent.watched.records
    level = records[len(records) // 2].value
    for seed in range(3):
        copy = gone_on(WORK.run, parent, level, seed)
        same = [one for one in records if one.at <= copy.branches[-1].at]
        assert list(copy.watched.records[: len(same)]) == same
        assert copy.severity > level
        again = gone_on(WORK.run, copy, copy.watched.records[0].value, seed)
        assert [branch.at for branch in again.branches] == sorted(
            {branch.at for branch in again.branches}
        )
    assert len({gone_on(WORK.run, parent, level, seed).watched for seed in range(6)}) > 1


def test_a_repetition_depends_on_its_number_alone() -> None:
    once, again, other = (repeated(WORK, number) for number in (1, 1, 2))
    assert once == again != other
    assert once.runs <= WORK.most_runs + WORK.paths
    worst = once.worst
    assert {*worst} == {"broken", "seed", "branches"}


def test_known_runs_lose_what_branched_runs_lose() -> None:
    """Or what follows would be about something else."""
    known = KnownRuns(0.4, 4.0)
    work = replace(WORK, variant=small_convoy("links.loss_ratio=0.4"))
    one, other = known.run(3), work.run(3)
    for seed in range(8):
        assert [record.at for record in one.watched.records] == [
            record.at for record in other.watched.records
        ]
        assert one.severity == pytest.approx(other.severity)
        level = one.watched.records[-2].value
        crossed = next(at for at in one.watched.records if at.value > level - 1e-9)
        assert crossed.value < inf
        one = gone_on(known.run, one, level - 1e-9, seed)
        other = gone_on(work.run, other, level - 1e-9, seed)
        assert one.branches == other.branches


@pytest.mark.long
@pytest.mark.campaign(0, 20)
@pytest.mark.parametrize("rare", RARE)
def test_splitting_is_right_about_a_known_risk(rare: str, campaign: int) -> None:
    """Over twenty seeds, against the exact probability, with 10⁵ counted runs beside."""
    if not campaign:
        pytest.skip("drives a thousand runs; with --campaign")
    bound, told = RARE[rare]
    known = SilentRuns(RATIO, bound, known_runs().driven)
    truth = known.truth()
    assert truth == pytest.approx(told, rel=1e-6)
    found = [estimate(known, seed, paths=100) for seed in range(1, campaign + 1)]
    whole = mean_of([mean.value for mean, _ in found])
    assert abs(whole.value - truth) < 3.0 * whole.standard_error
    assert whole.standard_error < 0.25 * truth
    assert max(runs for _, runs in found) < 20_000
    if rare == "1e-3":
        count = 100_000
        counted = known.counted(range(1, count + 1)) / count
        assert abs(counted - truth) < 3.0 * sqrt(truth / count)


def estimate(known: KnownRuns, seed: int, paths: int) -> tuple[Mean, int]:
    """The mean of ten repetitions, and how many runs they took."""
    found = [
        split(
            paths,
            known.run,
            partial(gone_on, known.run),
            np.random.Generator(np.random.PCG64([seed, number])),
        )
        for number in range(10)
    ]
    return mean_of([one.estimate for one in found]), sum(one.runs for one in found)
