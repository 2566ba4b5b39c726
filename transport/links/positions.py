"""Recent positions of a receiver, in little memory."""

from array import array
from bisect import bisect_right
from typing import Final

from transport.links.laws.effect import Position

MAX_POSITIONS: Final = 4096
"""Number of ticks that are kept, for messages that come late: a minute."""
DELETED_AT_ONCE: Final = MAX_POSITIONS // 8
"""Number of ticks that are deleted at once."""


class PositionHistory:
    """True positions of a receiver at its last ticks, at least `PLACES` of them."""

    def __init__(self) -> None:
        self._instants = array("q")
        self._places = array("d")

    def add(self, now: int, here: Position) -> None:
        """Add the position `here` at the tick at `now` (ns); ticks come in order."""
        self._instants.append(now)
        self._places.extend(here)
        if len(self._instants) >= MAX_POSITIONS + DELETED_AT_ONCE:
            del self._instants[:DELETED_AT_ONCE]
            del self._places[: 3 * DELETED_AT_ONCE]

    def at(self, instant: int) -> Position:
        """Position at the last tick until `instant` (ns), or at the first that is kept."""
        place = 3 * max(bisect_right(self._instants, instant) - 1, 0)
        return Position(*self._places[place : place + 3])
