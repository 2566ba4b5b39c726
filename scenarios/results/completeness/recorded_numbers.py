"""Which numbers of the messages of a topic were recorded, as ranges: in turn they are one."""

import sys
from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise

MOST_RANGES = 1000
"""Ranges of numbers that are known of each topic, so that forged ones take no memory. Beyond it
nothing is refused that is true; a number that comes twice may then be recorded twice."""


class RecordedNumbers:
    """The numbers of the messages that were recorded, as ranges; they may come in any order."""

    def __init__(self, most_ranges: int = sys.maxsize) -> None:
        """A number that would need one range more than `most_ranges` is counted, but not kept."""
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        self._most_ranges = most_ranges
        self.count = 0

    def __contains__(self, number: int) -> bool:
        lasts = self._lasts
        if not lasts or number > lasts[-1]:  # as mostly
            return False
        return self._firsts[bisect_left(lasts, number)] <= number

    def add(self, number: int) -> None:
        """Take a number; one that is there already changes nothing but the count."""
        self.count += 1
        lasts = self._lasts
        if lasts and number == lasts[-1] + 1:
            lasts[-1] = number
            return
        place = bisect_left(self._lasts, number)  # the first range that ends at it or later
        if place < len(self._lasts) and self._firsts[place] <= number:
            return
        self._firsts.insert(place, number)
        self._lasts.insert(place, number)
        for left in (place, place - 1):  # join what touches now
            if 0 <= left < len(self._lasts) - 1 and self._lasts[left] + 1 == self._firsts[left + 1]:
                del self._lasts[left], self._firsts[left + 1]
        if len(self._firsts) > self._most_ranges:
            del self._lasts[place], self._firsts[place]

    @property
    def newest(self) -> int:
        """Largest number so far, -1 without any."""
        return self._lasts[-1] if self._lasts else -1

    def missing(self, expected: int) -> Iterator[tuple[int, int]]:
        """Give first and last number of each hole, up to `expected` numbers or the newest."""
        ends = [(-1, -1), *zip(self._firsts, self._lasts, strict=True)]
        ends.append((max(expected, self.newest + 1),) * 2)
        for (_, before), (after, _) in pairwise(ends):
            if after - before > 1:
                yield before + 1, after - 1
