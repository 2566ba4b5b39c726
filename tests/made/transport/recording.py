"""Messages as batches of a picture, and contents of a Rerun recording as tables."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from transport.columns import columns_from
from transport.picture.batch import DRAWN_TOPICS, Batch, Road, RunScene, VehicleValues
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView
from transport.topics import TOPIC_OF, valid_at
from vehicles.messages import Message


def scene_of(vehicles: Sequence[str], path: Road = ((0.0, 100.0), (0.0, 30.0))) -> RunScene:
    """Scene of a convoy of equal cars on a road, by default one that is not flat."""
    return RunScene(
        vehicles=vehicles,
        convoy=vehicles,
        spacing_m=15.0,
        cars=dict.fromkeys(vehicles, (4.93, 1.86, -0.1568)),
        path=path,
        lane_m=3.5,
        duration_s=30.0,
    )


def batch_of(
    messages: Iterable[Message], start: int, errors: Mapping[str, VehicleValues] | None = None
) -> Batch:
    """Batch of the messages of a run that began at instant `start` (ns)."""
    rows: dict[tuple[str, str], list[Message]] = defaultdict(list)
    for message in messages:
        rows[message.vehicle, TOPIC_OF[type(message)].name].append(message)
    tables = {
        (vehicle, topic): columns_from(topic, some, list(map(valid_at, some)), vehicle)
        for (vehicle, topic), some in rows.items()
        if topic in DRAWN_TOPICS
    }
    return Batch(start_ns=start, tables=tables, errors=errors or {})


def drawn(path: Path, scene: RunScene, *batches: Batch) -> "Table":
    """Draw batches into a recording at `path`; returns its contents."""
    with RerunView(parse_rerun_option(f"save={path}"), recording_id="x", scene=scene) as view:
        for batch in batches:
            view.draw(batch)
    return columns(path)


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
