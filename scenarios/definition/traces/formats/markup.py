"""GPX and KML: tracks, routes and lines of positions in degrees."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from typing import Final

from scenarios.definition.traces.formats.point_columns import PointColumns
from scenarios.definition.traces.formats.xml_elements import read_elements
from scenarios.definition.traces.recorded_drive import (
    DAMAGE,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)

VALUES: Final = ("ele", "time", "speed")
"""Elements of a point in GPX; its extensions may have the speed."""

SHAPES: Final = ("Track", "LineString", "LinearRing", "Point")
"""Elements of KML with coordinates; the first that a file has makes the drive."""

COMMA: Final = re.compile(r"\s*,\s*")


def read_gpx(text: str) -> RecordedDrive:
    """Read the tracks of a GPX file, or else its routes, or else its waypoints."""
    kinds = {name: PointColumns() for name in ("trkpt", "rtept", "wpt")}
    left_out = LeftOutRecords()
    place: dict[str, str] = {}
    values: dict[str, str] = {}

    def begin(attributes: dict[str, str]) -> None:
        nonlocal place
        place = attributes
        values.clear()

    def end(points: PointColumns, _: str) -> None:
        known = values.get
        points.add(
            place.get("lat"), place.get("lon"), known("ele"), known("time", ""), known("speed")
        )

    starts = dict.fromkeys(kinds, begin)
    ends: dict[str, Callable[[str], object]] = {
        name: partial(end, points) for name, points in kinds.items()
    }
    ends |= {name: partial(values.setdefault, name) for name in VALUES}
    read_elements(text, starts, ends, lambda reason: _damage(left_out, reason, *kinds.values()))
    points = next((points for points in kinds.values() if points.times), None)
    if points is None:
        raise TraceError(f"no points in its tracks, routes and waypoints{_first(left_out)}")
    return points.drive(left_out)


def read_kml(text: str) -> RecordedDrive:
    """Read the tracks of a KML file, or else its lines, rings or points, in their order."""
    shapes = _Shapes()
    starts = {name: partial(shapes.begin, name) for name in (*SHAPES, "Placemark")}
    ends: dict[str, Callable[[str], object]] = {
        "coordinates": shapes.add_coordinates,
        "when": shapes.whens.append,
        "coord": shapes.coords.append,
        "Track": shapes.end_track,
        "Placemark": shapes.end_placemark,
    }
    read_elements(text, starts, ends, shapes.end_at_damage)
    points = next((points for points in shapes.columns.values() if points.times), None)
    if points is None:
        raise TraceError(f"no coordinates in its lines, tracks and points{_first(shapes.left_out)}")
    return points.drive(shapes.left_out)


@dataclass(slots=True)
class _Shapes:
    """Points of a KML file by shape, and the open shape with its times and places."""

    columns: dict[str, PointColumns] = field(
        default_factory=lambda: {name: PointColumns() for name in SHAPES}
    )
    left_out: LeftOutRecords = field(default_factory=LeftOutRecords)
    opened: str = "LineString"
    whens: list[str] = field(default_factory=list)
    coords: list[str] = field(default_factory=list)

    def begin(self, name: str, _: dict[str, str]) -> None:
        self.opened = name
        if name in {"Track", "Placemark"}:
            self.whens.clear()
            self.coords.clear()

    def add_coordinates(self, text: str) -> None:
        points = self.columns.get(self.opened)
        if points is None:  # of a Placemark
            return
        for word in COMMA.sub(",", text).split():
            _add_word(points, word.split(","))

    def end_track(self, _: str) -> None:
        for when, coord in zip_longest(self.whens, self.coords, fillvalue=""):
            _add_word(self.columns["Track"], coord.split(), when)
        self.whens.clear()
        self.coords.clear()

    def end_placemark(self, _: str) -> None:
        times = self.columns["Point"].times
        if self.whens and times and not times[-1]:
            times[-1] = self.whens[-1]

    def end_at_damage(self, reason: str) -> None:
        del self.whens[len(self.coords) :]
        self.end_track("")
        _damage(self.left_out, reason, *self.columns.values())


def _add_word(points: PointColumns, numbers: list[str], time: str = "") -> None:
    """Add a point with longitude, latitude and perhaps altitude."""
    longitude, latitude, altitude, *_ = *numbers, "", "", ""
    points.add(latitude, longitude, altitude, time)


def _damage(left_out: LeftOutRecords, reason: str, *columns: PointColumns) -> None:
    """List damage behind the points so far."""
    count = next((len(points.times) for points in columns if points.times), 0)
    left_out.add(LeftOut(count + 1, DAMAGE, reason))


def _first(left_out: LeftOutRecords) -> str:
    return f", {left_out.records[0].reason}" if left_out.records else ""
