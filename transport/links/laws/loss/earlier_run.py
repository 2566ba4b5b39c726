"""Loss and delay of a link of an earlier run, message by message."""

import json
import re
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Literal, cast, get_args

from pydantic import Field

from transport.links.laws.effect import Draw, Effect, TransmissionContext
from transport.links.laws.link_law import InvalidKeyError, LinkLaw, LinkSetting
from transport.links.laws.loss.number_sets import AfterEnd, FileName, NumberSet, parse_numbers
from transport.reasons import DropReason, counts_as_loss
from vehicles.schedule import MILLISECOND

LARGEST_DELAY_DIGITS = 15
"""Of a recorded delay in ns: eleven days."""
MAX_SHOWN = 60
"""Characters of a refused value."""


class EarlierRun(LinkLaw):
    """What became of the messages of an earlier run: the same channel again, loss and delay.

    Of the log it is the link from `sender` to `receiver`, by default the one of the same names.
    The record takes the place of all other keys of the link; only messages beyond its end have
    `latency_ms`, unless it begins again. When the file has been read, `delays_ns` are the delays
    in order, such as "20000000x700, 23000000", and `dropped_numbers` those dropped, by reason.
    """

    key = "loss"
    judged_by = "number"
    replaces_others = True

    kind: Literal["log"] = "log"
    file: FileName | None = None
    sender: str | None = None
    receiver: str | None = None
    after_end: AfterEnd = "repeat"
    source: str = ""
    delays_ns: str | None = None
    dropped_numbers: dict[str, str] = Field(default_factory=dict)

    @cached_property
    def dropped(self) -> tuple[tuple[DropReason, NumberSet], ...]:
        """The numbers dropped, by reason; raises Unfit."""
        return tuple(
            (known_reason(word), parse_numbers(f"dropped_numbers.{word}", numbers))
            for word, numbers in self.dropped_numbers.items()
        )

    @cached_property
    def delays_in_order(self) -> tuple[tuple[int, int], ...]:
        """Delays (ns), each with the count of messages in a row that had it; raises Unfit."""
        if self.file is not None:
            return ((0, 1),)  # not read yet
        found = []
        for part in self.required("delays_ns", ", needed without file").split(","):
            pair = re.fullmatch(
                rf"\s*(\d{{1,{LARGEST_DELAY_DIGITS}}})(?:x([1-9]\d{{0,8}}))?\s*", part, re.ASCII
            )
            if pair is None:
                allowed = 'delays and how many messages had them, such as "20000000x700, 23000000"'
                raise InvalidKeyError("delays_ns", f"given {_shown(part)}, allowed {allowed}")
            found.append((int(pair[1]), int(pair[2] or 1)))
        return tuple(found)

    def check(self) -> None:
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
        """Return the effect that delays messages as the earlier run did, dropped ones included."""
        delays = self.delays_in_order
        ends = tuple(accumulate(count for _, count in delays))
        return RecordedDelay(delays, ends, self.after_end, latency)

    @property
    def lost(self) -> NumberSet:
        return NumberSet.of(
            pair for reason, some in self.dropped if counts_as_loss(reason) for pair in some.ranges
        )

    def losses(self, distance_m: float | None) -> None:
        """Return None: a run seldom ends with the record."""

    def describe(self) -> str:
        then = "repeated" if self.after_end == "repeat" else "then no more"
        lost = len(self.lost)
        return f"an earlier run's link: {self.length} messages, {lost} of them lost, {then}"


@dataclass(frozen=True, slots=True)
class RecordedDelay(Effect):
    """Delays each message by as much as an earlier run's: runs of equal `delays` that have ends."""

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
        least, most = (one(self.delays_in_order)[0] / MILLISECOND for one in (min, max))
        return f"delay as in an earlier run, {least:g} to {most:g} ms"


def known_reason(word: str) -> DropReason:
    """Return the word of a log if it is one of this version's, else `pattern`."""
    return cast("DropReason", word) if word in get_args(DropReason) else "pattern"


def _shown(text: str) -> str:
    quoted = json.dumps(text)
    return quoted if len(quoted) <= MAX_SHOWN else f"{quoted[: MAX_SHOWN - 3]}..."
