"""Recent positions of a receiver, stored in compact arrays."""

from array import array
from bisect import bisect_right
from typing import Final

from transport.links.laws.effect import Position

MAX_POSITIONS: Final = 4096  # Number of stored ticks: at least a minute, for late messages
DELETED_AT_ONCE: Final = MAX_POSITIONS // 8


class PositionHistory:
    """True positions of a receiver at its last ticks, at least `MAX_POSITIONS` of them."""

    def __init__(self) -> None:
        self._instants = array("q")
        self._coordinates = array("d")

    def add(self, now: int, position: Position) -> None:
        """Add the position at the tick at `now` (ns); ticks are added in order."""
        self._instants.append(now)
        self._coordinates.extend(position)
        if len(self._instants) >= MAX_POSITIONS + DELETED_AT_ONCE:
            del self._instants[:DELETED_AT_ONCE]
            del self._coordinates[: 3 * DELETED_AT_ONCE]

    def at(self, instant: int) -> Position:
        """Position at the last tick until `instant` (ns), or at the oldest stored tick."""
        index = 3 * max(bisect_right(self._instants, instant) - 1, 0)
        return Position(*self._coordinates[index : index + 3])
