"""Persistent collisions, as in LTE-V2X mode 4: who shares a resource collides until one moves."""

from dataclasses import dataclass, field
from math import inf

from transport.links.laws.effect import Draw, Passage
from transport.links.laws.radio.reservations import Reservations
from transport.reasons import DropReason


@dataclass(frozen=True)
class Collisions:
    """Loses all messages of a reservation whose resource somebody else has chosen too.

    A reservation lasts from `shortest` to `longest` messages, each number as likely. After it the
    resource is kept with the chance `keep`; else a new one is chosen, which collides with the
    chance `loss`. That is the mean loss too, for the length does not depend on the resource.
    Source: sensing-based semi-persistent scheduling, 3GPP TS 36.321 (5.14.1.1) and TS 36.213
    (14.1.1.6): a counter of 5 to 15 at 100 ms, kept with 0 to 0.8.

    Receivers are on their own here: a sender's resource collides on one link and not on another,
    as it does where the other sender is out of reach of the second receiver.
    """

    loss: float
    keep: float = 0.0
    shortest: int = 5
    longest: int = 15
    _held: Reservations = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Know the reservations; raises ValueError for lengths and chances that there are not."""
        held = Reservations(self.shortest, self.longest, self.keep, "collision")
        object.__setattr__(self, "_held", held)

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Drop if the resource that the message is sent in collides."""
        selected = self._held.selected_at(draw, passage.seq)
        return "collision" if draw("collision resource", selected) < self.loss else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of messages lost."""
        return self.loss

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number of messages lost in a row: over the reservations kept, and unlucky again."""
        if not self.loss:
            return None
        return self._held.mean_messages / (1.0 - self.loss) if self.loss < 1.0 else inf

    def in_words(self) -> str:
        """Name the law with its numbers."""
        return (
            f"persistent collisions: loss {self.loss:.4g} by reservations of {self.shortest} to "
            f"{self.longest} messages, kept with {self.keep:.4g}, "
            f"{self.mean_burst_messages or 0.0:.4g} messages in a row on average"
        )
