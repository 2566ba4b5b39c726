"""Where the share of broken runs crosses the one that is asked for: by bisection of the counts.

Not of each seed's own boundary: a seed that breaks the limit at a value may hold it at a larger
one, as where a follower that hears too little stops in its lane. The share is what is asked for,
and what is counted on both sides of the bracket.
"""

from dataclasses import dataclass
from math import inf

from scenarios.results.channel.estimates import CONFIDENCE
from scenarios.studies.many.boundary.curve import ShareCurve
from scenarios.studies.many.intervals import wilson

FIRST_LOOK = 8
"""Seeds with which a value is tried first: if all of them agree, the interval of Wilson is below
or above one half."""
COARSE = 4
"""Parts of the range at whose ends is looked first; then at those of twice as many."""


class NoBoundaryError(Exception):
    """The share is on the same side wherever it was looked for."""


@dataclass(frozen=True, slots=True)
class Bracket:
    """The numbers of neighbouring values between which the share crosses the wanted one.

    `sure` are values (not numbers) between which it does so with confidence, -inf or inf where no
    value that was tried is surely on that side; with a share of 0 there is no such thing.
    """

    low: int
    high: int
    sure: tuple[float, float]


def bracket(curve: ShareCurve) -> Bracket:
    """Bracket the first crossing from the low end on, between two neighbours.

    On both sides of it all seeds are run in the end. Raises NoBoundaryError.
    """
    last = len(curve.values) - 1
    for parts in (COARSE, 2 * COARSE):
        curve.look(sorted({last * part // parts for part in range(parts + 1)}), FIRST_LOOK)
        while (pair := next(curve.changes(), None)) is not None:
            low, high = pair
            near = high - low == 1
            unsure = [
                number
                for number in pair
                if not (curve.is_complete(number) if near else curve.is_settled(number))
            ]
            if unsure:
                curve.look(unsure)
            elif near:
                return Bracket(low, high, _sure(curve, low, high))
            else:
                curve.look([(low + high) // 2], FIRST_LOOK)
    curve.look([0, last])
    if next(curve.changes(), None) is not None:
        return bracket(curve)
    raise NoBoundaryError


def _sure(curve: ShareCurve, low: int, high: int) -> tuple[float, float]:
    """The nearest values tried, down from `low` and up from `high`, whose interval excludes it.

    Each interval has so much of the confidence that all of them together have 95 % (Bonferroni).
    """
    if curve.share == 0.0:
        return -inf, inf
    rising = curve.is_beyond(high)

    confidence = 1.0 - (1.0 - CONFIDENCE) / len(curve.visited)

    def surely(number: int, *, beyond: bool) -> bool:
        point = curve.point(number)
        least, most = wilson(point.broken, point.runs, confidence)
        return least > curve.share if beyond else most < curve.share

    below = [one for one in curve.visited if one <= low and surely(one, beyond=not rising)]
    above = [one for one in curve.visited if one >= high and surely(one, beyond=rising)]
    return (
        curve.values[below[-1]] if below else -inf,
        curve.values[above[0]] if above else inf,
    )
