"""Loss of one message of every N."""

from functools import cached_property
from math import inf
from typing import Literal

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.law import LinkLaw
from transport.links.laws.loss.numbers import MessageCount, MessageNumber
from transport.reasons import DropReason


class EveryNth(LinkLaw):
    """Message `first_number` is lost, and from then on one of every `every_messages`."""

    key = "loss"
    reason = "pattern"
    judged_by = "number"

    kind: Literal["every_nth"] = "every_nth"
    every_messages: MessageCount | None = None
    first_number: MessageNumber = 0

    @cached_property
    def _period(self) -> int:
        period: int = self.needed("every_messages")
        return period

    def check(self) -> None:
        """Find a missing period."""
        self.needed("every_messages")

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        after = context.seq - self.first_number
        return "pattern" if after >= 0 and after % self._period == 0 else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of messages lost from the first on."""
        return 1.0 / self._period

    @property
    def mean_burst_messages(self) -> float:
        """One, unless all are lost."""
        return 1.0 if self._period > 1 else inf

    def describe(self) -> str:
        """Name the law with its numbers."""
        return f"one message of every {self._period} lost, from number {self.first_number} on"
