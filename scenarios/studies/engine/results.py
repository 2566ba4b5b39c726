"""Files of a study: tables, JSON, plots and texts, each written atomically."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import write_whole
from scenarios.studies.picture_style import encoded, picture_format_of

Row = dict[str, Any]
"""A row of a table: texts, numbers or None by column."""


def refuse_existing(*files: Path | None, place: str = "place") -> None:
    """Raise ScenarioError if one of the output files exists."""
    for file in files:
        if file is not None and (file.exists() or file.is_symlink()):
            raise ScenarioError([f"{file}: exists; give another {place}"])


def write_files(out: Path, contents: Mapping[str, Any]) -> list[Path]:
    out.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_file(out / name, content)
    return [out / name for name in contents]


def write_file(path: Path, content: Any) -> None:
    """Put one file in its place once it is complete.

    A mapping is written as JSON, a list of rows as CSV, or as Parquet by the name, a figure of
    matplotlib as PNG, SVG or PDF by the name, a text as it is.
    """
    if isinstance(content, str):
        data = content.encode()
    elif isinstance(content, Mapping):
        data = json.dumps(content, indent=1).encode() + b"\n"
    elif isinstance(content, list):
        data = _parquet(content) if path.suffix == ".parquet" else _csv(content)
    else:
        data = encoded(content, picture_format_of(path))
    write_whole(path, data)


def _csv(rows: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _parquet(rows: Sequence[Row]) -> bytes:
    import pyarrow  # noqa: PLC0415 - an extra
    import pyarrow.parquet  # noqa: PLC0415

    sink = pyarrow.BufferOutputStream()
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    pyarrow.parquet.write_table(pyarrow.table(columns), sink)
    return bytes(sink.getvalue().to_pybytes())
