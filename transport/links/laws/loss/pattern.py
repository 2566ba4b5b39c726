"""Loss of the messages that a recorded pattern lost."""

from functools import cached_property
from math import inf
from typing import Literal

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.law import LinkLaw, Unfit
from transport.links.laws.loss.numbers import (
    AfterEnd,
    FileName,
    MessageCount,
    Numbers,
    numbers_of,
)
from transport.reasons import DropReason


class RecordedPattern(LinkLaw):
    """A recorded pattern: CSV with the columns number and received, 0 or 1.

    Its first line is the first message of the run. Beyond its end it begins again, or lets all
    messages pass. When the file has been read, the pattern is `length_messages` long, lost the
    `lost_numbers` and is from `source`.
    """

    key = "loss"
    reason = "pattern"
    judged_by = "number"

    kind: Literal["pattern"] = "pattern"
    file: FileName | None = None
    after_end: AfterEnd = "repeat"
    source: str = ""
    length_messages: MessageCount | None = None
    lost_numbers: str | None = None

    @cached_property
    def lost(self) -> Numbers:
        """The numbers lost, none before the file has been read; raises Unfit."""
        return numbers_of("lost_numbers", self.lost_numbers or "")

    @cached_property
    def length(self) -> int:
        """Messages on record."""
        return self.length_messages or 1

    def check(self) -> None:
        """Find a pattern that is given twice or not at all, and numbers beyond its end."""
        if self.file is not None and self.length_messages is not None:
            why = "given together with length_messages, allowed a file or its contents"
            raise Unfit("file", why)
        if self.file is not None:
            return
        length = self.needed("length_messages", ", needed without file")
        if self.lost.ranges and self.lost.ranges[-1][1] >= length:
            allowed = f"numbers below length_messages, {length}"
            raise Unfit("lost_numbers", f"given {self.lost.ranges[-1][1]}, allowed {allowed}")

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        number = context.seq % self.length if self.after_end == "repeat" else context.seq
        return "pattern" if number in self.lost else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of the record that is lost."""
        return len(self.lost) / self.length

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number lost in a row, on across the end of the record if it repeats."""
        if len(self.lost) == self.length and self.after_end == "repeat":
            return inf
        wraps = self.after_end == "repeat" and 0 in self.lost and self.length - 1 in self.lost
        return len(self.lost) / (len(self.lost.ranges) - wraps) if self.lost.ranges else None

    def describe(self) -> str:
        """Give the length of the record and what it lost."""
        then = "repeated" if self.after_end == "repeat" else "then no more"
        return f"a record of {self.length} messages, {len(self.lost)} of them lost, {then}"
