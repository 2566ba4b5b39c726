"""The known path ahead: what received positions of all sources cover together.

A curve over a hole in a trace is a guess: a source that turned within the hole was beside it. A
follower is blind within a hole, unless positions of the other source cover it.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from vehicles.preview.received.holes import Stretch
from vehicles.preview.received.trace import Trace

LEAST_BEND: Final = 1.0 / 500.0  # Bends (1/m) to expect anywhere: the paper's lane change
CERTAIN: Final = 0.5  # Largest deviation (m) of the path from a bridge that a car may cross
SAME_PATH: Final = 1.75  # Stretches this close (m, half a lane) join


class PathHole(NamedTuple):
    """A stretch that no source covers: `length` (m) along the path, least `turn` (rad) within."""

    length: float
    turn: float

    def is_certain(self, bend: float) -> bool:
        """Whether the path is close to any gentle curve over the hole, at curvatures up to `bend`.

        Two curves with the same ends and headings, one bending left first and one right, both with
        curvature κ, are at most κ s²/16 from the curve between them.
        """
        bend = max(bend, LEAST_BEND, self.turn / self.length)
        return bend * self.length**2 / 16.0 <= CERTAIN


class KnownPath(NamedTuple):
    """The known path ends `end` (m) ahead of the car, or behind it if negative.

    It ends at a `hole` if received positions continue beyond it.
    """

    end: float
    hole: PathHole | None


def known_path(traces: Sequence[Trace], east: float, north: float) -> KnownPath:
    """The known path ahead of a car at (east, north), from traces with at least one sample.

    A car within a hole has its known path behind it, where the hole begins.
    """
    known = [(trace, part) for trace in traces for part in trace.stretches(east, north)]
    here = [(trace, part) for trace, part in known if part.start <= 0.0 <= part.end]
    if not here:
        behind = [pair for pair in known if pair[1].end < 0.0]
        here = [max(behind, key=lambda pair: pair[1].end)] if behind else []
    if not here:  # the car is before the first sample
        here = [min(known, key=lambda pair: pair[1].start)]
    trace, reached = max(here, key=lambda pair: pair[1].end)
    while True:
        later = [pair for pair in known if pair[1].end > reached.end]
        joined = [pair for pair in later if _continues(trace, reached, pair[1])]
        if not joined:
            break
        trace, reached = max(joined, key=lambda pair: pair[1].end)
    if not later:
        return KnownPath(reached.end, None)
    _, beyond = min(later, key=lambda pair: pair[1].start)
    return KnownPath(reached.end, PathHole(beyond.hole, beyond.turn))


def _continues(trace: Trace, reached: Stretch, later: Stretch) -> bool:
    """Whether a stretch of another source begins on a stretch of this `trace`."""
    if later.start > reached.end:
        return False
    _, east, north, _ = later.first
    start = max(reached.start, later.start - SAME_PATH)
    return later.hole == 0.0 or trace.distance_from(east, north, start, reached.end) <= SAME_PATH
