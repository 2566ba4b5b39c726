"""Reservations of a radio's resources, each for a number of messages in a row (LTE-V2X mode 4)."""

from dataclasses import dataclass, field
from heapq import heapreplace

from transport.links.laws.effect import Draw

CACHE_SIZE = 64
"""Links whose last reservation is kept; what is not kept is worked out again."""
LOOK_BACK = 8
"""Longest reservations that are looked back over at first; then twice as many, and so on."""


@dataclass(frozen=True, slots=True)
class Reservations:
    """A sender's reservations: each is for `least` to `most` messages, all equally likely.

    When one is over it is kept for another time with probability `kept`, else the sender selects
    other resources (3GPP TS 36.321, 5.14.1.1: 5 to 15 messages at 10 Hz, kept with 0 to 0.8). The
    sequence has no beginning: it is stationary from the first message on. Any message's reservation
    can be found alone, because reservations that begin at different messages soon end at the same
    one, from which on they agree: so far back is looked that all do (coupling from the past). Those
    of one length never agree: the message with which one of them begins is drawn.
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
        """Mean number of messages for which resources are held."""
        return 0.5 * (self.least + self.most) / (1.0 - self.kept)

    def selected_at(self, draw: Draw, seq: int) -> int:
        """Return the message before which the resources of message `seq` were selected."""
        known = self._known.get(draw)
        if known is None or not known[1] <= seq < known[2] + LOOK_BACK * self.most:
            known = self._sure(draw, seq)
        selected, begin, end = known
        while end <= seq:
            begin, end = end, end + self._length(draw, end)
            if not self._is_kept(draw, begin):
                selected = begin
        if len(self._known) >= CACHE_SIZE:
            self._known.clear()
        self._known[draw] = selected, begin, end
        return selected

    def _sure(self, draw: Draw, seq: int) -> tuple[int, int, int]:
        """Find a reservation that began with `seq` or before, when its resources were selected.

        Returns the message of that selection, and twice the reservation's bounds: begin and end.
        """
        back = LOOK_BACK * self.most
        while True:
            agreed = self._agreed(draw, seq - back)
            while agreed <= seq:
                if not self._is_kept(draw, agreed):
                    return agreed, agreed, agreed + self._length(draw, agreed)
                agreed += self._length(draw, agreed)
            back *= 2

    def _agreed(self, draw: Draw, start: int) -> int:
        """First message at which all reservations that may be running at `start` have ended."""
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
