"""Laws of delay: distribution, moments and correlation against closed forms and scipy."""

from functools import cache
from math import asin, exp, log1p, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from transport.links.laws.correlated_normals import CorrelatedNormals
from transport.links.laws.delays import (
    EmpiricalDelay,
    GammaDelay,
    LognormalDelay,
    NormalDelay,
    RandomDelay,
    UniformDelay,
    log_quantile,
    log_quantiles,
)
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import keyed_draw

MS = 1e6
KS_LIMIT = 1.9495
"""0.1 % point of Kolmogorov's distribution, for D √n."""
ENTIRE = 100_000
BATCHES = 50

LAWS: dict[str, RandomDelay] = {
    "uniform": UniformDelay(delay_ms_min=5.0, delay_ms_max=45.0),
    "normal": NormalDelay(mean_ms=30.0, deviation_ms=5.0),
    "truncated": NormalDelay(mean_ms=10.0, deviation_ms=12.0, delay_ms_max=30.0),
    "lognormal": LognormalDelay(mean_ms=20.0, deviation_ms=12.0),
    "gamma": GammaDelay(mean_ms=20.0, deviation_ms=15.0),
    "empirical": EmpiricalDelay(recorded_ms=(1.0, 1.0, 2.0, 4.0, 8.0, 8.5, 30.0, 31.0)),
}
SCIPY = {
    "uniform": stats.uniform(5 * MS, 40 * MS),
    "normal": stats.truncnorm(-6, np.inf, 30 * MS, 5 * MS),
    "truncated": stats.truncnorm(-10 / 12, 20 / 12, 10 * MS, 12 * MS),
    "lognormal": stats.lognorm(sqrt(log1p(0.36)), scale=20 * MS * exp(-0.5 * log1p(0.36))),
    "gamma": stats.gamma((20 / 15) ** 2, scale=15 * MS * 15 / 20),
}


def correlated(law: RandomDelay, correlation: float) -> RandomDelay:
    return law.model_copy(update={"correlation_ratio": correlation})


def delays(law: RandomDelay, correlation: float, seed: int, count: int) -> np.ndarray:
    effect, draw = correlated(law, correlation), keyed_draw(seed, "a", "b")
    return np.array(
        [effect.judge(draw, TransmissionContext(seq, 0)) for seq in range(count)], dtype=float
    )


@cache
def hermite_weights(law: RandomDelay) -> np.ndarray:
    """Squared coefficients of the law in normalised Hermite polynomials, by quadrature.

    With normal numbers of correlation r, two delays have covariance Σ weight[n] r^n (Mehler).
    """
    z = np.linspace(-8.0, 8.0, 16_001)
    values = np.array([law.at(value) for value in z]) * stats.norm.pdf(z) * (z[1] - z[0])
    before, here, weights = np.zeros_like(z), np.ones_like(z), []
    for n in range(200):
        before, here = here, (z * here - sqrt(n) * before) / sqrt(n + 1)
        weights.append(float(values @ here) ** 2)
    return np.array(weights)


def correlation_of_delays(law: RandomDelay, r: float) -> float:
    """Autocorrelation of the delays if that of the normal numbers is `r`."""
    if law is LAWS["uniform"]:
        return 6.0 / pi * asin(r / 2.0)
    if law is LAWS["lognormal"]:
        return (exp(r * log1p(0.36)) - 1.0) / 0.36
    weights = hermite_weights(law)
    return float(weights @ r ** np.arange(1, 201)) / law.deviation_ns**2


def scores(law: RandomDelay, correlation: float, sample: np.ndarray) -> list[float]:
    """Errors of mean, variance and lags 1, 2, 5 in standard errors, by batch means."""
    off = (sample - law.mean_ns) / law.deviation_ns
    found = [(off, 0.0), (off**2, 1.0)]
    for lag in (1, 2, 5):
        wanted = correlation_of_delays(law, correlation**lag)
        found.append((off[lag:] * off[:-lag], wanted))
    out = []
    for series, wanted in found:
        batches = [float(np.mean(part)) for part in np.array_split(series, BATCHES)]
        error = float(np.std(batches, ddof=1)) / sqrt(BATCHES)
        out.append((float(np.mean(series)) - wanted) / error)
    return out


@pytest.mark.campaign(8_000, ENTIRE)
def test_moments_and_correlation_are_the_law_s(campaign: int) -> None:
    seeds = (1, 2, 3) if campaign == ENTIRE else (1,)
    found = {
        (name, tied, seed): scores(law, tied, delays(law, tied, seed, campaign))
        for name, law in LAWS.items()
        for tied in (0.0, 0.6, 0.9)
        for seed in seeds
    }
    each = [abs(value) for row in found.values() for value in row]
    assert max(each) < 5.0, found
    assert sum(value > 3.0 for value in each) <= max(0.01 * len(each), 1.0), found


@pytest.mark.parametrize("name", SCIPY)
@pytest.mark.parametrize("tied", [0.0, 0.9])
@pytest.mark.campaign(4_000, ENTIRE)
def test_delays_follow_their_law_for_any_correlation(name: str, tied: float, campaign: int) -> None:
    apart = 100 if tied else 1  # 0.9 ** 100 is 3e-5, nearly independent
    sample = delays(LAWS[name], tied, 5, campaign)[::apart]
    distance = stats.kstest(sample, SCIPY[name].cdf).statistic
    assert distance * sqrt(sample.size) < KS_LIMIT
    assert SCIPY[name].mean() == pytest.approx(LAWS[name].mean_ns, rel=1e-6)
    assert SCIPY[name].std() == pytest.approx(LAWS[name].deviation_ns, rel=1e-6)


@pytest.mark.campaign(8_000, ENTIRE)
def test_recorded_delays_come_as_often_as_they_were_recorded(campaign: int) -> None:
    sample = delays(LAWS["empirical"], 0.0, 4, campaign)
    values, counts = np.unique(sample, return_counts=True)
    assert values.tolist() == [MS * x for x in (1, 2, 4, 8, 8.5, 30, 31)]
    shares = np.array([2, 1, 1, 1, 1, 1, 1]) / 8
    assert stats.chisquare(counts, shares * campaign).pvalue > 0.001


@pytest.mark.parametrize("name", LAWS)
def test_quantiles_are_scipy_s_and_grow(name: str) -> None:
    law = LAWS[name]
    z = np.linspace(-6.0, 6.0, 1201)  # scipy's truncnorm is less accurate beyond
    found = np.array([law.at(value) for value in z])
    assert np.all(np.diff(found) >= 0.0)
    assert np.all(found >= 0.0)
    if name in SCIPY:
        below, above = SCIPY[name].ppf(stats.norm.cdf(z)), SCIPY[name].isf(stats.norm.sf(z))
        assert found == pytest.approx(np.where(z < 0.0, below, above), rel=1e-7, abs=1e-3)


@pytest.mark.parametrize("shape", [0.04, 0.3, 1.0, 4.0, 100.0, 1e4])
def test_the_table_of_gamma_quantiles_is_exact_enough(shape: float) -> None:
    z = np.linspace(-8.2, 8.2, 801)
    table = log_quantiles(shape)
    found = np.array([log_quantile(table, value) for value in z])
    law = stats.gamma(shape)
    wanted = np.where(z < 0.0, law.ppf(stats.norm.cdf(z)), law.isf(stats.norm.sf(z)))
    seen = wanted > 1e-290  # scipy returns 0 below
    assert np.abs(found[seen] - np.log(wanted[seen])).max() < 1e-7


def test_correlated_numbers_keep_law_and_correlation_across_blocks() -> None:
    """Each number equals a recursion over the same draws from far back."""
    for correlation in (0.05, 0.5, 0.95):
        normals, draw = CorrelatedNormals("delay", correlation), keyed_draw(3, "a", "b")
        plain = CorrelatedNormals("delay")
        value, wanted = 0.0, []
        for seq in range(-3000, 900):
            value = correlation * value + sqrt(1 - correlation**2) * plain.at(draw, seq)
            wanted.append(value)
        found = [normals.at(draw, seq) for seq in range(900)]
        assert found == pytest.approx(wanted[3000:], abs=1e-8)


@given(
    correlation=st.sampled_from([0.0, 0.01, 0.3, 0.8]),
    requested=st.lists(st.integers(0, 400), min_size=1, max_size=12),
    seed=st.integers(0, 1000),
)
def test_a_delay_alone_is_the_one_in_the_stream(
    correlation: float, requested: list[int], seed: int
) -> None:
    law, draw = LAWS["gamma"], keyed_draw(seed, "a", "b")
    streamed = delays(law, correlation, seed, 401)
    again = correlated(law, correlation)
    for seq in requested:
        alone = correlated(law, correlation)
        wanted = streamed[seq]
        assert alone.judge(draw, TransmissionContext(seq, 0)) == wanted
        assert again.judge(draw, TransmissionContext(seq, 0)) == wanted  # in any order
