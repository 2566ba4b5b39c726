"""Recorded losses, read from their files into the scenario: patterns, and links of earlier runs.

mcap is imported where it is needed, so that a vehicle's process never loads it.
"""

import csv
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TypeVar, cast

from scenarios.definition.channel.build import entries_about, requested_link
from scenarios.definition.errors import SettingError
from scenarios.definition.library import is_file
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.schema.settings_table import overlay
from scenarios.definition.topology import directed_links
from scenarios.definition.wording import toml_repr
from transport.links.laws.delays import MAX_RECORDED, EmpiricalDelay
from transport.links.laws.recorded_losses import EarlierRun, NumberSet, RecordedPattern
from vehicles.messages import LinkVerdict

COLUMNS = ["number", "received"]
RECEIVED = {"1": True, "true": True, "0": False, "false": False}
MOST_LINES = 10_000_000
"""Longest pattern: six days at 20 Hz."""

UNKNOWN_FATES = "; messages of unknown fate count as delivered"

PARTIAL = "set partial = true next to the file to use the rest"

AnyLink = TypeVar("AnyLink", bound=LinkTable)
FolderOf = Callable[[str], Path]
"""Returns the folder in which the file of a key is searched."""


def with_recordings(tables: ScenarioTables, folder_of: FolderOf) -> ScenarioTables:
    """Replace files of `kind = "pattern"` and `"log"` by their contents; raises SettingError."""
    places = _places(tables)
    if not any(isinstance(table.loss, RecordedPattern | EarlierRun) for _, table in places):
        return tables
    for key, table in places:
        loss = table.loss
        if isinstance(loss, RecordedPattern) and loss.file is not None:
            read = _pattern(loss, loss.file, f"{key}.loss.file", folder_of)
            tables = _with_loss(tables, key, read)
    return _with_earlier_runs(tables, folder_of)


def _places(tables: ScenarioTables) -> list[tuple[str, LinkTable]]:
    entries = [(f"link[{place}]", entry) for place, entry in enumerate(tables.link)]
    return [("links", tables.links), *entries]


def _with_loss(tables: ScenarioTables, key: str, loss: RecordedPattern | None) -> ScenarioTables:
    def changed(table: AnyLink) -> AnyLink:
        copy = table.model_copy(update={"loss": loss})
        if loss is None:
            copy.model_fields_set.discard("loss")
        return copy

    if key == "links":
        return tables.model_copy(update={"links": changed(tables.links)})
    entries = [
        changed(entry) if key == f"link[{place}]" else entry
        for place, entry in enumerate(tables.link)
    ]
    return tables.model_copy(update={"link": tuple(entries)})


def _sought(folder_of: FolderOf, key: str, file: str) -> Path:
    path = folder_of(key.replace("[", ".").replace("]", "")) / file
    if not is_file(path):
        raise ValueError("is a directory" if path.is_dir() else "no such file")
    return path


# ---- Patterns


def _pattern(table: RecordedPattern, file: str, key: str, folder_of: FolderOf) -> RecordedPattern:
    try:
        text = _sought(folder_of, key, file).read_text(encoding="utf-8-sig")
        received = list(_received(text))
    except OSError as error:
        raise SettingError(key, f"{file}: {(error.strerror or str(error)).lower()}") from error
    except (ValueError, csv.Error) as error:
        raise SettingError(key, f"{file}: {error}") from error
    lost = NumberSet.of((place, place) for place, one in enumerate(received) if not one)
    changes = {"file": None, "source": file, "length_messages": len(received)}
    return table.model_copy(update={**changes, "lost_numbers": str(lost)})


def _received(text: str) -> Iterator[bool]:
    rows = csv.reader(text.splitlines())
    header = [cell.strip() for cell in next(rows, [])]
    if header != COLUMNS:
        raise ValueError(
            f"header {toml_repr(','.join(header))}, allowed {toml_repr(','.join(COLUMNS))}"
        )
    expected: int | None = None
    for cells in rows:
        if not cells:
            continue
        line = f"line {rows.line_num}"
        if len(cells) != len(COLUMNS):
            raise ValueError(f"{line}: {len(cells)} cells, allowed {len(COLUMNS)}")
        number, received = (cell.strip() for cell in cells)
        if not (number.isascii() and number.isdigit() and len(number) <= 18):  # fits 64 bits
            raise ValueError(f"{line}: number {toml_repr(number)}, allowed a whole number from 0")
        if expected is not None and int(number) != expected:
            raise ValueError(f"{line}: number {number}, allowed {expected}, the next one")
        if received.lower() not in RECEIVED:
            raise ValueError(f"{line}: received {toml_repr(received)}, allowed 0 or 1")
        if rows.line_num > MOST_LINES:
            raise ValueError(f"{line}: allowed at most {MOST_LINES} lines")
        expected = int(number) + 1
        yield RECEIVED[received.lower()]
    if expected is None:
        raise ValueError("no messages below the header")


# ---- Earlier runs


def _with_earlier_runs(tables: ScenarioTables, folder_of: FolderOf) -> ScenarioTables:
    """Add an entry with the record for each link that repeats one of an earlier run.

    An entry with both names is the most specific, so it replaces the file's key.
    """
    names = vehicle_names(tables)
    records: dict[tuple[str, str], EarlierRun] = {}
    read = cache(_links_of)
    for pair in directed_links(tables):
        loss = requested_link(tables, names, *pair).loss
        if (
            isinstance(loss, EarlierRun)
            and loss.file is not None
            and pair[1] not in tables.replayed
        ):
            key = _giver(tables, loss, pair)
            try:
                records[pair] = _record(loss, read(_sought(folder_of, key, loss.file)), pair)
            except OSError as error:
                why = (error.strerror or str(error)).lower()
                raise SettingError(key, f"{loss.file}: {why}") from error
            except ValueError as error:
                raise SettingError(key, f"{loss.file}: {error}") from error
    for key, table in _places(tables):
        if isinstance(table.loss, EarlierRun) and table.loss.file is not None:
            tables = _with_loss(tables, key, None)
    return _with_entries(tables, records)


def _giver(tables: ScenarioTables, loss: EarlierRun, pair: tuple[str, str]) -> str:
    """Return the key of the file of a link, in the most specific table that names it."""
    for _, entry in reversed(entries_about(tables.link, vehicle_names(tables), *pair)):
        if isinstance(entry.loss, EarlierRun) and entry.loss.file == loss.file:
            place = next(place for place, one in enumerate(tables.link) if one is entry)
            return f"link[{place}].loss.file"
    return "links.loss.file"


@dataclass(frozen=True, slots=True)
class _RecordedVerdicts:
    """Verdicts in a log by link and number of the message, and the faults of the log.

    `numbers` are the verdicts' own numbers by receiver, in order: gaps in them are holes.
    """

    links: dict[tuple[str, str], dict[int, LinkVerdict]]
    numbers: dict[str, list[int]]
    faults: str

    def missing_between(self, receiver: str, before: int, after: int) -> int:
        """Count the verdicts of a receiver that the log lacks between two numbers."""
        numbers = self.numbers[receiver]
        present = bisect_left(numbers, after) - bisect_right(numbers, before)
        return max(after - before - 1 - present, 0)


def _links_of(path: Path) -> _RecordedVerdicts:
    from transport.log.errors import LogError  # noqa: PLC0415
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a vehicle's process

    result: dict[tuple[str, str], dict[int, LinkVerdict]] = {}
    numbers: dict[str, set[int]] = {}
    try:
        reader = LogReader(path)
        reader.require_all("verdict")
        for _, receiver, message in reader.messages(("verdict",)):
            verdict = cast("LinkVerdict", message)
            result.setdefault((verdict.sender, receiver), {})[verdict.pose_seq] = verdict
            numbers.setdefault(receiver, set()).add(verdict.seq)
        faults = reader.faults_in(("verdict",)).removeprefix(f"{path}: ")
    except LogError as error:
        raise ValueError(str(error).removeprefix(f"{path}: ")) from error
    except OSError:
        raise
    except Exception as error:
        raise ValueError("damaged log") from error
    return _RecordedVerdicts(
        result, {receiver: sorted(judged) for receiver, judged in numbers.items()}, faults
    )


def _record(loss: EarlierRun, recorded: _RecordedVerdicts, pair: tuple[str, str]) -> EarlierRun:
    """Replace the file by the verdicts of a link; raises ValueError without verdicts.

    A message without a verdict did not arrive: it is lost, with the delay of the previous message.
    If the log lacks its verdict, its fate is unknown and it counts as delivered, which only a
    `partial` record allows.
    """
    if recorded.faults and not loss.partial:
        raise ValueError(f"{recorded.faults}; {PARTIAL}")
    link = loss.sender or pair[0], loss.receiver or pair[1]
    if link not in recorded.links:
        known = ", ".join(f"{sender} → {receiver}" for sender, receiver in sorted(recorded.links))
        raise ValueError(f"no verdicts of {link[0]} → {link[1]}, allowed {known or 'none'}")
    verdicts, delays = recorded.links[link], list[int]()
    unknown = _without_record(recorded, link)
    dropped: dict[str, list[int]] = {}
    for number in range(max(verdicts) + 1):
        verdict = verdicts.get(number)
        if verdict is None:
            delays.append(delays[-1] if delays else 0)
            if number not in unknown:
                dropped.setdefault("pattern", []).append(number)
            continue
        # Old logs have 0 as the time of sending.
        delays.append(verdict.visible_at_ns - (verdict.sent_at_ns or verdict.measured_at_ns))
        if verdict.reason:
            dropped.setdefault(verdict.reason, []).append(number)
    return loss.model_copy(
        update={
            "file": None,
            "source": loss.file,
            "log_faults": recorded.faults + (UNKNOWN_FATES if unknown else ""),
            "delays_ns": run_lengths(delays),
            "dropped_numbers": {
                word: str(NumberSet.of((one, one) for one in numbers))
                for word, numbers in sorted(dropped.items())
            },
        }
    )


def _without_record(recorded: _RecordedVerdicts, link: tuple[str, str]) -> set[int]:
    """Numbers of messages whose verdicts are missing in the log, by gaps in the verdicts.

    Delays that vary change the order: the verdict of a message lies within as many places of its
    own as the others are displaced at most.
    """
    verdicts, unknown = recorded.links[link], set[int]()
    numbers = sorted(verdicts)
    seqs = [verdicts[number].seq for number in numbers]
    in_order = sorted(range(len(seqs)), key=seqs.__getitem__)
    displaced = max(abs(place - other) for place, other in enumerate(in_order))
    before = -1
    for place, number in enumerate(numbers):
        if number > before + 1:
            first = place - 1 - displaced
            low = min(seqs[first:place]) if first >= 0 else -1
            high = max(seqs[place : place + displaced + 1])
            hidden = recorded.missing_between(link[1], low, high)
            unknown.update(range(before + 1, min(number, before + 1 + hidden)))
        before = number
    return unknown


def run_lengths(delays: Sequence[int]) -> str:
    """Write delays (ns) as `delays_ns` has them: each with the number of messages in a row."""
    runs = [(delay, sum(1 for _ in some)) for delay, some in groupby(delays)]
    return ", ".join(f"{delay}x{count}" if count > 1 else f"{delay}" for delay, count in runs)


def _with_entries(
    tables: ScenarioTables, records: Mapping[tuple[str, str], EarlierRun]
) -> ScenarioTables:
    entries = list(tables.link)
    for (sender, receiver), record in records.items():
        own = LinkEntry(sender=sender, receiver=receiver, loss=record)
        place = next(
            (
                k
                for k, one in enumerate(entries)
                if (one.sender, one.receiver) == (sender, receiver)
            ),
            len(entries),
        )
        entries[place : place + 1] = [overlay(entries[place], own) if entries[place:] else own]
    return tables.model_copy(update={"link": tuple(entries)})


# ---- Recorded delays, read into the scenario


COLUMN = "delay_ms"
LONGEST_MS = 60_000.0

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
