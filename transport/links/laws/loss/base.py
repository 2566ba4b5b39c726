"""Base class of user-defined laws of loss."""

from typing import ClassVar

from transport.links.laws.link_law import LinkLaw, described_parameters
from transport.links.laws.moments import Losses
from transport.reasons import DropReason


class BaseLoss(LinkLaw):
    """Base of a user-defined law of loss: a Pydantic model whose fields are its parameters.

    `judge` decides on one message. The verdict must depend only on `draw` and `context`, not on
    other messages, so that it is the same on every clock: `draw("mine", context.seq)` is the random
    number in (0, 1) of a purpose and a message. Lost messages have the reason "loss".

    `losses` may state the mean loss in the long run, `Losses.independent(ratio)`, which `convoy
    check` compares with the achieved one; by default it is unknown. `describe` may describe the law
    in one line.
    """

    key: ClassVar[str] = "loss"
    reason: ClassVar[DropReason | None] = "loss"

    def losses(self, distance_m: float | None) -> Losses | None:
        return None

    def describe(self) -> str:
        return described_parameters(self)
