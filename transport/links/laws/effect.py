"""Interface of an effect of a link: input, verdict and properties."""

from collections.abc import Callable
from math import nan
from typing import ClassVar, Literal, NamedTuple

from transport.links.laws.moments import Delays, Losses, LossStates
from transport.reasons import DropReason

Draw = Callable[[str, int], float]
"""Returns the random number in (0, 1) of a purpose and a message number.

It does not depend on earlier draws.
"""

JudgedBy = Literal["chance", "number", "time", "place"]


class Position(NamedTuple):
    """True position of a vehicle (m), for the channel only: east, north, distance travelled."""

    east: float = nan
    north: float = nan
    travelled: float = nan


UNKNOWN_POSITION = Position()


class TransmissionContext(NamedTuple):
    """Transmission of a message: number, instant of sending (ns), size (bytes), positions.

    `sender` is the true position of the antenna at sending, carried by the message; `receiver` is
    the true position of the receiving node at its last tick before. Both are the same on every
    clock.
    """

    seq: int
    sent_at: int
    size: int = 0
    sender: Position = UNKNOWN_POSITION
    receiver: Position = UNKNOWN_POSITION


class Effect:
    """One impairment of a link; delays of several effects add up, any drop wins.

    A verdict must not depend on which messages arrived before. The state of an effect with memory
    follows from the keyed draws of all numbers up to the message, whether or not they arrived.

    Except for `judge` and `describe`, the defaults are those of an effect without loss and delay.
    `key` is the key of a link that requests the effect, `reason` the reason of its drops.
    `judged_by` is "number", "time" or "place" if the verdict depends on that only, so that the
    losses of a run need not resemble those in the long run.
    """

    __slots__ = ()

    key: ClassVar[str]
    reason: ClassVar[DropReason | None] = None
    judged_by: ClassVar[JudgedBy] = "chance"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        """Delay (ns) of this effect, or the reason of a drop."""
        raise NotImplementedError

    def describe(self) -> str:
        """One line with units, without a full stop."""
        raise NotImplementedError

    def losses(self, distance_m: float | None) -> Losses | None:
        """Losses in the long run (of a radio: over a distance); None if they depend on more."""
        return Losses(0.0, None, 0.0)

    @property
    def states(self) -> LossStates | None:
        """Markov chain of the losses; None without one."""
        return None

    @property
    def delays(self) -> Delays | None:
        """Moments of the delay; None if they depend on more than the law."""
        return Delays(0.0, 0.0)

    def delay_quantile(self, share: float) -> float | None:
        """Quantile of the delay (ns) at the probability `share`; None if unknown."""
        return None

    @property
    def range_m(self) -> float | None:
        """Distance (m) beyond which almost nothing is received; None without a radio."""
        return None
