"""Intervals of confidence: of shares from counts alone, and of means."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import fmean, stdev

from scenarios.results.channel.estimates import CONFIDENCE, share


def wilson(successes: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Score interval of a share: `successes` of `count`.

    Wilson, Journal of the American Statistical Association 22, 1927. It covers the share with about
    the `confidence`, also near 0 and 1; (0, 1) without runs. Raises ValueError for impossible
    counts.
    """
    if count or successes:
        _check(successes, count)
    found = share(successes, count, confidence)
    # Rounding must not take the ends off 0 and 1.
    low = 0.0 if successes == 0 else found.low
    return low, 1.0 if successes == count else found.high


def clopper_pearson(
    successes: int, count: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Exact interval of a share: `successes` of `count`.

    Clopper and Pearson, Biometrika 26, 1934: it covers the share with at least the `confidence`.
    Raises ValueError for impossible counts.
    """
    from scipy.stats import beta  # noqa: PLC0415 - an extra

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
    """Mean of independent estimates with its standard error and interval, within 0 to 1."""

    value: float
    standard_error: float
    low: float
    high: float


def mean_of(estimates: Sequence[float], confidence: float = CONFIDENCE) -> Mean:
    """Mean of independent unbiased estimates, with Student's interval (1908).

    The estimates are skewed to the right, so that with few of them, or few paths each, the
    interval lies a little low. Raises ValueError for fewer than two.
    """
    from scipy.stats import t  # noqa: PLC0415 - an extra

    if len(estimates) < 2:
        raise ValueError(f"no interval of {len(estimates)} estimates")
    value = fmean(estimates)
    error = stdev(estimates) / sqrt(len(estimates))
    half = float(t.ppf(0.5 + 0.5 * confidence, len(estimates) - 1)) * error
    return Mean(value, error, max(0.0, value - half), min(1.0, value + half))
