"""Confidence intervals of shares, against SciPy and by coverage."""

from math import isclose

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, binomtest, ttest_1samp

from scenarios.studies.many.variant import agresti_coull, mean_interval

CONFIDENCES = st.sampled_from([0.8, 0.95, 0.99])


@settings(max_examples=25)
@given(st.integers(1, 400), st.data(), CONFIDENCES)
def test_intervals_of_a_share_equal_those_of_scipy(
    count: int, data: st.DataObject, confidence: float
) -> None:
    successes = data.draw(st.integers(0, count))
    known = binomtest(successes, count)
    score = known.proportion_ci(confidence, method="wilson")
    low, high = agresti_coull(successes, count, confidence)
    assert 0.0 <= low <= score.low + 1e-9
    assert score.high - 1e-9 <= high <= 1.0
    if low > 0.0 and high < 1.0:
        assert isclose(low + high, score.low + score.high, abs_tol=1e-9)


@pytest.mark.parametrize("count", [10, 20, 50])
def test_the_interval_of_sweeps_covers_any_share(count: int) -> None:
    shares = np.linspace(0.0005, 0.5, 400)
    successes = np.arange(count + 1)
    low, high = np.transpose([agresti_coull(one, count) for one in successes.tolist()])
    inside = (low[:, None] <= shares) & (shares <= high[:, None])
    covered = (inside * binom.pmf(successes[:, None], count, shares)).sum(axis=0)
    assert covered.min() > 0.92
    assert covered.mean() < 0.98


def test_the_interval_of_a_mean_equals_that_of_scipy() -> None:
    values = np.random.default_rng(2).normal(-1.0, 2.0, 7).tolist()
    known = ttest_1samp(values, 0.0).confidence_interval(0.95)
    found = mean_interval(values)
    assert found[1:] == pytest.approx((known.low, known.high))
    gains = mean_interval(np.exp(values).tolist(), is_gain=True)
    assert np.log(np.array(gains, dtype=float)) == pytest.approx(found)
    assert mean_interval(values[:1]) == (values[0], None, None)


@pytest.mark.parametrize(("successes", "count"), [(1, 0), (-1, 5), (6, 5)])
def test_impossible_counts_are_refused(successes: int, count: int) -> None:
    with pytest.raises(ValueError, match=f"{successes} of {count}"):
        agresti_coull(successes, count)
