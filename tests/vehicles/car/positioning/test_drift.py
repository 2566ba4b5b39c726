"""Drift has the configured autocorrelation at any rate."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vehicles.car.dynamics import Body
from vehicles.car.gnss_error_terms import GRID, Drift, GaussMarkov, draw_truncated
from vehicles.schedule import SECOND, instants

BODY = Body(0.0, 0.0, 0.0, 0.0)
START = 1_700_000_000_123_456_789
LAGS = (1, 2, 5, 10, 20, 50, 100, 150, 200)


def path(
    time_constant: float, rate_hz: float, seconds: float, seed: int = 1
) -> NDArray[np.float64]:
    """East and north of a path, a column each."""
    process = GaussMarkov(Drift(1.0, time_constant), START, np.random.default_rng(seed))
    end = START + round(seconds * SECOND)
    return np.array([process.at(BODY, now) for now in instants(START, end, rate_hz)])


def autocorrelation(values: NDArray[np.float64], lag: int) -> float:
    """Autocorrelation of a process of mean 0."""
    return float(np.mean(values[lag:] * values[: len(values) - lag]) / np.mean(values * values))


@pytest.mark.campaign(4, 40)
def test_the_autocorrelation_is_exponential(campaign: int) -> None:
    """Within 0.1 at lags up to two time constants, over all paths of 20 000 s each."""
    time_constant = 100.0
    paths = [path(time_constant, 1.0, 20_000.0, seed) for seed in range(campaign)]
    for lag in LAGS:
        result = np.mean([np.mean(sample[lag:] * sample[:-lag]) for sample in paths])
        result /= np.mean([np.mean(sample * sample) for sample in paths])
        assert result == pytest.approx(math.exp(-lag / time_constant), abs=0.1), lag


def test_the_process_does_not_depend_on_the_rate() -> None:
    """At 5, 10 and 20 Hz: equal autocorrelation within 1 %, equal values at equal instants."""
    paths = {rate: path(100.0, rate, 4000.0) for rate in (5, 10, 20)}
    assert np.array_equal(paths[20][::2], paths[10])
    assert np.array_equal(paths[20][::4], paths[5])
    whole = {
        rate: [autocorrelation(sample, lag * rate) for lag in LAGS]
        for rate, sample in paths.items()
    }
    for rate in (5, 10):
        assert whole[rate] == pytest.approx(whole[20], abs=0.01)


def test_it_is_stationary_from_the_start() -> None:
    """At any time, both axes have standard deviation 1 and are uncorrelated."""
    count = 1000
    for seconds in (0.0, 3.0, 12.0):  # 12 s: beyond two blocks of the grid
        ends = [
            GaussMarkov(Drift(1.0, 10.0), START, np.random.default_rng(seed)).at(
                BODY, START + round(seconds * SECOND)
            )
            for seed in range(count)
        ]
        covariance = np.cov(np.array(ends).T)
        assert np.max(np.abs(covariance - np.eye(2))) < 5.0 * math.sqrt(2.0 / count)


def test_it_equals_the_plain_recursion() -> None:
    """The blocks are a rearrangement of x[k] = r x[k-1] + sqrt(1 - r²) w[k]."""
    time_constant = 0.5
    process = GaussMarkov(Drift(1.0, time_constant), START, np.random.default_rng(7))
    random = np.random.default_rng(7)
    kept = math.exp(-GRID / SECOND / time_constant)
    x = random.standard_normal(2)
    for block in range(3):
        drawn = random.standard_normal((2, 512))
        for k in range(512):
            x = kept * x + math.sqrt(1.0 - kept * kept) * drawn[:, k]
            now = START + (block * 512 + k + 1) * GRID
            assert process.at(BODY, now) == pytest.approx(tuple(x), abs=1e-10)


def uniform(random: np.random.Generator, count: int) -> Iterator[tuple[float, float]]:
    for sample in random.random((count, 2)).tolist():
        yield sample[0], sample[1]


@given(
    deviation=st.floats(0.01, 10.0),
    most=st.floats(0.0, 10.0),
    draws=st.tuples(st.floats(0, 1, exclude_max=True), st.floats(0, 1, exclude_max=True)),
)
def test_an_entry_jump_is_within_its_circle(
    deviation: float, most: float, draws: tuple[float, float]
) -> None:
    assert math.hypot(*draw_truncated(deviation, most, draws)) <= most * (1.0 + 1e-12)


def test_in_a_wide_circle_an_entry_jump_has_the_distribution_of_the_drift() -> None:
    places = np.array(
        [draw_truncated(0.3, 100.0, draws) for draws in uniform(np.random.default_rng(3), 8000)]
    )
    assert np.max(np.abs(np.cov(places.T) / 0.09 - np.eye(2))) < 5.0 * math.sqrt(2.0 / 8000)
    narrow = np.array(
        [draw_truncated(0.3, 0.03, draws) for draws in uniform(np.random.default_rng(3), 8000)]
    )
    # In a narrow circle the distribution is uniform, with a variance of radius² / 4 per axis.
    assert np.mean(narrow**2) == pytest.approx(0.03**2 / 4.0, rel=0.05)
