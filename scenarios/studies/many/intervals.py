"""Intervals of confidence of shares and of quantiles, from counts alone."""

from dataclasses import dataclass
from math import comb

from scenarios.results.channel.estimates import CONFIDENCE, share


def wilson(successes: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Low and high end of the score interval of a share: `successes` of `count`.

    Wilson, Journal of the American Statistical Association 22, 1927. It holds the share with about
    the `confidence`, also near 0 and 1; without runs all is possible. Raises ValueError for counts
    that there are not.
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
    """Low and high end of the exact interval of a share: `successes` of `count`.

    Clopper and Pearson, Biometrika 26, 1934: it holds the share with at least the `confidence`.
    Raises ValueError for counts that there are not.
    """
    from scipy.stats import beta  # noqa: PLC0415 - an extra

    _check(successes, count)
    tail = 0.5 * (1.0 - confidence)
    low = beta.ppf(tail, successes, count - successes + 1) if successes else 0.0
    high = beta.isf(tail, successes + 1, count - successes) if successes < count else 1.0
    return float(low), float(high)


@dataclass(frozen=True, slots=True)
class RankInterval:
    """Order statistics, counted from 1, between which a quantile lies with a `coverage`.

    Rank 0 is no value: there is no lower end, and none above with one more than the count.
    """

    low: int
    high: int
    coverage: float


def quantile_ranks(count: int, share: float, confidence: float = CONFIDENCE) -> RankInterval:
    """Which of `count` sorted values hold the quantile of a `share` between them.

    Whatever the law of the values (David and Nagaraja, Order Statistics, 2003, Section 7.1): as
    many of them are below the quantile as a binomial number of chance `share`. Each tail has at
    most half of what `confidence` leaves; of a law with ties the coverage is larger. Raises
    ValueError for a share outside of (0, 1).
    """
    if not (count > 0 and 0.0 < share < 1.0):
        raise ValueError(f"the quantile of {share} among {count} values")
    chances = [
        comb(count, below) * share**below * (1.0 - share) ** (count - below)
        for below in range(count + 1)
    ]
    tail = 0.5 * (1.0 - confidence)
    low = max((rank for rank in range(1, count + 1) if sum(chances[:rank]) <= tail), default=0)
    high = min(
        (rank for rank in range(1, count + 1) if sum(chances[rank:]) <= tail), default=count + 1
    )
    return RankInterval(low, high, sum(chances[low:high]))


def _check(successes: int, count: int) -> None:
    if not 0 <= successes <= count or not count:
        raise ValueError(f"{successes} of {count}")
