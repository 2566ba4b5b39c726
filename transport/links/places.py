"""Where a receiver was at its last ticks, in little memory."""

from array import array
from bisect import bisect_right
from typing import Final

from transport.links.laws.effect import Position

PLACES: Final = 4096
"""Ticks of which the receiver remembers where it was, for messages that came late: a minute."""
FORGOTTEN: Final = PLACES // 8
"""Number of them that are forgotten at once."""


class PlacesPassed:
    """Where a receiver truly was at its last ticks: at least `PLACES` of them, if there were."""

    def __init__(self) -> None:
        self._instants = array("q")
        self._places = array("d")

    def add(self, now: int, here: Position) -> None:
        """Be `here` at the tick at `now` (ns), which lies after those before."""
        self._instants.append(now)
        self._places.extend(here)
        if len(self._instants) >= PLACES + FORGOTTEN:
            del self._instants[:FORGOTTEN]
            del self._places[: 3 * FORGOTTEN]

    def at(self, instant: int) -> Position:
        """Where it was at its last tick until `instant` (ns), or at the first it remembers."""
        place = 3 * max(bisect_right(self._instants, instant) - 1, 0)
        return Position(*self._places[place : place + 3])
