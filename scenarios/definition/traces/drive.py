"""A recorded drive as one table of positions by time, and the records that are left out of it."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenarios.definition.schema.path_tables import PointsPath

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

Clock = Literal["unix", "day"]
"""Clock of absolute times: Unix time, or seconds since midnight UTC."""

KEPT_MAX, LISTED_MAX = 10_000, 10
"""Number of records left out that are kept with their places, and number of those listed."""

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


class TraceError(ValueError):
    """An unusable recorded drive, in one line."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A record left out of the drive: its number in the file, kind of fault and reason.

    `time_s` and `position` are those of DriveTable, NaN if unknown.
    """

    number: int
    kind: str
    reason: str
    time_s: float = math.nan
    position: tuple[float, float] = (math.nan, math.nan)


@dataclass(slots=True)
class LeftOutRecords:
    """The records left out of a drive: a count of each kind, and the first KEPT_MAX in full.

    Records with a WRONG_TIME are listed among them, although only their time is replaced.
    """

    counts: Counter[str] = field(default_factory=Counter)
    records: list[LeftOut] = field(default_factory=list)

    def add(self, record: LeftOut) -> None:
        self.counts[record.kind] += 1
        if len(self.records) < KEPT_MAX:
            self.records.append(record)

    def lines(self, unit: str, zero_s: float = 0.0) -> tuple[str, ...]:
        """List up to LISTED_MAX records by number, with times since `zero_s`, and count the rest.

        The first record of each kind is among them: "line 12 (3.4 s): no fix at 0°/0°".
        """
        ordered = sorted(self.records, key=lambda record: record.number)
        firsts = {record.kind: record for record in reversed(ordered)}
        others = [record for record in ordered if record is not firsts[record.kind]]
        chosen = sorted([*firsts.values(), *others][:LISTED_MAX], key=lambda one: one.number)
        listed = []
        for record in chosen:
            at = record.time_s - zero_s
            time = f" ({at:.1f} s)" if abs(at) < 1e7 else ""
            listed.append(f"{unit} {record.number}{time}: {record.reason}")
        more = self.counts.total() - len(listed)
        return (*listed, f"and {more} more") if more else tuple(listed)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveTable:
    """Points of a file in its order, by columns of the same length n.

    `position` (2, n) is east and north (m), or latitude and longitude (deg) if `geodetic`. It is
    finite. `altitude_m`, `time_s` and `speed_mps` (n,) are NaN where unknown; an unusable value of
    them never removes a point. `numbers` (n,) are the places of the points in the file, in `unit`s
    (line, point, message). With a `clock`, times count from `zero_s` on it. `remarks` state
    assumptions, such as a guessed unit.
    """

    geodetic: bool
    unit: str
    numbers: Ints
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
        return int(self.numbers.size)

    @property
    def times(self) -> Floats:
        """Times (s) of all points, empty if one has none."""
        return np.zeros(0) if bool(np.isnan(self.time_s).any()) else self.time_s

    @property
    def plane_m(self) -> Floats:
        """Positions (2, n) in m, exact enough to compare distances of up to some kilometres."""
        if not self.geodetic:
            return self.position
        latitude, longitude = self.position
        middle = longitude[longitude.size // 2 :][:1]
        east = (longitude - middle + 180.0) % 360.0 - 180.0
        shrunk = np.cos(np.radians(np.median(latitude))) if latitude.size else 1.0
        return METRES_PER_DEGREE * np.array((east * shrunk, latitude))

    def selected(self, places: Ints | Mask) -> "DriveTable":
        """Return the points at these places, in their order, or those that a mask marks."""
        return replace(
            self,
            numbers=self.numbers[places],
            position=self.position[:, places],
            altitude_m=self.altitude_m[places],
            time_s=self.time_s[places],
            speed_mps=self.speed_mps[places],
        )

    def without(self, marked: Mask, kind: str, reason: Callable[[int], str]) -> "DriveTable":
        """Leave out the `marked` points; `reason` returns that of a point by its index."""
        places = np.flatnonzero(marked)
        listed = places[: max(1, KEPT_MAX - len(self.left_out.records))].tolist()
        for k in listed:
            self.list_fault(k, kind, reason(k))
        if len(listed) < places.size:
            self.left_out.counts[kind] += places.size - len(listed)
        return self.selected(~marked) if places.size else self

    def list_fault(self, k: int, kind: str, reason: str) -> None:
        """List point `k` among the records left out."""
        first, second = self.position[:, k].tolist()
        place = first, second
        self.left_out.add(LeftOut(int(self.numbers[k]), kind, reason, float(self.time_s[k]), place))

    def with_remarks(self, *remarks: str) -> "DriveTable":
        return replace(self, remarks=(*self.remarks, *remarks))


def runs_of(marked: Mask) -> Iterator[tuple[int, int]]:
    """Yield the first and the last place of each run of marked places."""
    edges = np.flatnonzero(np.diff(marked, prepend=False, append=False)).tolist()
    yield from ((begin, end - 1) for begin, end in zip(edges[::2], edges[1::2], strict=True))


# ---- The part of a recorded drive that is driven


TOUCH = 1e-6
"""Bounds within this (s or m) of a point include it, as printed values are rounded."""

PATH_KEYS = "path."
"""What the names of the keys that select a part of the lead's drive begin with."""

PARTS_MAX = 3
"""Number of parts that are listed."""


class PartError(TraceError):
    """A part that a drive does not have; `key` is the bound in question."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


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

    def points(self, time_s: Floats, distance_m: Floats) -> slice:
        """Return the points within the part; raises PartError.

        `time_s` (n,), empty without times, and `distance_m` (n,) count from the first point.
        """
        begin, end = 0, int(distance_m.size)
        for unit, first, last, values in (
            ("s", self.from_s, self.to_s, time_s),
            ("m", self.from_m, self.to_m, distance_m),
        ):
            starts, ends = f"{self.keys}from_{unit}", f"{self.keys}to_{unit}"
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
                    start = f"{max(first or 0.0, float(values[0])):g} {unit}"
                    why = f"given {last:g}, allowed more than {start}, where the part starts"
                    raise PartError(ends, why)
        return slice(begin, end)


def listed_parts(
    runs: Sequence[tuple[int, int]], axis: Floats, along: Floats, unit: str, keys: str
) -> str:
    """List the longest of the parts from a first to a last point, and the keys that select each.

    `axis` (n,) are the times or distances of all points in `unit`s, `along` the distances (m).
    Bounds within the drive are rounded to 0.1 towards the part.
    """
    longest = sorted(runs, key=lambda run: along[run[0]] - along[run[1]])[:PARTS_MAX]
    places, choices = [], []
    for first, last in sorted(longest):
        begin, end = bounds(first, last, axis)
        starts = [f"{keys}from_{unit} = {begin:.1f}"] if first > 0 else []
        ends = [f"{keys}to_{unit} = {end:.1f}"] if last < axis.size - 1 else []
        length = along[last] - along[first]
        places.append(f"{begin:g} to {end:.1f} {unit} ({length:.0f} m)")
        choices.append(" and ".join(starts + ends))
    more = f" and {len(runs) - len(longest)} more" if len(runs) > len(longest) else ""
    return f"{', '.join(places)}{more}: set {', or '.join(choices)}"


def bounds(first: int, last: int, axis: Floats) -> tuple[float, float]:
    begin, end = float(axis[first]), float(axis[last])
    begin = math.ceil(10.0 * begin - TOUCH) / 10.0 if first > 0 else begin
    return begin, math.floor(10.0 * end + TOUCH) / 10.0 if last < axis.size - 1 else end


def recorded_times(table: PointsPath, points: ArrayLike | None = None) -> Floats:
    """Return the times (s) of points since the start of the recorded drive, pauses included.

    By default of all points. A pause follows the point of the same place in `pause_points`.
    """
    places = np.arange(len(table.time_s)) if points is None else np.asarray(points)
    times = table.begin_s + np.asarray(table.time_s)[places]
    if table.pauses == "cut":
        lost = np.concatenate((np.zeros(1), np.cumsum(table.pause_lost_s)))
        times = times + lost[np.searchsorted(table.pause_points, places)]
    return np.asarray(times)
