"""Reservations of radio resources, each for several successive messages (LTE-V2X mode 4)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from heapq import heapreplace

from transport.links.laws.effect import Draw
from transport.links.laws.link_law import Problem

CACHE_SIZE = 64  # Number of links whose last reservation is cached
LOOK_BACK = 8  # First distance, in longest reservations; doubled until enough


@dataclass(frozen=True, slots=True)
class Reservations:
    """A sender's reservations: each lasts `least` to `most` messages, all numbers equally likely.

    After a reservation the resource is kept with probability `kept`, otherwise the sender selects
    another one (3GPP TS 36.321, 5.14.1.1: 5 to 15 messages at 10 Hz, kept with 0 to 0.8). The
    sequence is stationary from the first message on. The reservation of a message can be computed
    alone: sequences that begin at different messages soon end a reservation at the same message and
    agree from there on (coupling from the past). Reservations of constant length never couple, so
    their first message is drawn.
    """

    least: int
    most: int
    kept: float = 0.0
    purpose: str = "reservation"
    _known: dict[Draw, tuple[int, int, int]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not 1 <= self.least <= self.most:
            raise ValueError(f"reservations for {self.least} to {self.most} messages")
        if not 0.0 <= self.kept < 1.0:
            raise ValueError(f"kept with probability {self.kept}")

    @property
    def mean_messages(self) -> float:
        return 0.5 * (self.least + self.most) / (1.0 - self.kept)

    def selected_at(self, draw: Draw, seq: int) -> int:
        """Number of the first message sent with the resource of message `seq`."""
        known = self._known.get(draw)
        if known is None or not known[1] <= seq < known[2] + LOOK_BACK * self.most:
            known = self._find(draw, seq)
        selected, begin, end = known
        while end <= seq:
            begin, end = end, end + self._length(draw, end)
            if not self._is_kept(draw, begin):
                selected = begin
        if len(self._known) >= CACHE_SIZE:
            self._known.clear()
        self._known[draw] = selected, begin, end
        return selected

    def _find(self, draw: Draw, seq: int) -> tuple[int, int, int]:
        """Find the last reservation up to `seq` whose resource was newly selected.

        Returns the message of the selection, and the begin and end of the reservation.
        """
        back = LOOK_BACK * self.most
        while True:
            begin = self._coupled(draw, seq - back)
            while begin <= seq:
                if not self._is_kept(draw, begin):
                    return begin, begin, begin + self._length(draw, begin)
                begin += self._length(draw, begin)
            back *= 2

    def _coupled(self, draw: Draw, start: int) -> int:
        """First message at which all sequences possible at `start` begin a reservation."""
        if self.least == self.most:
            begin = int(draw(f"{self.purpose} begin", 0) * self.most)
            return start + (begin - start) % self.most
        ends = list(range(start, start + self.most))  # ascending, and so a heap
        last = ends[-1]
        while ends[0] != last:
            following = ends[0] + self._length(draw, ends[0])
            heapreplace(ends, following)
            last = max(last, following)
        return last

    def _length(self, draw: Draw, begin: int) -> int:
        return self.least + int(draw(self.purpose, begin) * (self.most - self.least + 1))

    def _is_kept(self, draw: Draw, begin: int) -> bool:
        return draw(f"{self.purpose} kept", begin) < self.kept


def reselection_problems(least: int, most: int) -> Iterator[Problem]:
    """Yield a maximum number of messages per reservation that is below the minimum."""
    if most < least:
        allowed = f"at least reselection_messages_min, {least}"
        yield "reselection_messages_max", f"given {most}, allowed {allowed}"
