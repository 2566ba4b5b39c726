"""Persistent collisions, as in LTE-V2X mode 4: who shares a resource collides until one moves.

A sender reserves a resource for a number of messages; two that have chosen the same collide for as
long as both keep it. Where reservations start follows from keyed draws of their first messages'
numbers, so that any verdict can be computed alone: see `Collisions`.
"""

from dataclasses import dataclass, field
from math import inf

from transport.links.laws.effect import Draw, Passage
from transport.reasons import DropReason

_LENGTH, _PHASE, _RESOURCE = "collision length", "collision phase", "collision"

_LOOK_BACK = 16
"""Longest reservations that are looked back over at first; then twice as many, and so on."""


def _nobody(purpose: str, seq: int) -> float:
    raise AssertionError(f"no link draws {purpose} of {seq} so")


@dataclass(frozen=True)
class Collisions:
    """Loses all messages of a reservation whose resource somebody else has chosen too.

    A reservation lasts from `shortest` to `longest` messages, each number as likely. After it the
    resource is kept with the chance `keep`; else a new one is chosen, which collides with the
    chance `loss`. That is the mean loss too, for the length does not depend on the resource.
    Source: sensing-based semi-persistent scheduling, 3GPP TS 36.321 (5.14.1.1) and TS 36.213
    (14.1.1.6): a counter of 5 to 15 at 100 ms, kept with 0 to 0.8.

    Every number has a draw that says how long a reservation would be that started there. All
    sequences of reservations that start within one longest reservation are followed; they soon
    meet, and what remains does not depend on where they started. So the reservations are exactly
    stationary (coupling from the past). The work is not bounded but short: with 5 to 15 messages
    about a hundred draws for a verdict alone, and one or two a reservation in a stream. Only
    reservations of one length never meet; their phase is drawn once.

    Receivers are on their own here: a sender's resource collides on one link and not on another,
    as it does where the other sender is out of reach of the second receiver.
    """

    loss: float
    keep: float = 0.0
    shortest: int = 5
    longest: int = 15
    _known: list[tuple[Draw, int, int, bool]] = field(
        default_factory=lambda: [(_nobody, 0, 0, False)], init=False, repr=False, compare=False
    )

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Drop if the reservation of the message's number collides."""
        drawn, start, end, collides = self._known[0]
        if drawn is not draw or not start <= passage.seq < end:
            collides = self._find(draw, passage.seq)
        return "collision" if collides else 0

    def _find(self, draw: Draw, seq: int) -> bool:
        """Find the reservation of a number, from the one that is known or by looking back."""
        drawn, _, start, collides = self._known[0]
        if drawn is not draw or not start <= seq < start + _LOOK_BACK * self.longest:
            start, collides = self._look_back(draw, seq)
        else:
            collides = self._collides(draw, start, before=collides)
        while start + (length := self._length(draw, start)) <= seq:
            start += length
            collides = self._collides(draw, start, before=collides)
        self._known[0] = draw, start, start + length, collides
        return collides

    def _look_back(self, draw: Draw, seq: int) -> tuple[int, bool]:
        """Return a reservation at or before `seq` with a newly chosen resource: start, fate."""
        back = _LOOK_BACK * self.longest
        while True:
            for start in reversed(self._starts(draw, seq, back)):
                if draw(_RESOURCE, start) >= self.keep:
                    return start, self._collides(draw, start, before=False)
            back *= 2

    def _starts(self, draw: Draw, seq: int, back: int) -> list[int]:
        """Starts of reservations up to `seq` that can be known from `back` messages before it."""
        if self.shortest == self.longest:
            phase = int(draw(_PHASE, 0) * self.longest)
            last = seq - (seq - phase) % self.longest
            return list(range(last - back // self.longest * self.longest, last + 1, self.longest))
        first = seq - back - self.longest
        followed, met = set(range(first, first + self.longest)), list[int]()
        for start in range(first, seq + 1):
            if start in followed:
                followed.remove(start)
                if not followed:
                    met.append(start)
                followed.add(start + self._length(draw, start))
        return met

    def _length(self, draw: Draw, start: int) -> int:
        if self.shortest == self.longest:
            return self.longest
        return self.shortest + int(draw(_LENGTH, start) * (self.longest - self.shortest + 1))

    def _collides(self, draw: Draw, start: int, *, before: bool) -> bool:
        drawn = draw(_RESOURCE, start)
        return before if drawn < self.keep else drawn - self.keep < self.loss * (1.0 - self.keep)

    @property
    def mean_loss_ratio(self) -> float:
        """Share of messages lost."""
        return self.loss

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number of messages lost in a row: over the reservations kept, and unlucky again."""
        if not self.loss:
            return None
        reservation = (self.shortest + self.longest) / 2.0
        ends = (1.0 - self.keep) * (1.0 - self.loss)
        return reservation / ends if ends else inf

    def in_words(self) -> str:
        """Name the law with its numbers."""
        return (
            f"persistent collisions: loss {self.loss:.4g} by reservations of {self.shortest} to "
            f"{self.longest} messages, kept with {self.keep:.4g}, "
            f"{self.mean_burst_messages or 0.0:.4g} messages in a row on average"
        )
