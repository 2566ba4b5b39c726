"""Maximum-likelihood fit of a link's delay law to recorded delays.

On links that preserve order, a message that waited for an earlier one is left-censored: its own
delay was at most the recorded one. Correlated delays enter conditionally on the previous delay.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil, exp, inf, log, log1p, sqrt, tanh
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from scenarios.studies.channel.recorded import Estimate

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOLERANCE_MS = 1e-3
"""Delays that differ by less count as equal."""
MIN_MESSAGES = 100
"""With fewer delays the recorded ones are used instead of a law."""
NEGLIGIBLE_CORRELATION = 0.05
"""Messages with a smaller correlation count as independent."""
SIGNIFICANCE = 1e-3
"""A law with a smaller p-value is rejected."""
MAX_QUANTILES = 500


@dataclass(frozen=True, slots=True)
class FittedDelay:
    keys: dict[str, Any]
    estimates: tuple[Estimate, ...]
    description: str


@dataclass(frozen=True, slots=True)
class _FittedLaw:
    """A fitted law: floor (ms), logarithms of mean and deviation, correlation, their errors."""

    kind: str
    distribution: Any
    parameters: tuple[float, ...]
    likelihood: float


def fit_delay(number: NDArray[np.int64], sent_at_s: Floats, delay_ms: Floats) -> FittedDelay:
    """Fit the law of delays (ms) of messages, given their numbers and sending times (s)."""
    low, high = float(delay_ms.min()), float(delay_ms.max())
    if high - low < TOLERANCE_MS:
        value = round(float(np.mean(delay_ms)), 6)
        exact = Estimate("latency_ms", value, 0.0, value, value)
        return FittedDelay({"latency_ms": value}, (exact,), f"constant, {value:g} ms")
    steps = np.diff(sent_at_s * 1e3 + delay_ms)
    waited = np.concatenate(([False], steps < TOLERANCE_MS))
    in_order = bool((steps > -TOLERANCE_MS).all() and waited.any())
    waited &= in_order
    if len(delay_ms) < MIN_MESSAGES:
        return _as_recorded(delay_ms, in_order=in_order)
    uniform = None if in_order else _uniform(delay_ms)
    if uniform is not None:
        return uniform
    delays = _Delays(number, delay_ms, waited)
    laws = [_fit_kind(kind, delays) for kind in DISTRIBUTIONS]
    best = max((law for law in laws if law), key=lambda law: law.likelihood, default=None)
    if best is None or not _explains(best, delays):
        return _as_recorded(delay_ms, in_order=in_order)
    return _described_fit(best, in_order=in_order)


def _uniform(delay_ms: Floats) -> FittedDelay | None:
    """Return floor and jitter, or None if the delays are not uniform."""
    low, high, count = float(delay_ms.min()), float(delay_ms.max()), len(delay_ms)
    if stats.kstest((delay_ms - low) / (high - low), "uniform").pvalue < SIGNIFICANCE:
        return None
    # Each end lies beyond the extreme by an exponential distance of mean (high - low)/n.
    step = (high - low) / (count - 1)
    floor, jitter = max(0.0, low - step), high - low + 2.0 * step
    estimates = (
        Estimate("latency_ms", floor, step, max(0.0, low - 3.7 * step), low),
        Estimate("jitter_ms", jitter, sqrt(2.0) * step, high - low, high - low + 5.6 * step),
    )
    keys = {"latency_ms": _rounded(floor), "jitter_ms": _rounded(jitter)}
    return FittedDelay(keys, estimates, f"uniform from {low:.4g} to {high:.4g} ms")


def _gamma(floor: float, mean: float, deviation: float) -> Any:
    shape = (mean / deviation) ** 2
    return stats.gamma(shape, loc=floor, scale=mean / shape)


def _lognormal(floor: float, mean: float, deviation: float) -> Any:
    variance = log1p((deviation / mean) ** 2)
    return stats.lognorm(sqrt(variance), loc=floor, scale=exp(log(mean) - 0.5 * variance))


def _normal(floor: float, mean: float, deviation: float) -> Any:
    return stats.truncnorm(-mean / deviation, inf, loc=floor + mean, scale=deviation)


DISTRIBUTIONS: Mapping[str, Callable[[float, float, float], Any]] = {
    "gamma": _gamma,
    "lognormal": _lognormal,
    "normal": _normal,
}
"""Fitted laws by kind, each a function of the floor, and of mean and deviation beyond it."""


def _distribution(kind: str, parameters: Floats) -> Any:
    """Distribution with a floor (ms) and logarithms of mean and deviation beyond it."""
    return DISTRIBUTIONS[kind](float(parameters[0]), exp(parameters[1]), exp(parameters[2]))


def _fit_kind(kind: str, delays: "_Delays") -> _FittedLaw | None:
    exact = delays.delay_ms[~delays.waited]
    low, deviation = float(exact.min()), float(exact.std())

    def minus_likelihood(parameters: Floats) -> float:
        if not 0.0 <= parameters[0] < low or max(abs(parameters[1:])) > 20.0:
            return inf
        law = _distribution(kind, parameters)
        with np.errstate(all="ignore"):
            value = delays.likelihood(law, tanh(parameters[3]) if len(parameters) > 3 else 0.0)
        return -value if np.isfinite(value) else inf

    floor = max(0.0, low - 0.05 * deviation)
    start = [floor, log(max(exact.mean() - floor, 1e-3)), log(deviation)]
    optimum = optimize.minimize(
        minus_likelihood, np.array([*start, 0.1] if delays.may_be_correlated else start),
        method="Nelder-Mead",
        options={"xatol": 1e-4, "fatol": 1e-3, "maxiter": 4000, "maxfev": 4000},
    )  # fmt: skip
    if not np.isfinite(optimum.fun):
        return None
    law = _distribution(kind, optimum.x)
    values, errors = [*map(float, optimum.x)], [*_errors(minus_likelihood, optimum.x)]
    if not delays.may_be_correlated:
        values, errors = [*values, 0.0], [*errors, inf]
    return _FittedLaw(kind, law, (*values, *errors), -optimum.fun)


@dataclass(frozen=True)
class _Delays:
    """Delays (ms) ordered by message number, and which messages waited for an earlier one.

    The normal scores of the delays form a first-order autoregressive chain: two delivered messages
    have the correlation ρ^steps. The successor of a message that waited is left out, because the
    own delay of that message is unknown. Each term is thus conditional on all earlier delays.
    """

    number: NDArray[np.int64]
    delay_ms: Floats
    waited: Flags

    @cached_property
    def may_be_correlated(self) -> bool:
        if self.waited.any():
            return True
        correlation = float(stats.spearmanr(self.delay_ms[:-1], self.delay_ms[1:]).statistic)
        return bool(abs(correlation) > 3.0 / sqrt(len(self.delay_ms)))

    def likelihood(self, law: Any, correlation: float) -> float:
        if not correlation:
            exact, at_most = self.delay_ms[~self.waited], self.delay_ms[self.waited]
            return float(law.logpdf(exact).sum() + law.logcdf(at_most).sum())
        score = _scores(law, self.delay_ms)
        after = np.flatnonzero(~self.waited[:-1]) + 1
        steps = (self.number[after] - self.number[after - 1]).astype(np.float64)
        correlations = np.sign(correlation) ** steps * abs(correlation) ** steps
        deviation = np.sqrt(1.0 - correlations * correlations)
        innovation = (score[after] - correlations * score[after - 1]) / deviation
        waited = self.waited[after]
        known = after[~waited]
        terms = law.logpdf(self.delay_ms[known]) + 0.5 * score[known] ** 2
        terms -= 0.5 * innovation[~waited] ** 2 + np.log(deviation[~waited])
        return float(terms.sum() + stats.norm.logcdf(innovation[waited]).sum())


def _scores(law: Any, delay_ms: Floats) -> Floats:
    """Normal scores of delays, computed from the nearer tail for accuracy."""
    below = law.cdf(delay_ms)
    scores: Floats = np.where(
        below < 0.5, stats.norm.ppf(np.clip(below, 1e-15, 0.5)),
        stats.norm.isf(np.clip(law.sf(delay_ms), 1e-15, 0.5)),
    )  # fmt: skip
    return scores


def _errors(minus_likelihood: Callable[[Floats], float], best: Floats) -> tuple[float, ...]:
    """Standard errors from the curvature of the likelihood; inf where the curvature is zero."""
    steps = np.full(len(best), 1e-3)
    steps[0] *= max(1.0, abs(best[0]))
    size = len(best)
    hessian = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            along_i, along_j = np.eye(size)[i] * steps, np.eye(size)[j] * steps
            corners = [
                minus_likelihood(best + a * along_i + b * along_j) for a in (1, -1) for b in (1, -1)
            ]
            hessian[i, j] = (corners[0] - corners[1] - corners[2] + corners[3]) / (
                4.0 * steps[i] * steps[j]
            )
    if not np.isfinite(hessian).all():
        return (inf,) * size
    variances = np.diag(np.linalg.pinv(hessian))
    return tuple(sqrt(v) if v > 0.0 else inf for v in variances.tolist())


def _explains(law: _FittedLaw, delays: _Delays) -> bool:
    """Test the law on messages far enough apart to be independent.

    Skipped if messages waited, because the distribution then differs between messages.
    """
    if delays.waited.any():
        return True
    correlation = abs(tanh(law.parameters[3]))
    stride = (
        1
        if correlation < NEGLIGIBLE_CORRELATION
        else min(ceil(log(NEGLIGIBLE_CORRELATION) / log(correlation)), 100)
    )
    return (
        float(stats.kstest(delays.delay_ms[::stride], law.distribution.cdf).pvalue) >= SIGNIFICANCE
    )


def _described_fit(law: _FittedLaw, *, in_order: bool) -> FittedDelay:
    floor, log_mean, log_deviation, atanh_correlation, *errors = law.parameters
    mean, deviation, correlation = exp(log_mean), exp(log_deviation), tanh(atanh_correlation)
    table: dict[str, Any] = {
        "kind": law.kind, "mean_ms": _rounded(mean), "deviation_ms": _rounded(deviation),
    }  # fmt: skip
    estimates = [
        Estimate.normal("latency_ms", floor, errors[0]),
        Estimate.normal("delay.mean_ms", mean, mean * errors[1]),
        Estimate.normal("delay.deviation_ms", deviation, deviation * errors[2]),
    ]
    error = (1.0 - correlation * correlation) * errors[3]
    if correlation > 3.0 * error:
        key = "delay.correlation_ratio"
        estimates.append(Estimate.normal(key, correlation, error, -1.0, 1.0))
        table["correlation_ratio"] = round(min(correlation, 0.99), 3)
    if in_order:
        table["order"] = "in_order"
    description = f"{law.kind}, {mean:.4g} ± {deviation:.4g} ms beyond {floor:.4g} ms"
    return FittedDelay(
        {"latency_ms": _rounded(floor), "delay": table}, tuple(estimates), description
    )


def _as_recorded(delay_ms: Floats, *, in_order: bool) -> FittedDelay:
    shares = (np.arange(min(len(delay_ms), MAX_QUANTILES)) + 0.5) / min(
        len(delay_ms), MAX_QUANTILES
    )
    quantiles = np.quantile(delay_ms, shares, method="median_unbiased")
    floor = float(delay_ms.min())
    table: dict[str, Any] = {
        "kind": "empirical",
        "recorded_ms": [_rounded(value) for value in (quantiles - floor).tolist()],
    }
    if in_order:
        table["order"] = "in_order"
    error = float(delay_ms.std()) / sqrt(len(delay_ms))
    mean = Estimate.normal("mean of the delay, ms", float(delay_ms.mean()), error)
    keys = {"latency_ms": _rounded(floor), "delay": table}
    return FittedDelay(keys, (mean,), f"as recorded, {mean.value:.4g} ms on average")


def _rounded(value: float) -> float:
    return float(f"{max(value, 0.0):.6g}")
