"""What an effect of a link is given of a message, and what it answers."""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import Protocol

from transport.reasons import DropReason

Draw = Callable[[str, int], float]
"""Draws the number in (0, 1) that belongs to a purpose and a message's number, any number's.

The same purpose and number give the same draw, whatever was drawn before.
"""


@dataclass(frozen=True, slots=True)
class Whereabouts:
    """Where a vehicle truly is, for the channel alone: east, north (m) and metres driven."""

    east: float = nan
    north: float = nan
    driven: float = nan


NOWHERE = Whereabouts()


@dataclass(frozen=True, slots=True)
class Passage:
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
