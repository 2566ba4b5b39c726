"""The formats, and which of them a file has."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from scenarios.definition.traces.formats.geojson import read_geojson
from scenarios.definition.traces.formats.logs import MCAP_MAGIC, read_mcap
from scenarios.definition.traces.formats.markup import (
    FORMATS,
    SENTENCE,
    decoded,
    read_gpx,
    read_kml,
)
from scenarios.definition.traces.formats.nmea import read_nmea
from scenarios.definition.traces.formats.table import read_table
from scenarios.definition.traces.recorded_drive import RecordedDrive, TraceError

MAX_BYTES: Final = 200_000_000
"""Largest file of a drive."""

HEAD: Final = 20_000
"""Number of characters in which markup is recognised."""


COORDINATES: Final = re.compile(r'"coordinates"\s*:')


@dataclass(frozen=True, slots=True)
class Format:
    """A text format: name, suffixes of files, whether a text has it, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    matches: Callable[[str], bool]
    read: Callable[[str], RecordedDrive]


def _tag(*names: str) -> Callable[[str], bool]:
    tag = re.compile(rf"<(?:[\w.-]+:)?(?:{'|'.join(names)})[\s>/]")
    return lambda text: bool(tag.search(text, 0, HEAD))


def _is_json(text: str) -> bool:
    return text[:HEAD].lstrip().startswith(("{", "[{")) or bool(COORDINATES.search(text, 0, HEAD))


def _is_table(text: str) -> bool:
    """Whether most lines have cells, and a number in one of them."""
    lines = [line for line in text[:HEAD].splitlines() if line.strip()][:100]
    rows = [line for line in lines if re.search(r"\d", line) and re.search(r"\S[,;|\t ]+\S", line)]
    return 2 * len(rows) >= len(lines)


TEXT_FORMATS: Final = (
    Format("NMEA 0183", (".nmea", ".ubx"), lambda text: bool(re.search(SENTENCE, text)), read_nmea),
    Format("GPX", (".gpx",), _tag("gpx", "trkpt", "rtept", "wpt"), read_gpx),
    Format(
        "KML", (".kml",), _tag("kml", "Placemark", "LineString", "coordinates", "coord"), read_kml
    ),
    Format("GeoJSON", (".geojson", ".json"), _is_json, read_geojson),
    Format("CSV", (".csv", ".tsv", ".txt", ".pos", ".dat"), _is_table, read_table),
)
"""The first format that a text matches reads it; without any its suffix decides."""


def read_recorded(
    path: Path, *, vehicle: str | None = None, topic: str | None = None
) -> RecordedDrive:
    """Read a recorded drive by the format of its content.

    `vehicle` selects one of a convoy's log, `topic` the positions of another MCAP file. Raises
    TraceError for a file that is missing, too large, or of another format.
    """
    data = _content(path)
    if data.startswith(MCAP_MAGIC):
        return replace(read_mcap(path, vehicle, topic), format_name="MCAP")
    for key, value in (("vehicle", vehicle), ("topic", topic)):
        if value is not None:
            raise TraceError(f"given {key} {value}, allowed only for an MCAP file")
    text = decoded(data)
    del data  # large
    name, drive = _read_text(text, path.suffix.lower())
    return replace(drive, format_name=name)


def _read_text(text: str, suffix: str) -> tuple[str, RecordedDrive]:
    by_content = (row for row in TEXT_FORMATS if row.matches(text))
    by_suffix = (row for row in TEXT_FORMATS if suffix in row.suffixes)
    chosen = next(by_content, None) or next(by_suffix, None)
    if chosen is None or (chosen.name == "CSV" and _tag("html", "!DOCTYPE html")(text)):
        raise TraceError(f"unknown content, allowed {FORMATS}")
    return chosen.name, chosen.read(text)


def _content(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise TraceError(f"a folder, allowed a file: {FORMATS}")
        size = path.stat().st_size
        if path.is_file() and size <= MAX_BYTES:
            return path.read_bytes()
    except FileNotFoundError as error:
        raise TraceError("no such file") from error
    except OSError as error:
        raise TraceError((error.strerror or "cannot be read").lower()) from error
    except ValueError as error:  # a zero byte in its name
        raise TraceError(str(error)) from error
    too_large = f"larger than {MAX_BYTES // 1_000_000} MB: give a part of it"
    raise TraceError(too_large if path.is_file() else "not a file")
