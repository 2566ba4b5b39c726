"""A recorded drive as columns of points, and the records that are left out of it."""

import math
from collections import Counter
from collections.abc import Callable
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
