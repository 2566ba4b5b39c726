"""What a receiver remembers: numbers that it heard, and places where it was; in little memory."""

from array import array
from bisect import bisect_right

from transport.codec import RefusedMessageError
from transport.links.laws.effect import Whereabouts

WINDOW = 8192
"""Sequence numbers that lie further behind a sender's newest are refused, so memory is bounded."""
PLACES = 4096
"""Ticks of which the receiver remembers where it was, for messages that came late: a minute."""
FORGOTTEN = PLACES // 8
"""So many of them are forgotten at once."""
_ALL = (1 << WINDOW) - 1


class NumbersHeard:
    """Which of a sender's newest numbers came: the newest, and a bit for each of `WINDOW`."""

    def __init__(self) -> None:
        self._newest = -1
        self._came = 0

    def add(self, seq: int) -> None:
        """Note that `seq` came; raises RefusedMessageError if it did before or is far behind."""
        ahead = seq - self._newest
        if ahead > 0:
            self._came = (self._came << ahead | 1) & _ALL if ahead < WINDOW else 1
            self._newest = seq
            return
        if ahead <= -WINDOW:
            raise RefusedMessageError("past", f"number {seq} is far behind {self._newest}")
        bit = 1 << -ahead
        if self._came & bit:
            raise RefusedMessageError("duplicate", f"number {seq} came before")
        self._came |= bit


class PlacesPassed:
    """Where a receiver truly was at its last ticks: at least `PLACES` of them, if there were."""

    def __init__(self) -> None:
        self._instants = array("q")
        self._places = array("d")

    def add(self, now: int, here: Whereabouts) -> None:
        """Be `here` at the tick at `now` (ns), which lies after those before."""
        self._instants.append(now)
        self._places.extend(here)
        if len(self._instants) >= PLACES + FORGOTTEN:
            del self._instants[:FORGOTTEN]
            del self._places[: 3 * FORGOTTEN]

    def at(self, instant: int) -> Whereabouts:
        """Where it was at its last tick until `instant` (ns), or at the first it remembers."""
        place = 3 * max(bisect_right(self._instants, instant) - 1, 0)
        return Whereabouts(*self._places[place : place + 3])
