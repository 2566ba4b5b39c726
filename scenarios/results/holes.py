"""Missing poses in the log: gaps in the numbers of a vehicle's poses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Literal

from transport.codec import MAX_RANGES
from vehicles.schedule import SECOND, instant

HoleKind = Literal["pose", "true pose"]
RecordKind = Literal["true pose", "decision"]
"""Messages of which figures, events and limits are made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordHole:
    """Consecutive poses of a vehicle that are due and missing in the log.

    `from_s` and `to_s` are the instants of the first and the last of them; without a schedule of
    sending those of the poses before and after. A hole of "true pose"s is one of the poses of which
    the figures are made, while other poses were recorded.
    """

    vehicle: str
    """Vehicle with a gap in the recording: poses were sent and not recorded. All figures are of
    recorded messages."""
    from_s: float
    """Instant of the first missing pose; without a schedule of sending, of the pose before."""
    to_s: float
    """Instant of the last missing pose; without a schedule, of the pose after."""
    poses: int
    """Number of missing poses."""
    kind: HoleKind = "pose"
    """pose; or true pose, where poses were recorded meanwhile."""

    def covers(self, other: "RecordHole", slack_s: float) -> bool:
        """Whether another hole lies within this one, up to `slack_s` (s) at each end."""
        return other.from_s >= self.from_s - slack_s and other.to_s <= self.to_s + slack_s


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenSpan:
    """Time in which nothing is known of a vehicle: messages of a kind are missing in the log.

    `from_s` and `to_s` are the instants of the messages before and after; `missing_s` is the time
    that the missing ones cover.
    """

    vehicle: str
    kind: RecordKind
    from_s: float
    to_s: float
    missing_s: float


@dataclass(slots=True)
class _NumberHole:
    """Missing numbers, and the instants (ns) of the messages before and after."""

    first: int
    last: int
    from_at: int
    to_at: int


class RecordedSeries:
    """Messages of one kind of a vehicle: their last instant, and the holes between them."""

    def __init__(self) -> None:
        self._next = self.received = 0
        self.last_at: int | None = None
        self._holes: list[_NumberHole] = []

    @property
    def count(self) -> int:
        """Messages up to the newest one, received or missing."""
        return self._next

    def add(self, number: int, at: int) -> None:
        """Take the number of a message and its instant (ns)."""
        self.received += 1
        if number == self._next:  # the usual case
            self._next += 1
            self.last_at = at
        elif number > self._next:
            if len(self._holes) < MAX_RANGES:
                before = at if self.last_at is None else self.last_at
                self._holes.append(_NumberHole(self._next, number - 1, before, at))
            self._next, self.last_at = number + 1, at
        else:
            self._fill(number, at)

    def _fill(self, number: int, at: int) -> None:
        """Take a message that is out of order."""
        for place, hole in enumerate(self._holes):
            if hole.first <= number <= hole.last:
                parts = [
                    _NumberHole(hole.first, number - 1, hole.from_at, at),
                    _NumberHole(number + 1, hole.last, at, hole.to_at),
                ]
                self._holes[place : place + 1] = [part for part in parts if part.first <= part.last]
                return

    def missing(self, expected: int) -> Iterator[tuple[int, int]]:
        """Yield the first and the last number of each hole, up to `expected` numbers."""
        yield from ((hole.first, hole.last) for hole in self._holes)
        if expected > self._next:
            yield self._next, expected - 1

    def spans(self, expected: int, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Yield the instants (ns) of the messages around each hole, and the number missing.

        A hole at the begin or, up to `expected` numbers, at the end reaches to `begin` or `end`.
        """
        for hole in self._holes:
            before = hole.from_at if hole.first else begin
            yield before, hole.to_at, hole.last - hole.first + 1
        if expected > self._next:
            yield begin if self.last_at is None else self.last_at, end, expected - self._next

    def unscheduled_holes(self, vehicle: str, start_at: int) -> Iterator[RecordHole]:
        """Yield the holes of a vehicle without a schedule in a run from `start_at` (ns)."""
        for before, after, count in self.spans(0, start_at, start_at):
            yield RecordHole(
                vehicle=vehicle,
                from_s=(before - start_at) / SECOND,
                to_s=(after - start_at) / SECOND,
                poses=count,
            )

    def seen_before(self, at: int, start_at: int) -> int | None:
        """Instant (ns) before the hole that ends at `at` or later, None if it lies in no hole."""
        for begin, end, _ in self.spans(0, start_at, start_at):
            if begin < at <= end:
                return begin
        return None

    def unseen(self, vehicle: str, kind: RecordKind, start_at: int) -> Iterator[UnseenSpan]:
        """Yield the holes in a run from `start_at` (ns), without its end."""
        for hole, (begin, end, count) in zip(
            self._holes, self.spans(0, start_at, start_at), strict=True
        ):
            span = (end - begin) / SECOND
            yield UnseenSpan(
                vehicle=vehicle,
                kind=kind,
                from_s=(begin - start_at) / SECOND,
                to_s=(end - start_at) / SECOND,
                missing_s=span * count / (count + 1) if hole.first else span,
            )


def hole_lines(holes: Sequence[RecordHole], most: int) -> Iterator[str]:
    """Yield up to `most` lines about missing poses, one for equal holes of several vehicles."""
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


def expected_poses(ran_ns: int, rate_hz: float) -> int:
    """Count the instants of a schedule of `rate_hz` in the first `ran_ns` (ns)."""
    count = max(ceil(ran_ns * rate_hz / SECOND), 0)
    while count and instant(0, count - 1, rate_hz) >= ran_ns:
        count -= 1
    while instant(0, count, rate_hz) < ran_ns:
        count += 1
    return count


def holes_of(
    vehicle: str,
    numbers: RecordedSeries,
    rate_hz: float,
    expected: int,
    kind: HoleKind = "pose",
) -> Iterator[RecordHole]:
    """Yield the holes in the record of a vehicle that sends at `rate_hz`."""
    for first, last in numbers.missing(expected):
        yield RecordHole(
            vehicle=vehicle,
            from_s=instant(0, first, rate_hz) / SECOND,
            to_s=instant(0, last, rate_hz) / SECOND,
            poses=last - first + 1,
            kind=kind,
        )
