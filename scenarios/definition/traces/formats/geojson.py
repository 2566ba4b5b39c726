"""GeoJSON: line strings, or else points in their order."""

import json
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any, Final

from scenarios.definition.traces.formats.cells import PointColumns
from scenarios.definition.traces.recorded_drive import RecordedDrive, TraceError

LINE_TIMES: Final = ("coordTimes", "times", "coordinateTimes")
"""Properties of a line with the times of its positions, also within coordinateProperties."""

TIMES: Final = ("time", "timestamp", "datetime", "utc", "t_s")
SPEEDS: Final = ("speed", "speed_mps", "velocity")
"""Properties of a point."""

Json = Mapping[str, Any]


def read_geojson(text: str) -> RecordedDrive:
    """Read the line strings of a GeoJSON file, or else its points.

    Lines may have times in the property coordTimes, points in time or timestamp.
    """
    lines, points = PointColumns(), PointColumns()
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise TraceError(f"not valid JSON, perhaps truncated: {error}") from error
    for geometry, properties in _geometries(content, {}):
        _add_geometry(geometry, properties, lines, points)
    chosen = lines if lines.times else points
    if not chosen.times:
        raise TraceError("no LineString, MultiLineString or Point with coordinates")
    return chosen.drive()


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
