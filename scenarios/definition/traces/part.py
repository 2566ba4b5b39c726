"""The part of a recorded drive that is driven, and pieces of a drive that can be selected."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.definition.traces.recorded_drive import NO_TIMES, Floats, TraceError

TOUCH = 1e-6
"""Bounds within this (s or m) of a point include it, as printed values are rounded."""

PATH_KEYS = "path."
"""What the names of the keys that select a part of the lead's drive begin with."""

MOST_LISTED = 3
"""Number of pieces that are listed."""


@dataclass(frozen=True, slots=True)
class DrivenPart:
    """Bounds of a part, in seconds or metres from the first point of the drive; None if open.

    `keys` is what the names of their keys begin with.
    """

    from_s: float | None = None
    to_s: float | None = None
    from_m: float | None = None
    to_m: float | None = None
    keys: str = PATH_KEYS

    @property
    def is_whole(self) -> bool:
        return self == DrivenPart(keys=self.keys)


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
        starts, ends = f"{part.keys}from_{unit}", f"{part.keys}to_{unit}"
        if first is None and last is None:
            continue
        if not values.size:
            key = ends if first is None else starts
            raise PartError(key, f"{NO_TIMES}, use path.from_m and path.to_m")
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


@dataclass(frozen=True, slots=True)
class DrivePiece:
    """A piece of a drive, from point `first` to `last`, and its length (m).

    `begin` and `end` are the times (s) of both since the start of the recorded drive, or without
    times the distances (m) along its points. Unless the drive begins or ends there, they are
    rounded to 0.1 towards the piece.
    """

    first: int
    last: int
    begin: float
    end: float
    length: float


def piece_between(first: int, last: int, axis: Floats, along: Floats) -> DrivePiece:
    """Return the piece from point `first` to `last`, without points beyond its rounded bounds.

    `axis` (n,) are the times (s) or distances (m) of all points, `along` the distances.
    """
    begin, end = float(axis[first]), float(axis[last])
    if first > 0:
        begin = math.ceil(10.0 * begin - TOUCH) / 10.0
        first = int(np.searchsorted(axis, begin - TOUCH))
    if last < axis.size - 1:
        end = math.floor(10.0 * end + TOUCH) / 10.0
        last = int(np.searchsorted(axis, end + TOUCH, side="right")) - 1
    length = float(along[last] - along[first]) if last > first else 0.0
    return DrivePiece(first, last, begin, end, length)


def pieces_in_words(
    pieces: Sequence[DrivePiece], total: int, unit: str, keys: str, last: int
) -> str:
    """List pieces of a drive that ends at point `last`, and the keys that select each.

    `total` pieces exist. Bounds are in `unit`s, the names of their keys begin with `keys`.
    """
    listed = sorted(pieces, key=lambda piece: piece.first)
    places = ", ".join(
        f"{piece.begin:g} to {piece.end:.1f} {unit} ({piece.length:.0f} m)" for piece in listed
    )
    more = f" and {total - len(listed)} more" if total > len(listed) else ""
    choices = ", or ".join(_bounds(piece, unit, keys, last) for piece in listed)
    return f"{places}{more}: set {choices}"


def _bounds(piece: DrivePiece, unit: str, keys: str, last: int) -> str:
    begin = [f"{keys}from_{unit} = {piece.begin:.1f}"] if piece.first > 0 else []
    end = [f"{keys}to_{unit} = {piece.end:.1f}"] if piece.last < last else []
    return " and ".join(begin + end)
