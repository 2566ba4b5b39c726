"""A small convoy that loses its path by nine losses in a row, whenever they come.

On a straight road, where a follower that extrapolates drives on for as long as it knows road ahead.
So the probability that it loses its path is that of nine losses in a row, for any ratio of them.
"""

from collections.abc import Collection

from scenarios.studies.many.variant import Variant
from tests.made.many.known_runs import small_convoy

MESSAGES, ROW, LAST = 20, 9, 18
"""Messages of a run, how many lost ones in a row break the limit, and the last that may be it."""
SETTINGS = (
    "duration_s=4.0", "path.segments=[{length_m=200.0}]", "convoy.gap_m=27",
    "control.degradation.reaction='extrapolate'", "events.path_lost_s=0.2",
)  # fmt: skip


def lost_path_convoy(*settings: str) -> Variant:
    """Two cars at 20 m/s, 32 m apart, for four seconds."""
    return small_convoy(*SETTINGS, *settings)


def loses_path(lost: Collection[int]) -> bool:
    """Whether a run that loses the messages of these numbers loses its path.

    One that has never heard anything has no path to lose.
    """
    heard, row = False, 0
    for number in range(LAST + 1):
        row = row + 1 if number in lost else 0
        heard |= not row
        if heard and row >= ROW:
            return True
    return False


def probability(ratio: float) -> float:
    """That a run loses its path, by the law of the length of the row, message by message."""
    unheard, rows, broken = 1.0, [0.0] * ROW, 0.0
    for _ in range(LAST + 1):
        heard = (1.0 - ratio) * (unheard + sum(rows))
        broken += ratio * rows[-1]
        rows = [heard, *(ratio * share for share in rows[:-1])]
        unheard *= ratio
    return broken
