"""A small convoy that loses its path after nine consecutive losses.

On a straight road, an extrapolating follower continues until the end of its known path. The
probability of a lost path is therefore that of nine consecutive losses.
"""

from collections.abc import Collection

from scenarios.studies.many.variant import Variant
from tests.made.many.known_runs import small_convoy

MESSAGES, ROW, LAST = 20, 9, 18
"""Messages per run, consecutive losses that break the limit, and the last message that counts."""
SETTINGS = (
    "duration_s=4.0", "path.segments=[{length_m=200.0}]", "convoy.gap_m=27",
    "control.degradation.reaction='extrapolate'", "events.path_lost_s=0.2",
)  # fmt: skip


def lost_path_convoy(*settings: str) -> Variant:
    return small_convoy(*SETTINGS, *settings)


def loses_path(lost: Collection[int]) -> bool:
    """Whether a run that loses these messages loses its path.

    A follower that has received nothing yet has no path to lose.
    """
    received, row = False, 0
    for number in range(LAST + 1):
        row = row + 1 if number in lost else 0
        received |= not row
        if received and row >= ROW:
            return True
    return False


def probability(ratio: float) -> float:
    """Exact probability that a run loses its path."""
    none_received, rows, broken = 1.0, [0.0] * ROW, 0.0
    for _ in range(LAST + 1):
        delivered = (1.0 - ratio) * (none_received + sum(rows))
        broken += ratio * rows[-1]
        rows = [delivered, *(ratio * share for share in rows[:-1])]
        none_received *= ratio
    return broken
