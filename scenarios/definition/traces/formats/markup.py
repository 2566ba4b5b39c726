"""XML files: GPX, KML, and the floating car data of SUMO."""

import re
from collections.abc import Callable
from xml.parsers import expat

from scenarios.definition.traces.drive import (
    DAMAGE,
    DriveTable,
    LeftOut,
    LeftOutRecords,
    TraceError,
)
from scenarios.definition.traces.formats.cells import Point, chosen_vehicle, drive_of

NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f]|<!DOCTYPE[^>\\[]*(\\[[^\\]]*\\])?[^>]*>")
NOT_AN_ENTITY = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)")
"""A sign & that begins none of the entities of XML itself: no others are expanded."""

SHAPES = ("Track", "LineString", "LinearRing", "Point")
"""Elements of KML with coordinates; the first that a file has makes the drive."""


def read_gpx(text: str) -> DriveTable:
    """Read the tracks of a GPX file, or else its routes, or else its waypoints."""
    kinds: dict[str, list[Point]] = {"trkpt": [], "rtept": [], "wpt": []}
    place, values = dict[str, str](), dict[str, str]()

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal place, values
        if name in kinds:
            place, values = attributes, {}

    def end(name: str, content: str) -> None:
        if name in kinds:
            cells = place.get("lat"), place.get("lon"), values.get("ele")
            kinds[name].append(Point(*cells, values.get("time", ""), values.get("speed")))
        else:
            values[name] = content

    damage = _parse(text, start, end)
    return _drive(kinds, damage, "no points in its tracks, routes and waypoints")


def read_kml(text: str) -> DriveTable:
    """Read the tracks of a KML file, or else its lines, rings or points, in their order."""
    shapes: dict[str, list[Point]] = {name: [] for name in SHAPES}
    whens, coords, opened = list[str](), 0, "LineString"

    def start(name: str, _: dict[str, str]) -> None:
        nonlocal opened
        opened = name if name in SHAPES else opened

    def end(name: str, content: str) -> None:
        nonlocal coords
        points = shapes["Point"]
        if name == "when":
            whens.append(content)
        elif name == "coord":
            shapes["Track"].append(_point(content.split(), *whens[coords : coords + 1]))
            coords += 1
        elif name == "coordinates":
            words = re.sub(r"\s*,\s*", ",", content).split()
            shapes[opened] += [_point(word.split(",")) for word in words]
        elif name in ("Track", "Placemark"):
            if name == "Placemark" and whens and points and not points[-1].time:
                points[-1] = points[-1]._replace(time=whens[-1])
            whens.clear()
            coords = 0

    damage = _parse(text, start, end)
    return _drive(shapes, damage, "no coordinates in its lines, tracks and points")


def read_fcd(text: str, vehicle: str | None = None) -> DriveTable:
    """Read a vehicle of the floating car data of SUMO; geodetic output has longitudes as x."""
    names, points, time = list[str](), list[Point](), ""

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal time
        value = attributes.get
        if name == "timestep":
            time = value("time", "")
        elif name in ("vehicle", "person"):
            names.append(value("id", ""))
            points.append(Point(value("x"), value("y"), value("z"), time, value("speed")))

    damage = _parse(text, start, lambda _name, _content: None)
    chosen = chosen_vehicle(names, vehicle)
    mine = [point for name, point in zip(names, points, strict=True) if name == chosen]
    return _drive({"vehicle": mine}, damage, "no vehicles", geodetic=False)


def _parse(
    text: str, start: Callable[[str, dict[str, str]], None], end: Callable[[str, str], None]
) -> list[str]:
    """Call `start` with name and attributes, and `end` with name and text, of each element.

    Names are without prefixes, which need no declaration. The first damage ends the file; it is
    returned in a line.
    """
    text = NOT_AN_ENTITY.sub("&amp;", NOT_XML.sub(lambda m: "\n" * m[0].count("\n"), text))
    texts = list[str]()
    parser = expat.ParserCreate("utf-8")  # whatever encoding the file declares
    parser.buffer_text = True
    parser.CharacterDataHandler = texts.append

    def opened(name: str, attributes: dict[str, str]) -> None:
        texts.clear()
        start(name.rpartition(":")[2], attributes)

    parser.StartElementHandler = opened
    parser.EndElementHandler = lambda name: end(name.rpartition(":")[2], "".join(texts))
    try:
        parser.Parse(text[max(0, text.find("<")) :].encode(errors="replace"), True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        return [f"damaged XML at line {error.lineno}: {reason}"]
    return []


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
