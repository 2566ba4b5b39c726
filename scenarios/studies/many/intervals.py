"""Intervals of what is estimated from a number of runs."""

from scenarios.results.channel.estimates import CONFIDENCE, share


def wilson(successes: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Wilson's interval of a share, as (low, high), from 0 to 1; without runs all is possible.

    E. B. Wilson, Probable inference, the law of succession, and statistical inference, JASA 22,
    1927.
    """
    found = share(successes, count, confidence)
    return found.low, found.high
