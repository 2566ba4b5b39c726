"""The law of a link's delay from recorded delays: maximum likelihood, of the laws that links know.

Where messages keep their order, a message that had to wait for an earlier one says only that its
own delay was no longer than that: it enters by the distribution function (left-censored).
Delays that are correlated from message to message enter by what the one before them tells.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil, exp, inf, log, log1p, sqrt, tanh
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from scenarios.studies.channel.fitting.estimate import Estimate

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOLERANCE_MS = 1e-3
"""Delays that differ by less are the same: they are whole nanoseconds, and logged as such."""
MIN_MESSAGES = 100
"""Fewer delays do not identify a law; they are kept as they are."""
NEGLIGIBLE_CORRELATION = 0.05
"""Messages with a smaller correlation are taken to be on their own."""
SIGNIFICANCE = 1e-3
"""A law that explains the delays with less chance than this is none of them."""
MAX_QUANTILES = 500


@dataclass(frozen=True, slots=True)
class FittedDelay:
    """Keys of a link that reproduce its delays, and their estimates."""

    keys: dict[str, Any]
    estimates: tuple[Estimate, ...]
    description: str


@dataclass(frozen=True, slots=True)
class _FittedLaw:
    """A law with its floor and the parameters of the table, all in ms."""

    kind: str
    frozen: Any
    parameters: tuple[float, ...]
    likelihood: float


def fit_delay(number: NDArray[np.int64], sent_at_s: Floats, delay_ms: Floats) -> FittedDelay:
    """Fit the law of delays (ms) of messages, given their numbers and sending times (s)."""
    low, high = float(delay_ms.min()), float(delay_ms.max())
    if high - low < TOLERANCE_MS:
        value = round(float(np.mean(delay_ms)), 6)
        exact = Estimate("latency_ms", value, 0.0, value, value)
        return FittedDelay({"latency_ms": value}, (exact,), f"constant, {value:g} ms")
    there = sent_at_s * 1e3 + delay_ms
    waited = np.concatenate(([False], np.diff(there) < TOLERANCE_MS))
    in_order = bool((np.diff(there) > -TOLERANCE_MS).all() and waited.any())
    waited &= in_order
    if len(delay_ms) < MIN_MESSAGES:
        return _as_recorded(delay_ms, in_order=in_order)
    uniform = None if in_order else _uniform(delay_ms)
    if uniform is not None:
        return uniform
    delays = _Delays(number, delay_ms, waited)
    found = [_fit_kind(kind, delays) for kind in DISTRIBUTIONS]
    best = max((law for law in found if law), key=lambda law: law.likelihood, default=None)
    if best is None or not _explains(best, delays):
        return _as_recorded(delay_ms, in_order=in_order)
    return _described_fit(best, in_order=in_order)


def _uniform(delay_ms: Floats) -> FittedDelay | None:
    """Return a floor and jitter, if delays are spread evenly."""
    low, high, count = float(delay_ms.min()), float(delay_ms.max()), len(delay_ms)
    if stats.kstest((delay_ms - low) / (high - low), "uniform").pvalue < SIGNIFICANCE:
        return None
    # Each end lies a step of (high - low)/n beyond the extreme, exponentially distributed.
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
"""Laws of delay that are fitted, by their kind: of a floor, a mean and a deviation beyond it."""


def _distribution(kind: str, parameters: Floats) -> Any:
    """The law of a floor (ms), and logarithms of mean and deviation beyond it."""
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

    begin = max(0.0, low - 0.05 * deviation)
    start = [begin, log(max(exact.mean() - begin, 1e-3)), log(deviation)]
    found = optimize.minimize(
        minus_likelihood, np.array([*start, 0.1] if delays.may_be_correlated else start),
        method="Nelder-Mead",
        options={"xatol": 1e-4, "fatol": 1e-3, "maxiter": 4000, "maxfev": 4000},
    )  # fmt: skip
    if not np.isfinite(found.fun):
        return None
    law = _distribution(kind, found.x)
    values, errors = [*map(float, found.x)], [*_errors(minus_likelihood, found.x)]
    if not delays.may_be_correlated:
        values, errors = [*values, 0.0], [*errors, inf]
    return _FittedLaw(kind, law, (*values, *errors), -found.fun)


@dataclass(frozen=True)
class _Delays:
    """Delays (ms) in the order of their numbers, and which of them waited for one before.

    The normal scores behind the delays are a chain: given the last delivered message, which did not
    wait itself, the next has the correlation ρ^steps with it. The successor of a message that
    waited, whose own delay is unknown, is left out; so each term is the chance of a delay given all
    before it, and the cause of waiting does not bias them.
    """

    number: NDArray[np.int64]
    delay_ms: Floats
    waited: Flags

    @cached_property
    def may_be_correlated(self) -> bool:
        """Whether delays of successive messages may be correlated."""
        if self.waited.any():
            return True
        found = float(stats.spearmanr(self.delay_ms[:-1], self.delay_ms[1:]).statistic)
        return bool(abs(found) > 3.0 / sqrt(len(self.delay_ms)))

    def likelihood(self, law: Any, correlation: float) -> float:
        """Log-likelihood of these delays."""
        if not correlation:
            exact, at_most = self.delay_ms[~self.waited], self.delay_ms[self.waited]
            return float(law.logpdf(exact).sum() + law.logcdf(at_most).sum())
        score = _scores(law, self.delay_ms)
        after = np.flatnonzero(~self.waited[:-1]) + 1
        steps = (self.number[after] - self.number[after - 1]).astype(np.float64)
        tied = np.sign(correlation) ** steps * abs(correlation) ** steps
        rest = np.sqrt(1.0 - tied * tied)
        own = (score[after] - tied * score[after - 1]) / rest
        waited = self.waited[after]
        known = after[~waited]
        terms = law.logpdf(self.delay_ms[known]) + 0.5 * score[known] ** 2
        terms -= 0.5 * own[~waited] ** 2 + np.log(rest[~waited])
        return float(terms.sum() + stats.norm.logcdf(own[waited]).sum())


def _scores(law: Any, delay_ms: Floats) -> Floats:
    """Normal scores of delays, from the nearer tail."""
    below = law.cdf(delay_ms)
    found: Floats = np.where(
        below < 0.5, stats.norm.ppf(np.clip(below, 1e-15, 0.5)),
        stats.norm.isf(np.clip(law.sf(delay_ms), 1e-15, 0.5)),
    )  # fmt: skip
    return found


def _errors(minus_likelihood: Callable[[Floats], float], best: Floats) -> tuple[float, ...]:
    """Standard errors from the curvature of the likelihood; inf where it has none."""
    steps = np.full(len(best), 1e-3)
    steps[0] *= max(1.0, abs(best[0]))
    size = len(best)
    hessian = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            one, other = np.eye(size)[i] * steps, np.eye(size)[j] * steps
            corners = [
                minus_likelihood(best + a * one + b * other) for a in (1, -1) for b in (1, -1)
            ]
            hessian[i, j] = (corners[0] - corners[1] - corners[2] + corners[3]) / (
                4.0 * steps[i] * steps[j]
            )
    if not np.isfinite(hessian).all():
        return (inf,) * size
    variances = np.diag(np.linalg.pinv(hessian))
    return tuple(sqrt(v) if v > 0.0 else inf for v in variances.tolist())


def _explains(law: _FittedLaw, delays: _Delays) -> bool:
    """Test whether delays fit the law, from messages far enough apart to be independent.

    With waiting messages the test is skipped: their share differs from message to message.
    """
    if delays.waited.any():
        return True
    correlation = abs(tanh(law.parameters[3]))
    stride = (
        1
        if correlation < NEGLIGIBLE_CORRELATION
        else min(ceil(log(NEGLIGIBLE_CORRELATION) / log(correlation)), 100)
    )
    return float(stats.kstest(delays.delay_ms[::stride], law.frozen.cdf).pvalue) >= SIGNIFICANCE


def _described_fit(law: _FittedLaw, *, in_order: bool) -> FittedDelay:
    floor, mean, deviation, tied, *errors = law.parameters
    mean, deviation, correlation = exp(mean), exp(deviation), tanh(tied)
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
    """Return the quantiles of the delays, if no law fits them."""
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
