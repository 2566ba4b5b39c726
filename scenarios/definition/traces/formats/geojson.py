"""GeoJSON: line strings, or else points in their order."""

import json
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.cells import Point, drive_of

LINE_TIMES = ("coordtimes", "times", "coordinatetimes")
"""Properties of a line with the times of its positions, also within coordinateProperties."""

TIMES = ("time", "timestamp", "datetime", "utc", "t_s")
SPEEDS = ("speed", "speed_mps", "velocity")
"""Properties of a point."""

Json = Mapping[str, Any]


def read_geojson(text: str) -> DriveTable:
    """Read the line strings of a GeoJSON file, or else its points.

    Lines may have times in the property coordTimes, points in time or timestamp.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        first = text.lstrip().partition("\n")[0]
        try:  # an object a line
            keys = _keys(json.loads(first))
        except (ValueError, RecursionError):
            raise TraceError(f"not valid JSON, perhaps truncated: {error}") from error
        raise TraceError(f"JSON lines, but not GeoJSON; {keys}") from error
    lines, points = list[Point](), list[Point]()
    for geometry, properties in _geometries(content, {}):
        kind, places = geometry.get("type"), geometry.get("coordinates")
        inner = properties.get("coordinateProperties")
        times = _first(properties, LINE_TIMES) or _first(inner, LINE_TIMES) or []
        if kind == "Point":
            time = _first(properties, TIMES)
            points.append(_point(places, time)._replace(speed=_first(properties, SPEEDS)))
        elif kind == "MultiLineString" and isinstance(places, list):
            nested = times if times and isinstance(times[0], list) else []
            for part, own in zip_longest(places, nested[: len(places)]):
                lines += _line(part, own)
        elif kind in ("LineString", "MultiPoint"):
            (lines if kind == "LineString" else points).extend(_line(places, times))
    if not lines and not points:
        raise TraceError(f"JSON, but no LineString or Point of GeoJSON; {_keys(content)}")
    return drive_of(lines or points)


def _keys(content: object) -> str:
    content = content[0] if isinstance(content, list) and content else content
    return (
        f"keys: {', '.join(list(content)[:8]) or 'none'}"
        if isinstance(content, dict)
        else "no keys"
    )


def _line(places: object, times: object) -> Iterator[Point]:
    if isinstance(places, list):
        known = times[: len(places)] if isinstance(times, list) else []
        yield from (_point(place, time) for place, time in zip_longest(places, known))


def _point(place: object, time: Any) -> Point:
    """Return a point of longitude, latitude and perhaps altitude."""
    numbers = [*place] if isinstance(place, list) else []
    longitude, latitude, altitude, *_ = *numbers, None, None, None
    return Point(latitude, longitude, altitude, "" if time is None else str(time))


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


def _first(properties: object, names: tuple[str, ...]) -> Any:
    """Return the first property of these names in any case."""
    known = properties if isinstance(properties, dict) else {}
    lower = {str(name).lower(): value for name, value in known.items()}
    return next((lower[name] for name in names if name in lower), None)
