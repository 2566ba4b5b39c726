"""Maximum-likelihood fit of a link's delay law to recorded delays.

On links that preserve order, a message that waited for an earlier one is left-censored: its own
delay was at most the recorded one. Correlated delays enter conditionally on the previous delay.
"""

from collections.abc import Callable, Mapping
from math import ceil, exp, inf, log, log1p, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from scenarios.studies.channel.recorded import Estimate, FittedKeys, Flags, Floats, rounded

TOLERANCE_MS = 1e-3
"""Delays that differ by less count as equal."""
MIN_MESSAGES = 100
"""With fewer delays the recorded ones are used instead of a law."""
NEGLIGIBLE_CORRELATION = 0.05
"""Messages with a smaller correlation count as independent."""
SIGNIFICANCE = 1e-3
"""A law with a smaller p-value is rejected."""
MAX_QUANTILES = 500


def fit_delay(number: NDArray[np.int64], sent_at_s: Floats, delay_ms: Floats) -> FittedKeys:
    """Fit the law of delays (ms) of messages, given their numbers and sending times (s)."""
    low, high = float(delay_ms.min()), float(delay_ms.max())
    if high - low < TOLERANCE_MS:
        value = round(float(np.mean(delay_ms)), 6)
        return {"latency_ms": value}, [Estimate("latency_ms", value, 0.0, value, value)], []
    steps = np.diff(sent_at_s * 1e3 + delay_ms)
    waited = np.concatenate(([False], steps < TOLERANCE_MS))
    in_order = bool((steps > -TOLERANCE_MS).all() and waited.any())
    waited &= in_order
    uniform = None if in_order else _uniform(delay_ms)
    if uniform is not None and len(delay_ms) >= MIN_MESSAGES:
        return uniform
    keys, estimates = _law(_Delays(number, delay_ms, waited)) or _as_recorded(delay_ms)
    if in_order:
        keys["delay"]["order"] = "in_order"
    return keys, estimates, []


def _uniform(delay_ms: Floats) -> FittedKeys | None:
    """Return floor and jitter, or None if the delays are not uniform."""
    low, high, count = float(delay_ms.min()), float(delay_ms.max()), len(delay_ms)
    if stats.kstest((delay_ms - low) / (high - low), "uniform").pvalue < SIGNIFICANCE:
        return None
    # Each end lies beyond the extreme by an exponential distance of mean (high - low)/n.
    step = (high - low) / (count - 1)
    floor, jitter = max(0.0, low - step), high - low + 2.0 * step
    estimates = [
        Estimate("latency_ms", floor, step, max(0.0, low - 3.7 * step), low),
        Estimate("jitter_ms", jitter, sqrt(2.0) * step, high - low, high - low + 5.6 * step),
    ]
    return {"latency_ms": rounded(floor), "jitter_ms": rounded(jitter)}, estimates, []


# ---- Laws with a floor (ms), and mean and deviation (ms) beyond it


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


class _Delays(NamedTuple):
    """Delays (ms) ordered by message number, and which messages waited for an earlier one."""

    number: NDArray[np.int64]
    delay_ms: Floats
    waited: Flags

    @property
    def may_be_correlated(self) -> bool:
        if self.waited.any():
            return True
        correlation = float(stats.spearmanr(self.delay_ms[:-1], self.delay_ms[1:]).statistic)
        return bool(abs(correlation) > 3.0 / sqrt(len(self.delay_ms)))

    def likelihood(self, law: Any, correlation: float) -> float:
        """Logarithm of the likelihood; that of correlated delays is conditional on earlier ones.

        Normal scores form a first-order autoregressive chain: two delivered messages have the
        correlation ρ^steps. The successor of a message that waited is left out, because the own
        delay of that message is unknown.
        """
        if not correlation:
            exact, at_most = self.delay_ms[~self.waited], self.delay_ms[self.waited]
            return float(law.logpdf(exact).sum() + law.logcdf(at_most).sum())
        score = stats.norm.ppf(np.clip(law.cdf(self.delay_ms), 1e-15, 1.0 - 1e-15))
        after = np.flatnonzero(~self.waited[:-1]) + 1
        correlations = correlation ** (self.number[after] - self.number[after - 1])
        deviation = np.sqrt(1.0 - correlations * correlations)
        innovation = (score[after] - correlations * score[after - 1]) / deviation
        waited = self.waited[after]
        known = after[~waited]
        terms = law.logpdf(self.delay_ms[known]) + 0.5 * score[known] ** 2
        terms -= 0.5 * innovation[~waited] ** 2 + np.log(deviation[~waited])
        return float(terms.sum() + stats.norm.logcdf(innovation[waited]).sum())


class _Fit(NamedTuple):
    """Floor, logarithms of mean and deviation, correlation, their errors, and the likelihood."""

    kind: str
    best: Floats
    errors: Floats
    likelihood: float

    @property
    def distribution(self) -> Any:
        return _distribution(self.kind, self.best)


def _distribution(kind: str, parameters: Floats) -> Any:
    return DISTRIBUTIONS[kind](float(parameters[0]), exp(parameters[1]), exp(parameters[2]))


def _fit_kind(kind: str, delays: _Delays) -> _Fit | None:
    exact = delays.delay_ms[~delays.waited]
    low, deviation = float(exact.min()), float(exact.std())

    def minus_likelihood(parameters: Floats) -> float:
        beyond = not 0.0 <= parameters[0] < low or max(abs(parameters[1:3])) > 20.0
        if beyond or not -1.0 < parameters[3:].sum() < 1.0:
            return inf
        with np.errstate(all="ignore"):
            law = _distribution(kind, parameters)
            value = delays.likelihood(law, float(parameters[3:].sum()))
        return -value if np.isfinite(value) else inf

    floor = max(0.0, low - 0.05 * deviation)
    start = [floor, log(max(exact.mean() - floor, 1e-3)), log(deviation)]
    optimum = optimize.minimize(
        minus_likelihood,
        np.array([*start, 0.1] if delays.may_be_correlated else start),
        method="Nelder-Mead",
        options={"xatol": 1e-4, "fatol": 1e-3, "maxiter": 4000, "maxfev": 4000},
    )
    if not np.isfinite(optimum.fun):
        return None
    errors = _errors(minus_likelihood, optimum.x)
    missing = 4 - len(errors)  # delays that are independent have no correlation
    best, errors = np.append(optimum.x, [0.0] * missing), np.append(errors, [inf] * missing)
    return _Fit(kind, best, errors, -float(optimum.fun))


def _errors(minus_likelihood: Callable[[Floats], float], best: Floats) -> Floats:
    """Standard errors from the curvature of the likelihood; inf where the curvature is zero."""
    sizes = np.full(len(best), 1e-3)
    sizes[0] *= max(1.0, abs(best[0]))
    steps, signs = np.diag(sizes), ((1, 1), (1, -1), (-1, 1), (-1, -1))
    hessian = np.array(
        [
            [sum(a * b * minus_likelihood(best + a * i + b * j) for a, b in signs) for j in steps]
            for i in steps
        ]
    ) / (4.0 * np.outer(sizes, sizes))
    if not np.isfinite(hessian).all():
        return np.full(len(best), inf)
    variances = np.diag(np.linalg.pinv(hessian))
    return np.sqrt(np.where(variances > 0.0, variances, inf))


def _law(delays: _Delays) -> tuple[dict[str, Any], list[Estimate]] | None:
    """Fit the most likely law, or return None if it does not explain the delays."""
    if len(delays.delay_ms) < MIN_MESSAGES:
        return None
    fits = [_fit_kind(kind, delays) for kind in DISTRIBUTIONS]
    fit = max((fit for fit in fits if fit), key=lambda fit: fit.likelihood, default=None)
    if fit is None:
        return None
    floor, mean, deviation, correlation = fit.best[0], *np.exp(fit.best[1:3]), fit.best[3]
    # If messages waited, the distribution differs between messages, and no test applies.
    if not delays.waited.any() and not _explains(fit.distribution, delays.delay_ms, correlation):
        return None
    table = {"kind": fit.kind, "mean_ms": rounded(mean), "deviation_ms": rounded(deviation)}
    values = {"latency_ms": floor, "delay.mean_ms": mean, "delay.deviation_ms": deviation}
    errors = fit.errors[:3] * (1.0, mean, deviation)
    estimates = [
        Estimate.normal(key, float(value), float(error))
        for (key, value), error in zip(values.items(), errors, strict=True)
    ]
    if correlation > 3.0 * fit.errors[3]:
        key = "delay.correlation_ratio"
        estimates.append(Estimate.normal(key, float(correlation), float(fit.errors[3]), -1.0, 1.0))
        table["correlation_ratio"] = round(min(float(correlation), 0.99), 3)
    return {"latency_ms": rounded(floor), "delay": table}, estimates


def _explains(law: Any, delay_ms: Floats, correlation: float) -> bool:
    """Test the law on messages far enough apart to be independent."""
    stride = 1
    if abs(correlation) > NEGLIGIBLE_CORRELATION:
        stride = min(ceil(log(NEGLIGIBLE_CORRELATION) / log(abs(correlation))), 100)
    return float(stats.kstest(delay_ms[::stride], law.cdf).pvalue) >= SIGNIFICANCE


def _as_recorded(delay_ms: Floats) -> tuple[dict[str, Any], list[Estimate]]:
    """Use quantiles of the recorded delays as the law."""
    count = min(len(delay_ms), MAX_QUANTILES)
    shares = (np.arange(count) + 0.5) / count
    quantiles = np.quantile(delay_ms, shares, method="median_unbiased")
    floor = float(delay_ms.min())
    recorded = [rounded(value) for value in (quantiles - floor).tolist()]
    error = float(delay_ms.std()) / sqrt(len(delay_ms))
    mean = Estimate.normal("mean of the delay, ms", float(delay_ms.mean()), error)
    delay = {"kind": "empirical", "recorded_ms": recorded}
    return {"latency_ms": rounded(floor), "delay": delay}, [mean]
