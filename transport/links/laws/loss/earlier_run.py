"""Losses and delays of a link recorded in an earlier run."""

import json
import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Literal, cast, get_args

from pydantic import Field

from transport.links.laws.effect import Draw, Effect, TransmissionContext
from transport.links.laws.link_law import (
    InvalidKeyError,
    LinkLaw,
    LinkSetting,
    Problem,
    problems_of,
)
from transport.links.laws.loss.number_sets import AfterEnd, FileName, NumberSet, parse_numbers
from transport.reasons import DropReason, counts_as_loss
from vehicles.schedule import MILLISECOND

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
    judged_by = "number"
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

    def describe(self) -> str:
        then = "repeated" if self.after_end == "repeat" else "no loss afterwards"
        return f"link of an earlier run: {self.length} messages, {len(self.lost)} lost, {then}"


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

    def describe(self) -> str:
        least, most = (end(self.delays_in_order)[0] / MILLISECOND for end in (min, max))
        return f"delay of an earlier run, {least:g} to {most:g} ms"


def known_reason(word: str) -> DropReason:
    """Reason of a recorded drop if this version knows it, else `pattern`."""
    return cast("DropReason", word) if word in get_args(DropReason) else "pattern"


def _shown(text: str) -> str:
    quoted = json.dumps(text)
    return quoted if len(quoted) <= MAX_SHOWN else f"{quoted[: MAX_SHOWN - 3]}..."
