"""Sets of message numbers, as scenario files write them."""

import json
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from math import inf
from typing import Annotated, ClassVar, Literal, cast, get_args

from pydantic import Field, StringConstraints

from transport.links.laws.link_law import (
    Draw,
    Effect,
    InvalidKeyError,
    LinkLaw,
    LinkSetting,
    Losses,
    Problem,
    TransmissionContext,
    problems_of,
)
from transport.topics import DropReason, counts_as_loss

MessageNumber = Annotated[int, Field(ge=0, le=10**12)]
MessageCount = Annotated[int, Field(ge=1, le=10**9)]
FileName = Annotated[str, StringConstraints(min_length=1)]
AfterEnd = Literal["repeat", "pass"]  # Then repeat a record, or lose nothing


@dataclass(frozen=True)
class NumberSet:
    """A set of message numbers, as ascending ranges (first, last) with gaps between them."""

    ranges: tuple[tuple[int, int], ...]
    _firsts: tuple[int, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_firsts", tuple(first for first, _ in self.ranges))

    def __contains__(self, number: int) -> bool:
        index = bisect_right(self._firsts, number) - 1
        return index >= 0 and number <= self.ranges[index][1]

    def __len__(self) -> int:
        return sum(last - first + 1 for first, last in self.ranges)

    def __str__(self) -> str:
        return ", ".join(
            str(first) if first == last else f"{first}-{last}" for first, last in self.ranges
        )

    @classmethod
    def of(cls, pairs: Iterable[tuple[int, int]]) -> "NumberSet":
        """Merge ranges (first, last) in any order."""
        merged: list[tuple[int, int]] = []
        for first, last in sorted(pairs):
            if merged and first <= merged[-1][1] + 1:
                merged[-1] = merged[-1][0], max(last, merged[-1][1])
            else:
                merged.append((first, last))
        return cls(tuple(merged))

    @classmethod
    def read(cls, text: str) -> "NumberSet":
        """Parse a text such as `3, 7, 10-20`; raises ValueError."""
        pairs = []
        for part in filter(None, (part.strip() for part in text.split(","))):
            match = re.fullmatch(r"(\d{1,18})(?:\s*-\s*(\d{1,18}))?", part, re.ASCII)
            if match is None:
                raise ValueError(f'"{part}", allowed numbers and ranges such as "3, 7, 10-20"')
            first, last = int(match[1]), int(match[2] or match[1])
            if last < first:
                raise ValueError(f'"{part}", allowed a range from a smaller to a larger number')
            pairs.append((first, last))
        return cls.of(pairs)


def parse_numbers(key: str, text: str) -> NumberSet:
    """Parse the numbers of a key; raises InvalidKeyError."""
    try:
        return NumberSet.read(text)
    except ValueError as error:
        raise InvalidKeyError(key, f"given {str(error)[:200]}") from error


# ---- Losses that depend only on the numbers of messages, and no loss


class NoLoss(LinkLaw):
    """No loss, for single links where the other links have a law of loss."""

    kind: Literal["none"] = "none"

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        return ()


class LossByNumber(LinkLaw):
    """Base of losses by the number of a message, which starts at 0."""

    key = "loss"
    reason: ClassVar[DropReason | None] = "pattern"
    by_number: ClassVar[bool] = True


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
        return Losses(1.0 / self._period, 1.0 if self._period > 1 else inf)


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
        return Losses(lost / self.length, burst)


# ---- Losses and delays of a link recorded in an earlier run


LARGEST_DELAY_DIGITS = 15  # Of a recorded delay in ns: eleven days
MAX_SHOWN = 60  # Maximum length of a refused value in an error message


class EarlierRun(LinkLaw):
    """Losses and delays of a link in an earlier run, message by message.

    file             log of the earlier run
    sender           sender of the recorded link, by default the sender of this link
    receiver         receiver of the recorded link, by default the receiver of this link
    partial          use a log that is damaged, incomplete or lacks verdicts; messages of unknown
                     fate count as delivered
    after_end        after the last recorded message "repeat" the record or "pass" all messages,
                     delayed by `latency_ms`
    delays_ns        delays in order, in place of a file, such as "20000000x700, 23000000"
    dropped_numbers  numbers of dropped messages by reason, such as { loss = "3, 7" }
    source           name of the file they were read from
    log_faults       damage and holes of that file, in one line

    The record replaces all keys of the link except `latency_ms`, which applies after the end of the
    record with "pass".
    """

    key = "loss"
    by_number = True
    replaces_others = True

    kind: Literal["log"] = "log"
    file: FileName | None = None
    sender: str | None = None
    receiver: str | None = None
    partial: bool = False
    after_end: AfterEnd = "repeat"
    source: str = ""
    log_faults: str = ""
    delays_ns: str | None = None
    dropped_numbers: dict[str, str] = Field(default_factory=dict)

    @cached_property
    def dropped(self) -> tuple[tuple[DropReason, NumberSet], ...]:
        """Dropped numbers by reason; raises InvalidKeyError."""
        return tuple(
            (known_reason(word), parse_numbers(f"dropped_numbers.{word}", numbers))
            for word, numbers in self.dropped_numbers.items()
        )

    @cached_property
    def delays_in_order(self) -> tuple[tuple[int, int], ...]:
        """Delays (ns), each with the number of successive messages; raises InvalidKeyError."""
        if self.file is not None:
            return ((0, 1),)  # not read yet
        delays = []
        for part in self.required("delays_ns", ", needed without file").split(","):
            pair = re.fullmatch(
                rf"\s*(\d{{1,{LARGEST_DELAY_DIGITS}}})(?:x([1-9]\d{{0,8}}))?\s*", part, re.ASCII
            )
            if pair is None:
                allowed = 'delays with numbers of messages, such as "20000000x700, 23000000"'
                raise InvalidKeyError("delays_ns", f"given {_shown(part)}, allowed {allowed}")
            delays.append((int(pair[1]), int(pair[2] or 1)))
        return tuple(delays)

    def problems(self) -> Iterator[Problem]:
        return problems_of(self._check)

    def _check(self) -> None:
        if self.file is not None and self.delays_ns is not None:
            raise InvalidKeyError(
                "file", "given together with delays_ns, allowed a log or its contents"
            )
        if self.file is None:
            _ = self.delays_in_order, self.dropped

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        return (*super().effects(setting), self.recorded_delay(setting.latency))

    @cached_property
    def length(self) -> int:
        return sum(count for _, count in self.delays_in_order)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        number = context.seq
        if number >= self.length:
            if self.after_end == "pass":
                return 0
            number %= self.length
        for reason, numbers in self.dropped:
            if number in numbers:
                return reason
        return 0

    def recorded_delay(self, latency: int) -> "RecordedDelay":
        """Effect that delays messages as in the earlier run, dropped ones included."""
        delays = self.delays_in_order
        ends = tuple(accumulate(count for _, count in delays))
        return RecordedDelay(delays, ends, self.after_end, latency)

    @property
    def lost(self) -> NumberSet:
        return NumberSet.of(
            pair for reason, some in self.dropped if counts_as_loss(reason) for pair in some.ranges
        )

    def losses(self, distance_m: float | None) -> None:
        """Return None: a run rarely ends with the record."""


@dataclass(frozen=True, slots=True)
class RecordedDelay(Effect):
    """Delays messages as in an earlier run: runs of equal delays, with their cumulative `ends`."""

    delays_in_order: tuple[tuple[int, int], ...]
    ends: tuple[int, ...]
    after_end: AfterEnd
    latency: int

    key = "loss"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        number = context.seq
        if number >= self.ends[-1]:
            if self.after_end == "pass":
                return self.latency
            number %= self.ends[-1]
        return self.delays_in_order[bisect_right(self.ends, number)][0]

    @property
    def delays(self) -> None:
        return


def known_reason(word: str) -> DropReason:
    """Reason of a recorded drop if this version knows it, else `pattern`."""
    return cast("DropReason", word) if word in get_args(DropReason) else "pattern"


def _shown(text: str) -> str:
    quoted = json.dumps(text)
    return quoted if len(quoted) <= MAX_SHOWN else f"{quoted[: MAX_SHOWN - 3]}..."
