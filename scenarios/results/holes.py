"""What of a run was not recorded: holes in the numbers of the poses that a vehicle sends."""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

from vehicles.schedule import SECOND, instant


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordHole:
    """Poses of a vehicle that it should have sent and that are not in the log, one after another.

    `from_s` and `to_s` are the instants of the first and the last of them, from the start.
    """

    vehicle: str
    from_s: float
    to_s: float
    poses: int

    @property
    def line(self) -> str:
        """What is missing, in one line."""
        poses = "1 pose" if self.poses == 1 else f"{self.poses} poses"
        when = f"{self.from_s:.2f}"
        if self.poses > 1:
            when += f" to {self.to_s:.2f}"
        return f"not recorded: {poses} of {self.vehicle}, {when} s after the start"


class RecordedNumbers:
    """The numbers of the poses that were recorded, as ranges; they may come in any order."""

    def __init__(self) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        self.count = 0

    def add(self, number: int) -> None:
        """Take a number; one that is there already changes nothing but the count."""
        self.count += 1
        if self._lasts and number == self._lasts[-1] + 1:
            self._lasts[-1] = number
            return
        place = bisect_left(self._lasts, number)  # the first range that ends at it or later
        if place < len(self._lasts) and self._firsts[place] <= number:
            return
        self._firsts.insert(place, number)
        self._lasts.insert(place, number)
        for left in (place, place - 1):  # join what touches now
            if 0 <= left < len(self._lasts) - 1 and self._lasts[left] + 1 == self._firsts[left + 1]:
                del self._lasts[left], self._firsts[left + 1]

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


def expected_poses(ran_ns: int, rate_hz: float) -> int:
    """How many instants of a schedule of `rate_hz` lie before `ran_ns` (ns) after its start."""
    count = max(ceil(ran_ns * rate_hz / SECOND), 0)
    while count and instant(0, count - 1, rate_hz) >= ran_ns:
        count -= 1
    while instant(0, count, rate_hz) < ran_ns:
        count += 1
    return count


def holes_of(
    vehicle: str, numbers: RecordedNumbers, rate_hz: float, expected: int
) -> Iterator[RecordHole]:
    """Give the holes in the record of a vehicle that sends poses at `rate_hz`."""
    for first, last in numbers.missing(expected):
        yield RecordHole(
            vehicle=vehicle,
            from_s=instant(0, first, rate_hz) / SECOND,
            to_s=instant(0, last, rate_hz) / SECOND,
            poses=last - first + 1,
        )
