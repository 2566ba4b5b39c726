"""Confidence intervals of shares and means."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import fmean, stdev

from scenarios.results.channel.estimates import CONFIDENCE, share


def wilson(successes: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Wilson score interval of the share `successes` of `count`.

    Its coverage is approximate, also near 0 and 1. (0, 1) if both counts are 0. Raises ValueError
    for impossible counts. Wilson, Journal of the American Statistical Association 22, 1927.
    """
    if count or successes:
        _check(successes, count)
    interval = share(successes, count, confidence)
    # Exact ends in spite of rounding.
    low = 0.0 if successes == 0 else interval.low
    return low, 1.0 if successes == count else interval.high


def clopper_pearson(
    successes: int, count: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Clopper-Pearson interval of the share `successes` of `count`.

    Its coverage is at least `confidence`. Raises ValueError for impossible counts. Clopper and
    Pearson, Biometrika 26, 1934.
    """
    from scipy.stats import beta  # noqa: PLC0415 - optional

    _check(successes, count)
    tail = 0.5 * (1.0 - confidence)
    low = beta.ppf(tail, successes, count - successes + 1) if successes else 0.0
    high = beta.isf(tail, successes + 1, count - successes) if successes < count else 1.0
    return float(low), float(high)


def _check(successes: int, count: int) -> None:
    if not 0 <= successes <= count or not count:
        raise ValueError(f"{successes} of {count}")


@dataclass(frozen=True, slots=True)
class Mean:
    """Mean of independent probabilities with standard error and interval."""

    value: float
    standard_error: float
    low: float
    high: float


def mean_of(estimates: Sequence[float], confidence: float = CONFIDENCE) -> Mean:
    """Mean of independent unbiased estimates with Student's t interval.

    The distribution of the estimates is right-skewed: with few estimates, the interval is slightly
    too low. Raises ValueError for fewer than two estimates.
    """
    from scipy.stats import t  # noqa: PLC0415 - optional

    if len(estimates) < 2:
        raise ValueError(f"no interval of {len(estimates)} estimates")
    value = fmean(estimates)
    error = stdev(estimates) / sqrt(len(estimates))
    half = float(t.ppf(0.5 + 0.5 * confidence, len(estimates) - 1)) * error
    return Mean(value, error, max(0.0, value - half), min(1.0, value + half))
