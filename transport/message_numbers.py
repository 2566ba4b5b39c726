"""Received numbers of a sender's messages, for links, recorder and figures."""

import sys
from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

MAX_RANGES: Final = 1000
"""Maximum number of ranges per topic in the recorder, so that forged numbers take no memory.
Beyond it duplicates may be recorded; no message is refused wrongly."""


class MessageNumbers:
    """Numbers of a sender's messages of one topic, stored as ranges; added in any order."""

    def __init__(self, most_ranges: int = sys.maxsize, window: int = sys.maxsize) -> None:
        """Numbers that would exceed `most_ranges` ranges are counted, but not stored.

        Ranges that end `window` or more numbers behind the newest one are deleted.
        """
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        self._most_ranges = most_ranges
        self._window = window
        self.count = 0

    def __contains__(self, number: int) -> bool:
        lasts = self._lasts
        if not lasts or number > lasts[-1]:  # the usual case
            return False
        return self._firsts[bisect_left(lasts, number)] <= number

    def add(self, number: int) -> bool:
        """Count a message; returns whether its number is new."""
        self.count += 1
        firsts, lasts = self._firsts, self._lasts
        if lasts and number == lasts[-1] + 1:  # the usual case
            lasts[-1] = number
        elif not self._insert(number):
            return False
        while lasts[0] <= lasts[-1] - self._window:
            del firsts[0], lasts[0]
        return True

    def _insert(self, number: int) -> bool:
        firsts, lasts = self._firsts, self._lasts
        place = bisect_left(lasts, number)  # the first range that ends at it or later
        if place < len(lasts) and firsts[place] <= number:
            return False
        firsts.insert(place, number)
        lasts.insert(place, number)
        for left in (place, place - 1):  # join adjacent ranges
            if 0 <= left < len(lasts) - 1 and lasts[left] + 1 == firsts[left + 1]:
                del lasts[left], firsts[left + 1]
        if len(firsts) > self._most_ranges:
            del lasts[place], firsts[place]
        return True

    @property
    def newest(self) -> int:
        """Largest number so far, -1 without any."""
        return self._lasts[-1] if self._lasts else -1

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Yield (first, last) of each range of stored numbers, in order."""
        return zip(self._firsts, self._lasts, strict=True)

    def missing(self, expected: int) -> Iterator[tuple[int, int]]:
        """Yield (first, last) of each hole, up to `expected` numbers or the newest number."""
        ends = [(-1, -1), *zip(self._firsts, self._lasts, strict=True)]
        ends.append((max(expected, self.newest + 1),) * 2)
        for (_, before), (after, _) in pairwise(ends):
            if after - before > 1:
                yield before + 1, after - 1
