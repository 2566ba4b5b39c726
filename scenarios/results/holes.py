"""What of a run was not recorded: holes in the numbers of the poses that a vehicle sends."""

import sys
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Literal

from vehicles.schedule import SECOND, instant

MOST_RANGES = 1000
"""Ranges of numbers that are known of each topic, so that forged ones take no memory. Beyond it
nothing is refused that is true; a number that comes twice may then be recorded twice."""
HoleKind = Literal["pose", "true pose"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordHole:
    """Poses of a vehicle that it should have sent and that are not in the log, one after another.

    `from_s` and `to_s` are the instants of the first and the last of them, from the start; of a
    vehicle that sends by no schedule those of the poses before and after. Of the kind "true pose"
    are those from which the figures are made, where poses were recorded meanwhile.
    """

    vehicle: str
    from_s: float
    to_s: float
    poses: int
    kind: HoleKind = "pose"

    def covers(self, other: "RecordHole", slack_s: float) -> bool:
        """Whether another hole lies within this one, or but for `slack_s` (s) at each end."""
        return other.from_s >= self.from_s - slack_s and other.to_s <= self.to_s + slack_s


def hole_lines(holes: Sequence[RecordHole], most: int) -> Iterator[str]:
    """Say what is missing, a line for equal holes of several vehicles, `most` lines of them."""
    alike: dict[tuple[float, float, int, HoleKind], list[str]] = {}
    for hole in holes:
        key = (hole.from_s, hole.to_s, hole.poses, hole.kind)
        alike.setdefault(key, []).append(hole.vehicle)
    for (begin, end, count, kind), vehicles in list(alike.items())[:most]:
        poses = f"1 {kind}" if count == 1 else f"{count} {kind}s"
        when = f"{begin:.2f}" if count == 1 else f"{begin:.2f} to {end:.2f}"
        each = "each " if len(vehicles) > 1 else ""
        yield f"not recorded: {poses} {each}of {', '.join(vehicles)}, {when} s after the start"
    if len(alike) > most:
        yield f"not recorded: {len(alike) - most} more holes, see the summary"


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


class EdgeInstants:
    """When those messages were sent that have a hole beside them, of a vehicle without a schedule.

    Numbers that come in turn have none, so few are kept.
    """

    def __init__(self) -> None:
        self._newest: tuple[int, int] | None = None
        self._at: dict[int, int] = {}

    def add(self, number: int, at: int) -> None:
        """Take the number of a message and the instant (ns) at which it was sent."""
        if self._newest is None:
            self._at[number] = at
        elif number != self._newest[0] + 1:
            self._at[number] = at
            self._at[self._newest[0]] = self._newest[1]
        if self._newest is None or number > self._newest[0]:
            self._newest = number, at

    def holes(self, vehicle: str, numbers: RecordedNumbers, start_at: int) -> Iterator[RecordHole]:
        """Give the holes in `numbers` of a run that started at `start_at` (ns).

        What was sent last may be missing without a trace.
        """
        for first, last in numbers.missing(0):
            yield RecordHole(
                vehicle=vehicle,
                from_s=(self._at.get(first - 1, start_at) - start_at) / SECOND,
                to_s=(self._at.get(last + 1, start_at) - start_at) / SECOND,
                poses=last - first + 1,
            )


def expected_poses(ran_ns: int, rate_hz: float) -> int:
    """How many instants of a schedule of `rate_hz` lie before `ran_ns` (ns) after its start."""
    count = max(ceil(ran_ns * rate_hz / SECOND), 0)
    while count and instant(0, count - 1, rate_hz) >= ran_ns:
        count -= 1
    while instant(0, count, rate_hz) < ran_ns:
        count += 1
    return count


def holes_of(
    vehicle: str,
    numbers: RecordedNumbers,
    rate_hz: float,
    expected: int,
    kind: HoleKind = "pose",
) -> Iterator[RecordHole]:
    """Give the holes in the record of a vehicle that sends what is counted at `rate_hz`."""
    for first, last in numbers.missing(expected):
        yield RecordHole(
            vehicle=vehicle,
            from_s=instant(0, first, rate_hz) / SECOND,
            to_s=instant(0, last, rate_hz) / SECOND,
            poses=last - first + 1,
            kind=kind,
        )
