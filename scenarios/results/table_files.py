"""Write tables and tracks into files: CSV, Parquet and GPX."""

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Literal, get_args
from xml.sax.saxutils import quoteattr

import numpy as np

from scenarios.definition.errors import ScenarioError, require
from scenarios.results.data_table import DataTable
from scenarios.results.files import json_text, write_whole
from scenarios.results.run_record import RunRecord, VehicleRecord
from vehicles.schedule import MILLISECOND

FileFormat = Literal["csv", "parquet", "gpx"]
FORMATS: Sequence[FileFormat] = get_args(FileFormat)
ORIGIN_NAME = "export.json"
MICROSECOND = MILLISECOND // 1000


def export_run(
    run: RunRecord,
    out: Path,
    formats: Sequence[str] = ("csv", "gpx"),
    report: Callable[[Path], object] = lambda _: None,
) -> list[Path]:
    """Write the tables of vehicles and links, and a track for each vehicle, into a folder.

    Parquet and GPX files state their log and its faults; CSV files have them in `export.json` next
    to them. `report` gets each written file. Unknown values are empty in CSV and null in Parquet.
    Raises ScenarioError for an unknown format and for files that exist, and MissingExtraError.
    """
    if unknown := [name for name in formats if name not in FORMATS]:
        raise ScenarioError([f"format: given {unknown[0]!r}, allowed {', '.join(FORMATS)}"])
    if "parquet" in formats:
        require("format parquet", "tables", "pyarrow")
    contents = {
        out / name: content
        for kind in dict.fromkeys(formats)
        for name, content in _files(run, kind).items()
    }
    if existing := [path for path in contents if path.exists() or path.is_symlink()]:
        raise ScenarioError([f"{existing[0]}: exists; give another folder by --out"])
    out.mkdir(parents=True, exist_ok=True)
    for path, content in contents.items():
        write_whole(path, content(), new=True)
        report(path)
    return list(contents)


def _files(run: RunRecord, kind: str) -> dict[str, Callable[[], bytes]]:
    """Functions that make the contents of the files of a format, by their names."""
    if kind == "gpx":
        senders = [name for name in run.vehicles if "gps" in run.topics_of(name)]
        return {f"{name}.gpx": partial(gpx_of, run.vehicles[name], run.origin) for name in senders}
    tables = {"vehicles": lambda: run.states, "links": lambda: run.messages}
    if kind == "parquet":
        return {
            f"{name}.parquet": partial(_parquet, table, run.origin)
            for name, table in tables.items()
        }
    files = {f"{name}.csv": partial(_csv, table) for name, table in tables.items()}
    return files | {ORIGIN_NAME: lambda: json_text(run.origin).encode()}


def _csv(table: Callable[[], DataTable]) -> bytes:
    return csv_of(table())


def _parquet(table: Callable[[], DataTable], origin: Mapping[str, str]) -> bytes:
    return parquet_of(table(), origin)


def csv_of(table: DataTable) -> bytes:
    """Write a table as CSV; lists are JSON."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    cells = (map(_cell, column.tolist()) for _, column in table.items())
    writer.writerows(zip(*cells, strict=True))
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    """Text of a value; empty if it is unknown."""
    if value is None or value != value:  # noqa: PLR0124 - NaN differs from itself
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value.tolist()) if isinstance(value, np.ndarray) else value


def parquet_of(table: DataTable, origin: Mapping[str, str]) -> bytes:
    """Write a table as Parquet; `origin` becomes its metadata."""
    import pyarrow  # noqa: PLC0415 - an extra
    import pyarrow.parquet  # noqa: PLC0415

    sink = pyarrow.BufferOutputStream()
    content = table.to_arrow().replace_schema_metadata(dict(origin))
    pyarrow.parquet.write_table(content, sink)
    return bytes(sink.getvalue().to_pybytes())


def gpx_of(vehicle: VehicleRecord, origin: Mapping[str, str]) -> bytes:
    """Write the measured positions of a vehicle as a track (GPX 1.1), in order of time.

    `origin` is its description.
    """
    described = ("title", "log", "log_faults")
    description = "; ".join(f"{name}: {origin[name]}" for name in described if origin.get(name))
    gps = vehicle.gps
    order = np.argsort(gps.measured_at_ns, kind="stable")
    columns = (gps.latitude_deg, gps.longitude_deg, gps.altitude_m, gps.measured_at_ns)
    points = [
        f'<trkpt lat="{latitude:.10f}" lon="{longitude:.10f}">'
        f"<ele>{altitude:.4f}</ele><time>{_utc(at_ns)}</time></trkpt>"
        for latitude, longitude, altitude, at_ns in zip(
            *(column[order].tolist() for column in columns), strict=True
        )
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<gpx version="1.1" creator={quoteattr("convoy")} '
        'xmlns="http://www.topografix.com/GPX/1/1">',
        f"<metadata><desc>{escape(description, quote=False)}</desc></metadata>",
        f"<trk><name>{escape(vehicle.name, quote=False)}</name><trkseg>",
        *points,
        "</trkseg></trk>",
        "</gpx>",
    ]
    return "\n".join(lines).encode() + b"\n"


def _utc(at_ns: int) -> str:
    """Instant in ISO 8601, to a microsecond."""
    seconds, rest = divmod(round(at_ns / MICROSECOND), 1_000_000)
    return f"{datetime.fromtimestamp(seconds, tz=UTC):%Y-%m-%dT%H:%M:%S}.{rest:06d}Z"
