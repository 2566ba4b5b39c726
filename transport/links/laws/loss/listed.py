"""Loss of the messages with listed numbers."""

from functools import cached_property
from typing import Literal

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.law import LinkLaw
from transport.links.laws.loss.numbers import Numbers, numbers_of
from transport.reasons import DropReason


class Listed(LinkLaw):
    """Messages with certain numbers are lost: a text such as "3, 7, 10-20"."""

    key = "loss"
    reason = "pattern"
    judged_by = "number"

    kind: Literal["listed"] = "listed"
    lost_numbers: str | None = None

    @cached_property
    def lost(self) -> Numbers:
        """The numbers; raises Unfit."""
        return numbers_of("lost_numbers", self.needed("lost_numbers"))

    def check(self) -> None:
        """Find numbers that are missing or unreadable."""
        _ = self.lost

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        return "pattern" if context.seq in self.lost else 0

    @property
    def mean_loss_ratio(self) -> None:
        """Unknown: it depends on how many messages there are."""
        return

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean length of the ranges."""
        return self.lost.mean_run

    def describe(self) -> str:
        """Give the count, and the numbers if the list is short."""
        which = str(self.lost)
        return f"{len(self.lost)} listed messages lost" + (f": {which}" * (len(which) < 80))
