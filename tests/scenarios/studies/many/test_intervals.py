"""Intervals of shares and quantiles: against scipy, by coverage, and at their ends."""

from math import isclose

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from scenarios.studies.many.intervals import clopper_pearson, quantile_ranks, wilson

CONFIDENCES = st.sampled_from([0.8, 0.95, 0.99])


@settings(max_examples=25)
@given(st.integers(1, 400), st.data(), CONFIDENCES)
def test_both_intervals_of_a_share_are_scipy_s(
    count: int, data: st.DataObject, confidence: float
) -> None:
    successes = data.draw(st.integers(0, count))
    known = binomtest(successes, count)
    score = known.proportion_ci(confidence, method="wilson")
    exact = known.proportion_ci(confidence, method="exact")
    for theirs, ours in ((score, wilson), (exact, clopper_pearson)):
        low, high = ours(successes, count, confidence)
        assert isclose(low, theirs.low, abs_tol=1e-9)
        assert isclose(high, theirs.high, abs_tol=1e-9)
        assert 0.0 <= low <= successes / count <= high <= 1.0


@pytest.mark.parametrize("share", [0.003, 0.1, 0.5, 0.77])
@pytest.mark.parametrize("count", [8, 20, 200])
def test_the_exact_interval_covers_at_least_as_often_as_it_says(count: int, share: float) -> None:
    """Summed over all counts there can be, so no simulation is needed."""
    covered = sum(
        binom.pmf(successes, count, share)
        for successes in range(count + 1)
        if clopper_pearson(successes, count)[0] <= share <= clopper_pearson(successes, count)[1]
    )
    assert covered >= 0.95


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_wilson_s_interval_covers_about_as_often_as_it_says(share: float) -> None:
    covered = sum(
        binom.pmf(successes, 50, share)
        for successes in range(51)
        if wilson(successes, 50)[0] <= share <= wilson(successes, 50)[1]
    )
    assert 0.93 < covered < 0.98


@pytest.mark.parametrize(("count", "share"), [(20, 0.5), (20, 0.25), (100, 0.9), (400, 0.05)])
def test_ranks_hold_the_quantile_as_often_as_they_say(count: int, share: float) -> None:
    """Of the law whose quantiles are the shares themselves; any other is a stretch of it."""
    ranks = quantile_ranks(count, share)
    draws = np.sort(np.random.Generator(np.random.PCG64(3)).random((3000, count)), axis=1)
    low = draws[:, ranks.low - 1] if ranks.low else np.zeros(len(draws))
    high = draws[:, ranks.high - 1] if ranks.high <= count else np.ones(len(draws))
    covered = np.mean((low <= share) & (share < high))
    assert ranks.coverage >= 0.95
    assert abs(covered - ranks.coverage) < 4.0 * (0.05 * 0.95 / len(draws)) ** 0.5


def test_ranks_of_the_median_of_twenty() -> None:
    """The textbook's: the 6th and the 15th, at 95.9 %."""
    ranks = quantile_ranks(20, 0.5)
    assert (ranks.low, ranks.high, round(ranks.coverage, 3)) == (6, 15, 0.959)


def test_few_values_bound_a_quantile_on_one_side_or_not_at_all() -> None:
    ranks = quantile_ranks(5, 0.5)
    assert (ranks.low, ranks.high, ranks.coverage) == (0, 6, 1.0)
    assert quantile_ranks(20, 0.01).low == 0


@pytest.mark.parametrize(("successes", "count"), [(1, 0), (-1, 5), (6, 5)])
def test_counts_that_there_are_not_are_refused(successes: int, count: int) -> None:
    for interval in (wilson, clopper_pearson):
        with pytest.raises(ValueError, match=f"{successes} of {count}"):
            interval(successes, count)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.5])
def test_quantiles_at_the_ends_are_refused(share: float) -> None:
    with pytest.raises(ValueError, match="quantile"):
        quantile_ranks(20, share)
