"""Times that leap: those of a receiver before its first fix, or of single records."""

from collections.abc import Sequence

from scenarios.definition.traces.formats import RecordedPoint

LEAP = 86_400.0
"""A step in time of more than this (s), forward or back, is no pause in a drive."""

MOST_LEAPING = 0.25
"""More than this share of all points is not left out: the drive then consists of several parts."""


def without_leaps(points: Sequence[RecordedPoint]) -> tuple[list[RecordedPoint], list[str]]:
    """Leave out points whose time is more than LEAP off, and list them.

    The longest part of the record without a leap is kept, and the parts that continue it.
    """
    times = [point.time for point in points if point.time is not None]
    everything = list(points), list[str]()
    if len(times) < len(points):
        return everything
    parts = _parts(times)
    longest = max(parts, key=len)
    place = parts.index(longest)
    before = _continuing([part[::-1] for part in reversed(parts[:place])], longest[0], times)
    after = _continuing(parts[place + 1 :], longest[-1], times)
    kept = sorted([*before, *longest, *after])
    left_out = sorted(set(range(len(points))) - set(kept))
    if len(left_out) > MOST_LEAPING * len(points):
        return everything
    notes = []
    for k in left_out:
        nearest = min((kept[0], kept[-1]), key=lambda other: abs(times[other] - times[k]))
        apart = times[k] - times[nearest]
        side = "after the last" if apart > 0.0 else "before the first"
        notes.append(f"{points[k].place}: its time is {abs(apart):.6g} s {side} of the drive")
    return [points[k] for k in kept], notes


def _parts(times: Sequence[float]) -> list[range]:
    """Numbers of the points of each part that has no leap."""
    edges = [k for k in range(1, len(times)) if not abs(times[k] - times[k - 1]) <= LEAP]
    return [range(a, b) for a, b in zip([0, *edges], [*edges, len(times)], strict=True)]


def _continuing(parts: Sequence[range], last: int, times: Sequence[float]) -> list[int]:
    """Points of the parts, in order away from point `last`, that follow one another."""
    found: list[int] = []
    for part in parts:
        if abs(times[part[0]] - times[last]) <= LEAP:
            found += part
            last = part[-1]
    return found
