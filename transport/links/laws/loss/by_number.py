"""Losses that depend only on the numbers of messages, and no loss."""

from collections.abc import Iterator
from functools import cached_property
from math import inf
from typing import ClassVar, Literal

from transport.links.laws.effect import Draw, Effect, JudgedBy, TransmissionContext
from transport.links.laws.link_law import (
    InvalidKeyError,
    LinkLaw,
    LinkSetting,
    Problem,
    problems_of,
)
from transport.links.laws.loss.number_sets import (
    AfterEnd,
    FileName,
    MessageCount,
    MessageNumber,
    NumberSet,
    parse_numbers,
)
from transport.links.laws.moments import Losses
from transport.reasons import DropReason


class NoLoss(LinkLaw):
    """No loss, for single links where the other links have a law of loss."""

    kind: Literal["none"] = "none"

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        return ()


class LossByNumber(LinkLaw):
    """Base of losses by the number of a message, which starts at 0."""

    key = "loss"
    reason: ClassVar[DropReason | None] = "pattern"
    judged_by: ClassVar[JudgedBy] = "number"


class EveryNth(LossByNumber):
    """Periodic loss of single messages.

    every_messages  period in messages
    first_number    number of the first lost message
    """

    kind: Literal["every_nth"] = "every_nth"
    every_messages: MessageCount | None = None
    first_number: MessageNumber = 0

    @cached_property
    def _period(self) -> int:
        period: int = self.required("every_messages")
        return period

    def problems(self) -> Iterator[Problem]:
        return problems_of(lambda: self._period)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        after = context.seq - self.first_number
        return "pattern" if after >= 0 and after % self._period == 0 else 0

    def losses(self, distance_m: float | None) -> Losses:
        return Losses.of_bursts(1.0 / self._period, 1.0 if self._period > 1 else inf)

    def describe(self) -> str:
        return f"one of every {self._period} messages lost, from number {self.first_number}"


class Listed(LossByNumber):
    """Loss of listed messages.

    lost_numbers  numbers and ranges, such as "3, 7, 10-20"
    """

    kind: Literal["listed"] = "listed"
    lost_numbers: str | None = None

    @cached_property
    def lost(self) -> NumberSet:
        return parse_numbers("lost_numbers", self.required("lost_numbers"))

    def problems(self) -> Iterator[Problem]:
        return problems_of(lambda: self.lost)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "pattern" if context.seq in self.lost else 0

    def losses(self, distance_m: float | None) -> None:
        """Return None: the loss ratio depends on the number of messages."""

    def describe(self) -> str:
        numbers = str(self.lost)
        return f"{len(self.lost)} listed messages lost" + (f": {numbers}" * (len(numbers) < 80))


class RecordedPattern(LossByNumber):
    """Losses of a recorded pattern.

    file             CSV file with the columns number and received (0 or 1); its first row belongs
                     to the first message of the run
    after_end        after the last row "repeat" the pattern or "pass" all messages
    length_messages  length of the pattern, in place of a file
    lost_numbers     its lost messages, such as "3, 7, 10-20"
    source           name of the file it was read from
    """

    kind: Literal["pattern"] = "pattern"
    file: FileName | None = None
    after_end: AfterEnd = "repeat"
    source: str = ""
    length_messages: MessageCount | None = None
    lost_numbers: str | None = None

    @cached_property
    def lost(self) -> NumberSet:
        return parse_numbers("lost_numbers", self.lost_numbers or "")

    @cached_property
    def length(self) -> int:
        return self.length_messages or 1

    def problems(self) -> Iterator[Problem]:
        return problems_of(self._check)

    def _check(self) -> None:
        if self.file is not None and self.length_messages is not None:
            why = "given together with length_messages, allowed a file or its contents"
            raise InvalidKeyError("file", why)
        if self.file is not None:
            return
        length = self.required("length_messages", ", needed without file")
        if self.lost.ranges and self.lost.ranges[-1][1] >= length:
            allowed = f"numbers below length_messages, {length}"
            raise InvalidKeyError(
                "lost_numbers", f"given {self.lost.ranges[-1][1]}, allowed {allowed}"
            )

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        number = context.seq % self.length if self.after_end == "repeat" else context.seq
        return "pattern" if number in self.lost else 0

    def losses(self, distance_m: float | None) -> Losses:
        """Loss of the pattern; if it repeats, a burst may continue across its end."""
        repeats, lost = self.after_end == "repeat", len(self.lost)
        burst = None
        if lost == self.length and repeats:
            burst = inf
        elif lost:
            wraps = repeats and 0 in self.lost and self.length - 1 in self.lost
            burst = lost / (len(self.lost.ranges) - wraps)
        return Losses.of_bursts(lost / self.length, burst)

    def describe(self) -> str:
        then = "repeated" if self.after_end == "repeat" else "no loss afterwards"
        return f"recorded pattern of {self.length} messages, {len(self.lost)} lost, {then}"
