"""A recorded drive as columns of points, and the records that are left out of it."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

Clock = Literal["unix", "day"]
"""Clock of absolute times: Unix time, or seconds since midnight UTC."""

MOST_KEPT = 10_000
"""Number of records left out that are kept with their places; the others are only counted."""

MOST_LISTED = 10
"""Number of records left out that are listed."""

ALTITUDES_M = (-500.0, 10_000.0)
"""Range of usable altitudes."""

FASTEST = 150.0
"""Speed (m/s) that no car reaches."""

METRES_PER_DEGREE = 111_195.0
"""Length of a degree of latitude on a sphere."""

NO_FIX, DAMAGE, NOT_A_POSITION = "no fix", "damaged", "not a position"
"""Kinds of records left out."""

JUMP, WRONG_TIME = "jump", "wrong time, interpolated"
"""Kinds of faults of records with a usable position; one with a WRONG_TIME is not left out."""

NO_TIMES = "the drive has no times"
"""End of remarks about why a drive has no times."""

UNKNOWN_PLACE = (math.nan, math.nan)


class TraceError(ValueError):
    """An unusable recorded drive, in one line."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A record of a file that is left out of the drive, and why.

    `number` is its place in the file. `kind` is the same for all records of one cause, such as
    "no fix"; `reason` may have the value: "latitude_deg is 'abc'". `time_s` and `position` are
    those of RecordedDrive, NaN if unknown.
    """

    number: int
    kind: str
    reason: str
    time_s: float = math.nan
    position: tuple[float, float] = UNKNOWN_PLACE


@dataclass(slots=True)
class LeftOutRecords:
    """The records left out of a drive: a count of each kind, and the first MOST_KEPT in full.

    Records with a WRONG_TIME are listed among them, although only their time is replaced.
    """

    counts: Counter[str] = field(default_factory=Counter)
    records: list[LeftOut] = field(default_factory=list)

    @property
    def total(self) -> int:
        return self.counts.total()

    def add(self, record: LeftOut) -> None:
        self.counts[record.kind] += 1
        if len(self.records) < MOST_KEPT:
            self.records.append(record)

    def lines(self, unit: str, zero_s: float = 0.0) -> tuple[str, ...]:
        """List up to MOST_LISTED records by place, with times since `zero_s`, and count the rest.

        The first record of each kind is among them. `unit` is that of the drive: "line 12 (3.4 s):
        no fix at 0°/0°".
        """
        ordered = sorted(self.records, key=lambda record: record.number)
        firsts = {record.kind: record for record in reversed(ordered)}
        others = [record for record in ordered if record is not firsts[record.kind]]
        chosen = [*firsts.values(), *others][:MOST_LISTED]
        chosen.sort(key=lambda record: record.number)
        listed = [_line(record, unit, zero_s) for record in chosen]
        more = self.total - len(listed)
        return (*listed, f"and {more} more") if more else tuple(listed)


def _line(record: LeftOut, unit: str, zero_s: float) -> str:
    at = record.time_s - zero_s
    time = f" ({at:.1f} s)" if math.isfinite(at) and abs(at) < 1e7 else ""
    return f"{unit} {record.number}{time}: {record.reason}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedDrive:
    """Points of a file in its order, by columns of the same length n.

    `position` (2, n) is east and north (m), or latitude and longitude (deg) if `geodetic`. It is
    finite. `altitude_m`, `time_s` and `speed_mps` (n,) are NaN where unknown; an unusable value of
    them never removes a point. `numbers` (n,) are the places of the points in the file, in `unit`s
    (line, point, message). With a `clock`, times count from `zero_s` on it. `remarks` state
    assumptions, such as a guessed unit.
    """

    geodetic: bool
    unit: str
    numbers: NDArray[np.int64]
    position: Floats
    altitude_m: Floats
    time_s: Floats
    speed_mps: Floats
    clock: Clock | None = None
    zero_s: float = 0.0
    format_name: str = ""
    left_out: LeftOutRecords = field(default_factory=LeftOutRecords)
    remarks: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """The number of points."""
        return int(self.numbers.size)

    def selected(self, places: NDArray[np.int64] | NDArray[np.bool_]) -> "RecordedDrive":
        """Return the points at these places, in their order, or those that a mask marks."""
        return replace(
            self,
            numbers=self.numbers[places],
            position=self.position[:, places],
            altitude_m=self.altitude_m[places],
            time_s=self.time_s[places],
            speed_mps=self.speed_mps[places],
        )

    def without(
        self, marked: NDArray[np.bool_], kind: str, reason: Callable[[int], str] | None = None
    ) -> "RecordedDrive":
        """Leave out the `marked` points; `reason` returns that of a point by its index."""
        places = np.flatnonzero(marked)
        if not places.size:
            return self
        listed = places[: max(1, MOST_KEPT - len(self.left_out.records))].tolist()
        for k in listed:
            self.list_fault(k, kind, reason(k) if reason else kind)
        self.left_out.counts[kind] += places.size - len(listed)
        return self.selected(~marked)

    def list_fault(self, k: int, kind: str, reason: str) -> None:
        """List point `k` among the records left out."""
        first, second = self.position[:, k].tolist()
        self.left_out.add(
            LeftOut(int(self.numbers[k]), kind, reason, float(self.time_s[k]), (first, second))
        )

    def with_remarks(self, *remarks: str) -> "RecordedDrive":
        return replace(self, remarks=(*self.remarks, *remarks))


# ---- The part of a recorded drive that is driven, and pieces of a drive that can be selected


TOUCH = 1e-6
"""Bounds within this (s or m) of a point include it, as printed values are rounded."""

PATH_KEYS = "path."
"""What the names of the keys that select a part of the lead's drive begin with."""

MOST_BREAKS = 3
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
