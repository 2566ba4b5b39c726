"""Contents of a Rerun recording as tables."""

from collections import defaultdict
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

Table = dict[str, dict[str, list[Any]]]
"""Columns of each entity by name, and `run_time` in ns (-1 for static data)."""


def columns(path: Path) -> Table:
    rows_of: dict[str, list[tuple[int, dict[str, Any]]]] = defaultdict(list)
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        for row in range(batch.num_rows):
            values = {
                name: batch.column(name)[row] for name in batch.schema.names if "RowId" not in name
            }
            run_time = values.pop("run_time", None)
            values.pop("log_time", None)
            values = {name: value.as_py() for name, value in values.items()}
            rows_of[chunk.entity_path].append((-1 if run_time is None else run_time.value, values))
    table: Table = {}
    for entity, rows in rows_of.items():
        rows.sort(key=lambda row: row[0])
        table[entity] = {"run_time": [at for at, _ in rows]}
        for name in sorted({name for _, values in rows for name in values}):
            table[entity][name] = [values.get(name) for _, values in rows]
    return table
