"""The interface of an effect of a link: its input, its verdict and its properties."""

from collections.abc import Callable
from math import nan
from typing import ClassVar, Literal, NamedTuple

from transport.links.laws.moments import Delays, Losses, LossStates
from transport.reasons import DropReason

Draw = Callable[[str, int], float]
"""Draws the number in (0, 1) that belongs to a purpose and a message's number, any number's.

The same purpose and number give the same draw, whatever was drawn before.
"""


CELL_PURPOSE = "outage"
"""Begins the purposes of draws whose number is that of a cell of time, not of a message."""

JudgedBy = Literal["chance", "number", "time", "place"]


class Position(NamedTuple):
    """Where a vehicle truly is, for the channel alone: east, north (m) and metres driven."""

    east: float = nan
    north: float = nan
    travelled: float = nan


UNKNOWN_POSITION = Position()


class TransmissionContext(NamedTuple):
    """One message on its way over a link: its number, when it was sent (ns), its size (bytes).

    `sender` is the true position of the antenna at sending, carried by the message; `receiver` is
    the true position of the judging node at its last tick until then. So both are the same on
    every clock.
    """

    seq: int
    sent_at: int
    size: int = 0
    sender: Position = UNKNOWN_POSITION
    receiver: Position = UNKNOWN_POSITION


class Effect:
    """One impairment of a link; delays of several effects add up, any drop wins.

    A verdict must not depend on which messages came before. An effect with memory has to be a
    function of the message's number all the same: its state follows from the keyed draws of the
    numbers up to it, those that never came included.

    Beside `judge` and `describe`, the defaults hold for an effect that loses nothing and adds no
    delay. `key` is the key of a link that requests the effect, `reason` the word of its drops.
    `judged_by` is "number", "time" or "place" where the verdict follows from those alone, so that a
    run need not be like the long run.
    """

    __slots__ = ()

    key: ClassVar[str]
    reason: ClassVar[DropReason | None] = None
    judged_by: ClassVar[JudgedBy] = "chance"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        """Return the delay (ns) that this effect adds, or the reason of a drop."""
        raise NotImplementedError

    def describe(self) -> str:
        """Describe the law in one line without a full stop, with units."""
        raise NotImplementedError

    def losses(self, distance_m: float | None) -> Losses | None:
        """Loss in the long run (of a radio: over a distance); None if it depends on more."""
        return Losses(0.0, None, 0.0)

    @property
    def states(self) -> LossStates | None:
        """The Markov chain behind the losses, if there is one."""
        return None

    @property
    def delays(self) -> Delays | None:
        """Moments of the delay, None where they depend on more than the law."""
        return Delays(0.0, 0.0)

    def delay_quantile(self, share: float) -> float | None:
        """Delay (ns) that a share of the messages does not exceed, None if unknown."""
        return None

    @property
    def range_m(self) -> float | None:
        """Distance (m) beyond which little or nothing is received; None without a radio."""
        return None
