"""Removal of jumps, standstills and leaps in time from a recorded drive."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.old_formats import RecordedPoint
from scenarios.definition.traces.receiver_errors.jumps import Jump, JumpFinder
from scenarios.definition.traces.receiver_errors.stands import FEWEST, Stand, stands_in
from vehicles.geometry.bridges import noise_deviation

Floats = NDArray[np.float64]

LEAP = 86_400.0
"""Step in time (s), forward or back, that is no pause of a drive."""

MOST_LEAPING = 0.25
"""Largest share of points that is removed; with more the drive consists of several parts."""


@dataclass(slots=True)
class Cleaned:
    """Numbers of the kept points, their positions (m, shape (2, n)), jumps and standstills.

    A standstill becomes two points at one place; one point before the first movement or after the
    last. `noise` is the standard deviation (m, per axis) of white noise, or of drift at standstill.
    """

    kept: NDArray[np.int64]
    points: Floats
    noise: float = 0.0
    jumps: list[Jump] = field(default_factory=list)
    stands: list[Stand] = field(default_factory=list)


def cleaned(points: Floats, times: Sequence[float] | Floats, time_error_s: float = 0.0) -> Cleaned:
    """Remove jumps and standstills from `points` (2, n) with `times` (s), empty if unknown.

    Times are late by 0 to `time_error_s`.
    """
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(np.arange(count), points)
    track = JumpFinder(points, times, time_error_s)
    jumps = track.without_jumps()
    left = track.kept
    stands = [
        replace(
            one,
            first=int(left[one.first]),
            last=int(left[one.last]),
            core=(int(left[one.core[0]]), int(left[one.core[1]])),
        )
        for one in stands_in(points[:, left], track.at[left], timed=len(times) > 0)
    ]
    noise = max([noise_deviation(points[:, left]), *(stand.wander for stand in stands)])
    places = points.copy()
    is_kept = np.zeros(count, dtype=bool)
    is_kept[left] = True
    for stand in stands:
        starts, stops = stand.first == left[0], stand.last == left[-1]
        begun, ended = stand.core
        ends = [ended] if starts else [begun] if stops or begun == ended else [begun, ended]
        is_kept[stand.first : stand.last + 1] = False
        is_kept[ends] = True
        places[:, ends] = np.array(stand.place)[:, None]
    kept = np.flatnonzero(is_kept)
    return Cleaned(kept, places[:, kept], noise, jumps, stands)


def without_leaps(points: Sequence[RecordedPoint]) -> tuple[list[RecordedPoint], list[str]]:
    """Remove points whose time is more than LEAP off; returns the others, and a note for each.

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
    edges = [k for k in range(1, len(times)) if not abs(times[k] - times[k - 1]) <= LEAP]
    return [range(a, b) for a, b in zip([0, *edges], [*edges, len(times)], strict=True)]


def _continuing(parts: Sequence[range], last: int, times: Sequence[float]) -> list[int]:
    """Return the points of the parts that continue from point `last`."""
    result: list[int] = []
    for part in parts:
        if abs(times[part[0]] - times[last]) <= LEAP:
            result += part
            last = part[-1]
    return result
