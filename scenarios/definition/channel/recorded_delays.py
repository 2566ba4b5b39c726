"""Recorded delays, read into the scenario."""

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from scenarios.definition.errors import SettingError
from scenarios.definition.library import is_file
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from transport.links.laws.delay.distributions import MAX_RECORDED, EmpiricalDelay

COLUMN = "delay_ms"
LONGEST_MS = 60_000.0

FolderOf = Callable[[str], Path]
SomeLink = TypeVar("SomeLink", bound=LinkTable)


def with_recorded_delays(tables: ScenarioTables, folder_of: FolderOf) -> ScenarioTables:
    """Replace files of delays by their contents; raises SettingError.

    `folder_of` returns the folder in which the file of a key is searched.
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
    if not isinstance(delay, EmpiricalDelay) or delay.file is None:
        return table
    here = f"{key}.delay.file"
    recorded = _recorded(folder_of(here) / delay.file, here, delay.file)
    changes = {"file": None, "source": delay.file, "recorded_ms": recorded}
    return table.model_copy(update={"delay": delay.model_copy(update=changes)})


def _recorded(path: Path, key: str, given: str) -> tuple[float, ...]:
    try:
        if not is_file(path):
            raise FileNotFoundError(path)
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise SettingError(key, f"given {given}, no such file, or it is not a text") from error
    rows = list(csv.reader(text.splitlines()))
    names = [cell.strip() for cell in rows[0]] if rows else []
    if COLUMN not in names:
        raise SettingError(
            key, f"{given}: line 1 has no column {COLUMN}, allowed a CSV file with it"
        )
    place, result = names.index(COLUMN), []
    for number, row in enumerate(rows[1:], 2):
        cell = row[place].strip() if place < len(row) else ""
        if not any(one.strip() for one in row):
            continue
        result.append(_delay(cell, f"{given}: line {number}: {COLUMN} is {cell[:20]!r}", key))
    if not result:
        raise SettingError(key, f"{given}: no delays, allowed one or more")
    kept = min(len(result), MAX_RECORDED)
    result.sort()
    return tuple(result[(2 * k + 1) * len(result) // (2 * kept)] for k in range(kept))


def _delay(cell: str, problem: str, key: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= LONGEST_MS:
        raise SettingError(key, f"{problem}, allowed 0 to {LONGEST_MS:g}")
    return value
