"""Sets of message numbers, as scenario files write them."""

import re
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from transport.links.laws.link_law import InvalidKeyError

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
