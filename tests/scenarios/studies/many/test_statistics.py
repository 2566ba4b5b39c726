"""Confidence intervals of shares, against SciPy and by coverage."""

from math import isclose

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from scenarios.studies.many.statistics import clopper_pearson, wilson

CONFIDENCES = st.sampled_from([0.8, 0.95, 0.99])


@settings(max_examples=25)
@given(st.integers(1, 400), st.data(), CONFIDENCES)
def test_intervals_of_a_share_equal_those_of_scipy(
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


@pytest.mark.spread(4)
@pytest.mark.parametrize("share", [0.003, 0.1, 0.5, 0.77])
@pytest.mark.parametrize("count", [8, 20, 200])
def test_the_coverage_of_the_exact_interval_is_at_least_nominal(count: int, share: float) -> None:
    """Summed over all possible counts, without simulation."""
    covered = sum(
        binom.pmf(successes, count, share)
        for successes in range(count + 1)
        if clopper_pearson(successes, count)[0] <= share <= clopper_pearson(successes, count)[1]
    )
    assert covered >= 0.95


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_the_coverage_of_wilson_s_interval_is_about_nominal(share: float) -> None:
    covered = sum(
        binom.pmf(successes, 50, share)
        for successes in range(51)
        if wilson(successes, 50)[0] <= share <= wilson(successes, 50)[1]
    )
    assert 0.93 < covered < 0.98


@pytest.mark.parametrize(("successes", "count"), [(1, 0), (-1, 5), (6, 5)])
def test_impossible_counts_are_refused(successes: int, count: int) -> None:
    for interval in (wilson, clopper_pearson):
        with pytest.raises(ValueError, match=f"{successes} of {count}"):
            interval(successes, count)
