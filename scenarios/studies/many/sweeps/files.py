"""The tables of a sweep as files: CSV for people, JSON and Parquet for programs.

Each file is written whole or not at all, so that a reader never finds half of one.
"""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from scenarios.studies.many.sweeps.table import Row, SweepTable, SweptCell

SCHEMA = "convoy.sweep/1"
CELLS, RUNS, TWIN = "sweep.csv", "runs.csv", "sweep.json"
PARQUET = ("sweep.parquet", "runs.parquet")


def write_tables(table: SweepTable, out: Path, *, parquet: bool = False) -> list[Path]:
    """Write all tables into the folder `out`; their paths. `parquet` needs pyarrow."""
    cells, runs = table.rows(), table.run_rows()
    contents = {
        CELLS: _csv(cells),
        RUNS: _csv(runs),
        TWIN: json.dumps(machine_readable(table), indent=1, allow_nan=False).encode() + b"\n",
    }
    if parquet:
        numbers = {axis.key for axis in table.plan.axes if axis.numbers}
        contents |= {
            name: _parquet([_typed(row, numbers) for row in rows])
            for name, rows in zip(PARQUET, (cells, runs), strict=True)
        }
    for name, content in contents.items():
        write_whole(out / name, content)
    return [out / name for name in contents]


def write_whole(path: Path, content: bytes) -> None:
    """Put a file in its place once it is complete."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_bytes(content)
    beside.replace(path)


def machine_readable(table: SweepTable) -> dict[str, object]:
    """Give what was asked, and each cell with its runs, as JSON has it."""
    cells = [_cell_content(table, cell) for cell in table.cells]
    return {"schema": SCHEMA, "asked": table.plan.asked(), "cells": cells}


def _cell_content(table: SweepTable, cell: SweptCell) -> dict[str, object]:
    keys = [axis.key for axis in table.plan.axes]
    figures = [figure.name for figure in table.plan.figures]
    limits = [str(limit) for limit in table.plan.limits]
    return {
        "values": dict(zip(keys, cell.values, strict=True)),
        "failed": cell.failed,
        "errors": cell.errors,
        "figures": dict(zip(figures, map(asdict, cell.figures), strict=True)),
        "limits": dict(zip(limits, map(asdict, cell.limits), strict=True)),
        "worst_seed": cell.worst.seed,
        "runs": [
            {
                "seed": run.seed,
                "command": run.command,
                "outcome": run.outcome,
                "reason": run.reason,
                "error": run.error,
                "figures": dict(zip(figures, run.figures, strict=False)),
                "broken": dict(zip(limits, run.broken, strict=False)),
            }
            for run in cell.runs
        ],
    }


def _csv(rows: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _typed(row: Row, numbers: set[str]) -> Row:
    """Give the values of keys that are numbers as such."""
    return {name: float(value) if name in numbers else value for name, value in row.items()}


def _parquet(rows: Sequence[Row]) -> bytes:
    import pyarrow  # noqa: PLC0415 - an extra
    import pyarrow.parquet  # noqa: PLC0415

    sink = pyarrow.BufferOutputStream()
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    pyarrow.parquet.write_table(pyarrow.table(columns), sink)
    return bytes(sink.getvalue().to_pybytes())
