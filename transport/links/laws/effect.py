"""What an effect of a link is given of a message, and what it answers."""

from collections.abc import Callable
from math import nan
from typing import NamedTuple, Protocol, runtime_checkable

from transport.reasons import DropReason

Draw = Callable[[str, int], float]
"""Draws the number in (0, 1) that belongs to a purpose and a message's number, any number's.

The same purpose and number give the same draw, whatever was drawn before.
"""


class Whereabouts(NamedTuple):
    """Where a vehicle truly is, for the channel alone: east, north (m) and metres driven."""

    east: float = nan
    north: float = nan
    driven: float = nan


NOWHERE = Whereabouts()


class Passage(NamedTuple):
    """One message on its way over a link: its number, when it was sent (ns), its size (bytes).

    `sender` is where the antenna truly was when it sent, as the message says; `receiver` is where
    the node that judges knows it was itself at that instant, at its last tick until then. So both
    are the same on every clock.
    """

    seq: int
    sent_at: int
    size: int = 0
    sender: Whereabouts = NOWHERE
    receiver: Whereabouts = NOWHERE


class Effect(Protocol):
    """One impairment of a link; delays of several effects add up, any drop wins.

    A verdict must not depend on which messages came before. An effect with memory has to be a
    function of the message's number all the same: its state follows from the keyed draws of the
    numbers up to it, those that never came included.
    """

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Return the delay that this effect adds, in ns, or the word for why it drops it."""


@runtime_checkable
class Described(Protocol):
    """What a law says beforehand of the messages it will judge, in the long run.

    An effect has these where they follow from its own numbers. `mean_loss_ratio` is the share of
    messages that it drops as lost, 0.0 if it only delays. `mean_burst_messages` is the mean number
    of messages lost in a row, None if it loses none; inf if it never stops. Both are None where
    they depend on more than the law, such as where the vehicles are.
    """

    @property
    def mean_loss_ratio(self) -> float | None:
        """Share of messages lost."""

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number of messages lost in a row."""

    def in_words(self) -> str:
        """Say the law in one line without a full stop, with units, for who checks a scenario."""


class LosesNothing:
    """What a law that delays, or holds back by rate, says of loss."""

    __slots__ = ()

    @property
    def mean_loss_ratio(self) -> float:
        """None is lost."""
        return 0.0

    @property
    def mean_burst_messages(self) -> None:
        """None is lost."""
        return
