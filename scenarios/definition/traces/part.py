"""The part of a recorded drive that is driven."""

from dataclasses import dataclass

import numpy as np

from scenarios.definition.traces.recorded_drive import Floats, TraceError

TOUCH = 1e-6
"""Bounds within this (s or m) of a point include it, as printed values are rounded."""


@dataclass(frozen=True, slots=True)
class DrivenPart:
    """Bounds of a part, in seconds or metres from the first point of the drive; None if open."""

    from_s: float | None = None
    to_s: float | None = None
    from_m: float | None = None
    to_m: float | None = None

    @property
    def is_whole(self) -> bool:
        return self == DrivenPart()


class PartError(TraceError):
    """A part that a drive does not have; `key` is the bound in question."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


def points_within(part: DrivenPart, time_s: Floats, distance_m: Floats) -> slice:
    """Return the points within `part`; raises PartError.

    `time_s` (n,), empty without times, and `distance_m` (n,) count from the first point.
    """
    begin, end = 0, int(distance_m.size)
    for key, bound in (("from_s", part.from_s), ("to_s", part.to_s)):
        if bound is not None and not time_s.size:
            raise PartError(key, "the drive has no times, use path.from_m and path.to_m")
    for key, bound, values in (
        ("from_s", part.from_s, time_s),
        ("from_m", part.from_m, distance_m),
    ):
        if bound is None:
            continue
        begin = max(begin, int(np.searchsorted(values, bound - TOUCH)))
        if end - begin < 2:
            whole = f"{values[-1]:.1f} {key[-1]}"
            raise PartError(key, f"given {bound:g}, allowed less than the drive's {whole}")
    ends = ("to_s", part.to_s, time_s), ("to_m", part.to_m, distance_m)
    for key, bound, values in ends:
        if bound is None:
            continue
        end = min(end, int(np.searchsorted(values, bound + TOUCH, side="right")))
        if end - begin < 2:
            start = f"{values[begin]:.1f} {key[-1]}, where the part starts"
            raise PartError(key, f"given {bound:g}, allowed more than {start}")
    return slice(begin, end)
