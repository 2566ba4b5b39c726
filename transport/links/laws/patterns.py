"""Losses without chance: every n-th message, listed ones, a recorded pattern, an earlier run's."""

import re
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import accumulate
from math import inf
from typing import Literal, cast, get_args

from transport.links.laws.effect import Draw, LosesNothing, Passage
from transport.reasons import DropReason, counts_as_loss
from vehicles.schedule import MILLISECOND

AfterEnd = Literal["repeat", "pass"]
"""What becomes of messages beyond the end of a record."""


@dataclass(frozen=True)
class Numbers:
    """A set of message numbers, as ranges (first, last) in order that do not touch."""

    ranges: tuple[tuple[int, int], ...]
    _firsts: tuple[int, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Keep the first numbers, to search in."""
        object.__setattr__(self, "_firsts", tuple(first for first, _ in self.ranges))

    def __contains__(self, number: int) -> bool:
        place = bisect_right(self._firsts, number) - 1
        return place >= 0 and number <= self.ranges[place][1]

    def __len__(self) -> int:
        return sum(last - first + 1 for first, last in self.ranges)

    def __str__(self) -> str:
        return ", ".join(
            str(first) if first == last else f"{first}-{last}" for first, last in self.ranges
        )

    @classmethod
    def of(cls, pairs: Iterable[tuple[int, int]]) -> "Numbers":
        """Merge ranges (first, last) that come in any order."""
        merged: list[tuple[int, int]] = []
        for first, last in sorted(pairs):
            if merged and first <= merged[-1][1] + 1:
                merged[-1] = merged[-1][0], max(last, merged[-1][1])
            else:
                merged.append((first, last))
        return cls(tuple(merged))

    @classmethod
    def read(cls, text: str) -> "Numbers":
        """Read `3, 7, 10-20`; raises ValueError with what is wrong."""
        pairs = []
        for part in filter(None, (part.strip() for part in text.split(","))):
            found = re.fullmatch(r"(\d{1,18})(?:\s*-\s*(\d{1,18}))?", part, re.ASCII)
            if found is None:
                raise ValueError(f'"{part}", allowed numbers and ranges such as "3, 7, 10-20"')
            first, last = int(found[1]), int(found[2] or found[1])
            if last < first:
                raise ValueError(f'"{part}", allowed a range that does not go back')
            pairs.append((first, last))
        return cls.of(pairs)

    @property
    def mean_run(self) -> float | None:
        """Mean length of its ranges, None if it is empty."""
        return len(self) / len(self.ranges) if self.ranges else None


@dataclass(frozen=True, slots=True)
class EveryNth:
    """Loses message `first`, and from then on one of every `period`."""

    period: int
    first: int = 0

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        after = passage.seq - self.first
        return "pattern" if after >= 0 and after % self.period == 0 else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of messages lost from the first on."""
        return 1.0 / self.period

    @property
    def mean_burst_messages(self) -> float:
        """One, unless all are lost."""
        return 1.0 if self.period > 1 else inf

    def in_words(self) -> str:
        """Name the law with its numbers."""
        return f"one message of every {self.period} lost, from number {self.first} on"


@dataclass(frozen=True, slots=True)
class Listed:
    """Loses the messages with these numbers, however many others come."""

    lost: Numbers

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        return "pattern" if passage.seq in self.lost else 0

    @property
    def mean_loss_ratio(self) -> None:
        """Unknown: it depends on how many messages there are."""
        return

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean length of the ranges."""
        return self.lost.mean_run

    def in_words(self) -> str:
        """Say how many are lost, and which if the list is short."""
        which = str(self.lost)
        return f"{len(self.lost)} listed messages lost" + (f": {which}" * (len(which) < 80))


@dataclass(frozen=True, slots=True)
class RecordedPattern:
    """Loses what a record of `length` messages lost; it starts with the run's first message."""

    lost: Numbers
    length: int
    after_end: AfterEnd

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        number = passage.seq % self.length if self.after_end == "repeat" else passage.seq
        return "pattern" if number in self.lost else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of the record that is lost."""
        return len(self.lost) / self.length

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number lost in a row; one that the end of the record cuts goes on if it repeats."""
        if len(self.lost) == self.length and self.after_end == "repeat":
            return inf
        wraps = self.after_end == "repeat" and 0 in self.lost and self.length - 1 in self.lost
        return len(self.lost) / (len(self.lost.ranges) - wraps) if self.lost.ranges else None

    def in_words(self) -> str:
        """Say how long the record is and what it lost."""
        then = "again and again" if self.after_end == "repeat" else "then no more"
        return f"a record of {self.length} messages, {len(self.lost)} of them lost, {then}"


@dataclass(frozen=True)
class EarlierRun:
    """Does to each message what a link of an earlier run did to the one of the same number.

    `dropped` are the numbers by reason; `delays` (ns, and how many messages had it) are those of
    all messages in order, those dropped included. Beyond the end it starts again, or passes all
    after `latency` ns.
    """

    dropped: tuple[tuple[DropReason, Numbers], ...]
    delays: tuple[tuple[int, int], ...]
    after_end: AfterEnd
    latency: int
    _ends: tuple[int, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Keep where each run of equal delays ends, to search in."""
        object.__setattr__(self, "_ends", tuple(accumulate(count for _, count in self.delays)))

    @property
    def length(self) -> int:
        """Messages on record."""
        return self._ends[-1]

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the number alone."""
        number = passage.seq
        if number >= self.length:
            if self.after_end == "pass":
                return 0
            number %= self.length
        for reason, numbers in self.dropped:
            if number in numbers:
                return reason
        return 0

    @property
    def recorded_delay(self) -> "RecordedDelay":
        """The effect that delays messages as the earlier run did, dropped ones included."""
        return RecordedDelay(self.delays, self._ends, self.after_end, self.latency)

    @property
    def _lost(self) -> Numbers:
        return Numbers.of(
            pair for reason, some in self.dropped if counts_as_loss(reason) for pair in some.ranges
        )

    @property
    def mean_loss_ratio(self) -> float:
        """Share of the messages on record that was lost."""
        return len(self._lost) / self.length

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number lost in a row, on record."""
        return self._lost.mean_run

    def in_words(self) -> str:
        """Say how long the record is and what it lost."""
        then = "again and again" if self.after_end == "repeat" else "then no more"
        lost = len(self._lost)
        return f"an earlier run's link: {self.length} messages, {lost} of them lost, {then}"


@dataclass(frozen=True, slots=True)
class RecordedDelay(LosesNothing):
    """Delays each message by as much as an earlier run's: runs of equal `delays` that have ends."""

    delays: tuple[tuple[int, int], ...]
    ends: tuple[int, ...]
    after_end: AfterEnd
    latency: int

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:  # noqa: ARG002 - no chance
        """Delay by the number alone."""
        number = passage.seq
        if number >= self.ends[-1]:
            if self.after_end == "pass":
                return self.latency
            number %= self.ends[-1]
        return self.delays[bisect_right(self.ends, number)][0]

    def in_words(self) -> str:
        """Say between which delays it is."""
        least, most = (one(self.delays)[0] / MILLISECOND for one in (min, max))
        return f"delay as in an earlier run, {least:g} to {most:g} ms"


def known_reason(word: str) -> DropReason:
    """Return the word of a log if it is one of this version's, else `pattern`."""
    return cast("DropReason", word) if word in get_args(DropReason) else "pattern"
