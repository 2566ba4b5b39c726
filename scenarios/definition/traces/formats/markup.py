"""XML files: GPX, KML, and the floating car data of SUMO."""

import re
from collections.abc import Iterator
from itertools import zip_longest
from xml.etree.ElementTree import ParseError, XMLParser

from scenarios.definition.traces.drive import (
    DAMAGE,
    DriveTable,
    LeftOut,
    LeftOutRecords,
    TraceError,
)
from scenarios.definition.traces.formats.cells import Point, chosen_vehicle, drive_of

CHUNK = 1_000_000
"""Number of characters that are parsed at a time."""

NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f]|<!DOCTYPE[^>\\[]*(\\[[^\\]]*\\])?[^>]*>")
NOT_AN_ENTITY = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)")
"""A sign & that begins none of the entities of XML itself: no others are expanded."""

PREFIX = re.compile(r"(</?|\s)(?!xml)[A-Za-z][\w.-]*:(?=[\w.-]+[\s/>=])")
"""Prefix of a namespace, in a tag or an attribute."""

SHAPES = ("Track", "LineString", "LinearRing", "Point")
"""Elements of KML with coordinates; the first that a file has makes the drive."""

VALUES = ("ele", "time", "speed")
"""Elements of a point in GPX; its extensions may have the speed."""


def read_gpx(text: str) -> DriveTable:
    """Read the tracks of a GPX file, or else its routes, or else its waypoints."""
    kinds: dict[str, list[Point]] = {"trkpt": [], "rtept": [], "wpt": []}
    damage, place, values = list[str](), dict[str, str](), dict[str, str]()
    for name, attributes, content in _elements(text, damage):
        if name not in kinds:
            if attributes is None and name in VALUES:
                values[name] = content
        elif attributes is not None:
            place, values = attributes, {}
        else:
            cells = place.get("lat"), place.get("lon"), values.get("ele")
            kinds[name].append(Point(*cells, values.get("time", ""), values.get("speed")))
    return _drive(kinds, damage, "no points in its tracks, routes and waypoints")


def read_kml(text: str) -> DriveTable:
    """Read the tracks of a KML file, or else its lines, rings or points, in their order."""
    shapes: dict[str, list[Point]] = {name: [] for name in SHAPES}
    damage, opened = list[str](), "LineString"
    whens, coords = list[str](), list[list[str]]()
    for name, attributes, content in _elements(text, damage):
        if attributes is not None:
            opened = name if name in SHAPES else opened
        elif name == "when":
            whens.append(content)
        elif name == "coord":
            coords.append(content.split())
        elif name == "coordinates":
            words = re.sub(r"\s*,\s*", ",", content).split()
            shapes[opened] += [_point(word.split(",")) for word in words]
        elif name in ("Track", "Placemark"):
            points = shapes["Point"]
            if name == "Track":
                shapes[name] += _track(coords, whens)
            elif whens and points and not points[-1].time:
                points[-1] = points[-1]._replace(time=whens[-1])
            whens, coords = [], []
    shapes["Track"] += _track(coords, whens[: len(coords)])  # damaged
    return _drive(shapes, damage, "no coordinates in its lines, tracks and points")


def _track(coords: list[list[str]], whens: list[str]) -> Iterator[Point]:
    yield from (_point(coord or [], when or "") for coord, when in zip_longest(coords, whens))


def read_fcd(text: str, vehicle: str | None = None) -> DriveTable:
    """Read a vehicle of the floating car data of SUMO; geodetic output has longitudes as x."""
    names, points, damage, time = list[str](), list[Point](), list[str](), ""
    for name, attributes, _ in _elements(text, damage):
        if attributes is not None and name == "timestep":
            time = attributes.get("time", "")
        elif attributes is not None and name in ("vehicle", "person"):
            value = attributes.get
            names.append(value("id", ""))
            points.append(Point(value("x"), value("y"), value("z"), time, value("speed")))
    chosen = chosen_vehicle(names, vehicle)
    mine = [point for name, point in zip(names, points, strict=True) if name == chosen]
    return _drive({"vehicle": mine}, damage, "no vehicles", geodetic=False)


class _Events:
    """Collects the starts of elements with their attributes, and their ends with their text."""

    def __init__(self) -> None:
        self.found: list[tuple[str, dict[str, str] | None, str]] = []
        self._texts: list[str] = []
        self.data = self._texts.append

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self._texts.clear()
        self.found.append((name, attributes, ""))

    def end(self, name: str) -> None:
        self.found.append((name, None, "".join(self._texts)))


def _elements(text: str, damage: list[str]) -> Iterator[tuple[str, dict[str, str] | None, str]]:
    """Yield local name, attributes and text at each start, and without attributes at each end.

    Prefixes of namespaces need no declaration. The first damage ends the file, and is added in a
    line.
    """
    text = NOT_AN_ENTITY.sub("&amp;", NOT_XML.sub(lambda m: "\n" * m[0].count("\n"), text))
    text = PREFIX.sub(r"\1", text[max(0, text.find("<")) :])
    text = re.sub(r"\A<\?xml[^>]*\?>", "", text)  # whatever encoding it declares
    text = re.sub(r"\sxmlns\s*=\s*(\"[^\"]*\"|'[^']*')", "", text)
    events = _Events()
    parser = XMLParser(target=events)  # noqa: S314 - declarations of entities are removed
    try:
        for begin in range(0, len(text), CHUNK):
            parser.feed(text[begin : begin + CHUNK])
            yield from events.found
            events.found.clear()
        parser.close()
    except ParseError as error:
        yield from events.found
        damage.append(f"damaged XML at line {error.position[0]}: {str(error).partition(':')[0]}")


def _point(numbers: list[str], time: str = "") -> Point:
    """Return a point of longitude, latitude and perhaps altitude."""
    longitude, latitude, altitude, *_ = *numbers, "", "", ""
    return Point(latitude, longitude, altitude, time)


def _drive(
    kinds: dict[str, list[Point]], damage: list[str], nothing: str, *, geodetic: bool = True
) -> DriveTable:
    """Return the drive of the first kind of points, with damage behind them."""
    points = next(filter(None, kinds.values()), None)
    if points is None:
        raise TraceError(", ".join((nothing, *damage)))
    left_out = LeftOutRecords()
    for reason in damage:
        left_out.add(LeftOut(len(points) + 1, DAMAGE, reason))
    return drive_of(points, left_out, geodetic=geodetic)
