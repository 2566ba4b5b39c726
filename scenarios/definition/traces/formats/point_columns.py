"""Columns of positions in degrees that grow point by point."""

import math
from array import array
from dataclasses import dataclass, field

import numpy as np

from scenarios.definition.traces.formats.time_cells import TimeColumn, as_number, read_times
from scenarios.definition.traces.recorded_drive import (
    NOT_A_POSITION,
    Floats,
    LeftOutRecords,
    RecordedDrive,
)

Cell = str | float | None
"""A number, or its text; None or empty if it is missing."""


def _doubles() -> "array[float]":
    return array("d")


@dataclass(frozen=True, slots=True)
class PointColumns:
    """Points of a file by columns; `unusable` has the reasons of those without a position."""

    latitude: "array[float]" = field(default_factory=_doubles)
    longitude: "array[float]" = field(default_factory=_doubles)
    altitude: "array[float]" = field(default_factory=_doubles)
    speed: "array[float]" = field(default_factory=_doubles)
    times: list[str] = field(default_factory=list)
    unusable: dict[int, str] = field(default_factory=dict)

    def add(
        self,
        latitude: Cell,
        longitude: Cell,
        altitude: Cell = None,
        time: str = "",
        speed: Cell = None,
    ) -> None:
        try:
            north, east = float(latitude), float(longitude)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            north, east = _number(latitude), _number(longitude)
        if not math.isfinite(north + east):
            name, cell = (
                ("longitude", longitude) if math.isfinite(north) else ("latitude", latitude)
            )
            missing = cell is None or cell == ""
            self.unusable[len(self.times)] = f"no {name}" if missing else f"{name} is {cell!r:.30}"
        self.latitude.append(north)
        self.longitude.append(east)
        self.altitude.append(math.nan if altitude is None else _number(altitude))
        self.speed.append(math.nan if speed is None else _number(speed))
        self.times.append(time)

    def drive(self, left_out: LeftOutRecords | None = None, unit: str = "point") -> RecordedDrive:
        """Return the drive, without the unusable points."""
        count = len(self.times)
        times = TimeColumn(np.full(count, math.nan), None, 0.0, ())
        if any(self.times):
            times = read_times(self.times)
        drive = RecordedDrive(
            geodetic=True,
            unit=unit,
            numbers=np.arange(1, count + 1),
            position=np.array((self.latitude, self.longitude)),
            altitude_m=_known(self.altitude),
            time_s=times.seconds,
            speed_mps=_known(self.speed),
            clock=times.clock,
            zero_s=times.zero_s,
            left_out=left_out or LeftOutRecords(),
            remarks=times.remarks,
        )
        marked = np.zeros(count, dtype=bool)
        marked[list(self.unusable)] = True
        return drive.without(marked, NOT_A_POSITION, self.unusable.__getitem__)


def _number(cell: Cell) -> float:
    """Return the number of a cell, NaN if there is none."""
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return as_number(str(cell))


def _known(values: "array[float]") -> Floats:
    known = np.array(values)
    known[~np.isfinite(known)] = math.nan
    return known
