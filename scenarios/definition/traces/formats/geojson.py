"""GeoJSON: line strings, or else points in their order."""

import contextlib
import json
import re
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any, Final

from scenarios.definition.traces.formats.point_columns import PointColumns
from scenarios.definition.traces.recorded_drive import (
    DAMAGE,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)

LINE_TIMES: Final = ("coordTimes", "times", "coordinateTimes")
"""Properties of a line with the times of its positions, also within coordinateProperties."""

TIMES: Final = ("time", "timestamp", "datetime", "utc", "t_s")
SPEEDS: Final = ("speed", "speed_mps", "velocity")
"""Properties of a point."""

BEGIN: Final = re.compile(r"[{\[]")

MOST_DAMAGES: Final = 20
"""Number of damaged places behind which reading goes on."""

TOKENS: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]')
CLOSING: Final = {"[": "]", "{": "}"}

Json = Mapping[str, Any]


def read_geojson(text: str) -> RecordedDrive:
    """Read the line strings of a GeoJSON file, or else its points.

    Lines may have times in the property coordTimes, points in time or timestamp.
    """
    left_out = LeftOutRecords()
    lines, points = PointColumns(), PointColumns()
    for document, damage in _documents(text):
        for geometry, properties in _geometries(document, {}):
            _add_geometry(geometry, properties, lines, points)
        if damage:
            number = max(len(lines.times), len(points.times)) + 1
            left_out.add(LeftOut(number, DAMAGE, damage))
    chosen = lines if lines.times else points
    if not chosen.times:
        damages = [record.reason for record in left_out.records[:1]]
        raise TraceError(
            (damages or ["no LineString, MultiLineString or Point with coordinates"])[0]
        )
    return chosen.drive(left_out)


def _add_geometry(
    geometry: Json, properties: Json, lines: PointColumns, points: PointColumns
) -> None:
    kind, places = geometry.get("type"), geometry.get("coordinates")
    if kind == "LineString":
        _add_line(lines, places, _line_times(properties))
    elif kind == "MultiLineString":
        times = _line_times(properties)
        parts = places if isinstance(places, list) else []
        own = times if times and isinstance(times[0], list) else []
        for k, part in enumerate(parts):
            _add_line(lines, part, own[k] if k < len(own) else [])
    elif kind == "Point":
        time, speed = _first(properties, TIMES), _first(properties, SPEEDS)
        _add(points, places, _text(time), speed)
    elif kind == "MultiPoint":
        _add_line(points, places, _line_times(properties))


def _documents(text: str) -> Iterator[tuple[Any, str]]:
    """Yield the values in a text, usually a single one, and the damage that ends each, or "".

    A sequence of features has many.
    """
    decode, begin, damages = json.JSONDecoder().raw_decode, BEGIN.search(text), 0
    while begin and damages <= MOST_DAMAGES:
        damage = ""
        try:
            value, end = decode(text, begin.start())
        except (ValueError, RecursionError) as error:
            end = max(getattr(error, "pos", len(text)), begin.end())
            damage, damages = f"not valid JSON, perhaps truncated: {error}", damages + 1
            value = None
            if isinstance(error, ValueError):
                value = _closed(text[begin.start() : end])
        yield value, damage
        begin = BEGIN.search(text, end)


def _closed(text: str) -> Any:
    """Return the value of a truncated text up to its last complete list or object."""
    open_: list[str] = []
    cut, depth = 0, 0
    for token in TOKENS.finditer(text):
        sign = token[0]
        if sign in CLOSING:
            open_.append(CLOSING[sign])
        elif open_ and sign == open_[-1]:
            open_.pop()
            cut, depth = token.end(), len(open_)
    with contextlib.suppress(ValueError, RecursionError):
        return json.loads(text[:cut] + "".join(reversed(open_[:depth])))
    return None


def _geometries(content: object, properties: Json) -> Iterator[tuple[Json, Json]]:
    """Yield the geometries of features and collections, with the properties of their feature."""
    if isinstance(content, list):
        for item in content:
            yield from _geometries(item, properties)
    elif isinstance(content, dict):
        own = content.get("properties")
        properties = own if isinstance(own, dict) else properties
        for key in ("features", "geometry", "geometries", "locations"):
            if key in content:
                yield from _geometries(content[key], properties)
        if "coordinates" in content:
            yield content, properties


def _line_times(properties: Json) -> list[Any]:
    inner = properties.get("coordinateProperties")
    for source in (properties, inner if isinstance(inner, dict) else {}):
        times = _first(source, LINE_TIMES)
        if isinstance(times, list):
            return times
    return []


def _first(properties: Json, names: tuple[str, ...]) -> Any:
    """Return the first property of these names in any case."""
    lower = {str(name).lower(): value for name, value in properties.items()}
    return next((lower[name.lower()] for name in names if name.lower() in lower), None)


def _add_line(columns: PointColumns, places: object, times: list[Any]) -> None:
    if not isinstance(places, list):
        return
    for place, time in zip_longest(places, times[: len(places)]):
        _add(columns, place, _text(time), None)


def _add(columns: PointColumns, place: object, time: str, speed: Any) -> None:
    """Add a position of longitude, latitude and perhaps altitude."""
    numbers = [*place] if isinstance(place, list) else []
    longitude, latitude, altitude, *_ = *numbers, None, None, None
    columns.add(latitude, longitude, altitude, time, speed)


def _text(value: object) -> str:
    return "" if value is None else str(value)
