"""Laws of delay, queue and order of a link, from what its table asks for."""

import csv
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from scenarios.definition.errors import Refused
from scenarios.definition.schema.channel.delay import (
    MOST_RECORDED,
    ConstantDelayTable,
    DelayTable,
    EmpiricalDelayTable,
    GammaDelayTable,
    LognormalDelayTable,
    NormalDelayTable,
    QueueTable,
    UniformDelayTable,
)
from scenarios.definition.schema.links import LinkTable
from scenarios.definition.schema.tables import ScenarioTables
from transport.links.laws.delay import (
    ConstantDelay,
    DelayLaw,
    DrawnDelay,
    EmpiricalDelay,
    GammaDelay,
    LognormalDelay,
    NormalDelay,
    UniformDelay,
)
from transport.links.laws.effect import Effect
from transport.links.laws.normals import Normals
from transport.links.laws.queue import InOrder, Queue, StageLaw
from vehicles.schedule import MILLISECOND

PURPOSE = "delay"
"""The word under which delays are drawn."""
COLUMN = "delay_ms"
LONGEST_MS = 60_000.0
WIDEST, NARROWEST = 5.0, 0.01
"""Deviations of a skew law in units of its mean: its table of quantiles reaches so far."""

FolderOf = Callable[[str], Path]
SomeLink = TypeVar("SomeLink", bound=LinkTable)


def delay_effect(table: DelayTable) -> Effect:
    """The delay beyond the floor."""
    if isinstance(table, ConstantDelayTable):
        return _constant(table)
    return DrawnDelay(_law(table), Normals(PURPOSE, table.correlation_ratio))


def _constant(table: ConstantDelayTable) -> ConstantDelay:
    return ConstantDelay(round(table.delay_ms * MILLISECOND))


def _law(table: DelayTable) -> DelayLaw:
    if isinstance(table, ConstantDelayTable):
        return _constant(table)
    if isinstance(table, UniformDelayTable):
        return UniformDelay(table.delay_ms_min * MILLISECOND, table.delay_ms_max * MILLISECOND)
    if isinstance(table, NormalDelayTable):
        most = math.inf if table.delay_ms_max is None else table.delay_ms_max * MILLISECOND
        return NormalDelay(table.mean_ms * MILLISECOND, table.deviation_ms * MILLISECOND, most)
    if isinstance(table, LognormalDelayTable):
        return LognormalDelay(table.mean_ms * MILLISECOND, table.deviation_ms * MILLISECOND)
    if isinstance(table, GammaDelayTable):
        return GammaDelay(table.mean_ms * MILLISECOND, table.deviation_ms * MILLISECOND)
    return EmpiricalDelay(tuple(one * MILLISECOND for one in sorted(table.recorded_ms)))


def usual_delay_ms(table: LinkTable) -> float:
    """What most messages of a link take at most: the jitter at its largest, a law at mean + 2 σ."""
    beyond = 0.0
    if table.delay is not None:
        law = _law(table.delay)
        beyond = (law.mean_ns + 2.0 * law.deviation_ns) / MILLISECOND
    return table.latency_ms + table.jitter_ms + beyond


def link_stages(table: LinkTable) -> tuple[StageLaw, ...]:
    """What messages of the link do to one another, behind its effects."""
    found: list[StageLaw] = []
    if table.queue is not None:
        found.append(_queue(table.queue))
    if table.delay is not None and table.delay.order == "in_order":
        found.append(InOrder())
    return tuple(found)


def _queue(table: QueueTable) -> Queue:
    return Queue(table.bytes_per_s, table.depth_messages, table.drop)


def delay_problems(table: DelayTable | None, key: str) -> Iterator[tuple[str, str]]:
    """Give the keys of a law that contradict each other; `key` is that of its table."""
    if isinstance(table, UniformDelayTable) and table.delay_ms_max <= table.delay_ms_min:
        given = f"given {table.delay_ms_max:g}"
        yield f"{key}.delay_ms_max", f"{given}, allowed more than {table.delay_ms_min:g}, the least"
    if isinstance(table, NormalDelayTable) and table.delay_ms_max is not None:
        least = max(table.mean_ms, 0.001)
        if table.delay_ms_max < least:
            why = f"given {table.delay_ms_max:g}, allowed at least {least:g}, the mean"
            yield f"{key}.delay_ms_max", why
    if isinstance(table, LognormalDelayTable | GammaDelayTable):
        least, most = NARROWEST * table.mean_ms, WIDEST * table.mean_ms
        if not least <= table.deviation_ms <= most:
            allowed = f"allowed {least:g} to {most:g}, {NARROWEST:g} to {WIDEST:g} times the mean"
            yield f"{key}.deviation_ms", f"given {table.deviation_ms:g}, {allowed}"
    if isinstance(table, EmpiricalDelayTable):
        if table.file is not None and table.recorded_ms:
            yield f"{key}.recorded_ms", "given together with file, allowed one of them"
        elif table.file is None and not table.recorded_ms:
            yield f"{key}.file", "missing, needed without recorded_ms"


def with_recorded_delays(tables: ScenarioTables, folder_of: FolderOf) -> ScenarioTables:
    """Put the delays of files that links name in their place; raises Refused.

    `folder_of` gives the folder in which the file that a key names is sought.
    """
    links = _read(tables.links, "links", folder_of)
    entries = tuple(
        _read(entry, f"link[{index}]", folder_of) for index, entry in enumerate(tables.link)
    )
    read = {"links": links, "link": entries}
    given = tables.model_fields_set & read.keys()
    return tables.model_copy(update={key: read[key] for key in given})


def _read(table: SomeLink, key: str, folder_of: FolderOf) -> SomeLink:
    delay = table.delay
    if not isinstance(delay, EmpiricalDelayTable) or delay.file is None:
        return table
    here = f"{key}.delay.file"
    recorded = _recorded(folder_of(here) / delay.file, here, delay.file)
    changes = {"file": None, "source": delay.file, "recorded_ms": recorded}
    return table.model_copy(update={"delay": delay.model_copy(update=changes)})


def _recorded(path: Path, key: str, given: str) -> tuple[float, ...]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise Refused(key, f"given {given}, no such file, or it is not a text") from error
    rows = list(csv.reader(text.splitlines()))
    names = [cell.strip() for cell in rows[0]] if rows else []
    if COLUMN not in names:
        raise Refused(key, f"{given}: line 1 has no column {COLUMN}, allowed a CSV file with it")
    place, found = names.index(COLUMN), []
    for number, row in enumerate(rows[1:], 2):
        cell = row[place].strip() if place < len(row) else ""
        if not any(one.strip() for one in row):
            continue
        found.append(_delay(cell, f"{given}: line {number}: {COLUMN} is {cell[:20]!r}", key))
    if not found:
        raise Refused(key, f"{given}: no delays, allowed one or more")
    kept = min(len(found), MOST_RECORDED)
    found.sort()
    return tuple(found[(2 * k + 1) * len(found) // (2 * kept)] for k in range(kept))


def _delay(cell: str, problem: str, key: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= LONGEST_MS:
        raise Refused(key, f"{problem}, allowed 0 to {LONGEST_MS:g}")
    return value
