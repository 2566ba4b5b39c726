"""XML files: GPX, KML, and the floating car data of SUMO."""

import re
from collections.abc import Iterator
from itertools import zip_longest
from typing import Any
from xml.etree.ElementTree import Element, ParseError, XMLPullParser

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

READ = ("trkpt", "rtept", "wpt", "when", "coord", "vehicle", "person")
"""Elements that are read at their end."""


def read_gpx(text: str) -> DriveTable:
    """Read the tracks of a GPX file, or else its routes, or else its waypoints."""
    kinds: dict[str, list[Point]] = {"trkpt": [], "rtept": [], "wpt": []}
    damage = list[str]()
    for name, element, is_end in _elements(text, damage):
        if name in kinds and is_end:
            inner = {one.tag: one.text or "" for one in element.iter()}
            point = element.get("lat"), element.get("lon"), inner.get("ele")
            kinds[name].append(Point(*point, inner.get("time", ""), inner.get("speed")))
    return _drive(kinds, damage, "no points in its tracks, routes and waypoints")


def read_kml(text: str) -> DriveTable:
    """Read the tracks of a KML file, or else its lines, rings or points, in their order."""
    shapes: dict[str, list[Point]] = {name: [] for name in SHAPES}
    damage, opened = list[str](), "LineString"
    whens, coords = list[str](), list[list[str]]()
    for name, element, is_end in _elements(text, damage):
        if not is_end:
            opened = name if name in SHAPES else opened
        elif name == "when":
            whens.append(element.text or "")
        elif name == "coord":
            coords.append((element.text or "").split())
        elif name == "coordinates":
            words = re.sub(r"\s*,\s*", ",", element.text or "").split()
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
    for name, element, is_end in _elements(text, damage):
        if name == "timestep" and not is_end:
            time = element.get("time", "")
        elif name in ("vehicle", "person") and is_end:
            names.append(element.get("id", ""))
            cells = element.get("x"), element.get("y"), element.get("z")
            points.append(Point(*cells, time, element.get("speed")))
    chosen = chosen_vehicle(names, vehicle)
    mine = [point for name, point in zip(names, points, strict=True) if name == chosen]
    return _drive({"vehicle": mine}, damage, "no vehicles", geodetic=False)


def _elements(text: str, damage: list[str]) -> Iterator[tuple[str, Element, bool]]:
    """Yield local name and element at each start and end, up to the first damage.

    Prefixes of namespaces need no declaration. A damage is added in a line.
    """
    text = NOT_AN_ENTITY.sub("&amp;", NOT_XML.sub(lambda m: "\n" * m[0].count("\n"), text))
    text = PREFIX.sub(r"\1", text[max(0, text.find("<")) :])
    text = re.sub(r"\A<\?xml[^>]*\?>", "", text)  # whatever encoding it declares
    text = re.sub(r"\sxmlns\s*=\s*(\"[^\"]*\"|'[^']*')", "", text)
    parser: Any = XMLPullParser(("start", "end"))
    path: list[Element] = []
    try:
        for begin in range(0, len(text), CHUNK):
            parser.feed(text[begin : begin + CHUNK])
            for event, element in parser.read_events():
                is_end = event == "end"
                if not is_end:
                    path.append(element)
                yield element.tag, element, is_end
                if is_end and path.pop().tag in READ and path:
                    path[-1].clear()  # what has been read
        parser.close()
    except ParseError as error:
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
