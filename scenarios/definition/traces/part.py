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
    for unit, first, last, values in (
        ("s", part.from_s, part.to_s, time_s),
        ("m", part.from_m, part.to_m, distance_m),
    ):
        starts, ends = f"from_{unit}", f"to_{unit}"
        if first is None and last is None:
            continue
        if not values.size:
            key = ends if first is None else starts
            raise PartError(key, "the drive has no times, use path.from_m and path.to_m")
        if first is not None:
            begin = max(begin, int(np.searchsorted(values, first - TOUCH)))
            if end - begin < 2:
                drive = f"the drive's {values[-1]:.1f} {unit}"
                raise PartError(starts, f"given {first:g}, allowed less than {drive}")
        if last is not None:
            end = min(end, int(np.searchsorted(values, last + TOUCH, side="right")))
            if end - begin < 2:
                start = f"{max(first or 0.0, float(values[0])):g} {unit}, where the part starts"
                raise PartError(ends, f"given {last:g}, allowed more than {start}")
    return slice(begin, end)
