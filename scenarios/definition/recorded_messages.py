"""The log of replayed vehicles: whether it holds what a scenario needs of it.

mcap is imported where it is needed, so that a vehicle's process never loads it.
"""

from collections.abc import Callable
from hashlib import file_digest
from itertools import product
from pathlib import Path

from scenarios.definition.errors import SettingError
from scenarios.definition.library import is_file
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.scenario_tables import ReplayTable, ScenarioTables
from scenarios.definition.wording import toml_repr
from transport.topics import RUN_SENDER
from vehicles.schedule import SECOND

TOPICS = ("gps", "truth")
"""Topics of a replayed vehicle that are sent again."""
DIGITS = 16
"""Digits of the checksum of a log."""
PARTIAL = "set replay.partial = true to use the rest of it"


def with_recorded_messages(
    tables: ScenarioTables, folder_of: Callable[[str], Path]
) -> ScenarioTables:
    """Check the log of replayed vehicles and note its checksum; raises SettingError.

    `folder_of` returns the folder in which the file of a key is searched. A log with a known
    checksum may be absent: processes of live vehicles do not need it.
    """
    table = tables.replay
    if table is None:
        return tables
    names = vehicle_names(tables)
    for name in table.vehicles:
        if name not in names:
            why = f"given {toml_repr(name)}, allowed {', '.join(names)}"
            raise SettingError("replay.vehicles", why)
        if (own := tables.vehicle.get(name)) is not None and own.replay is not None:
            raise SettingError("replay.vehicles", f"{name} has vehicle.{name}.replay already")
    path = (folder_of("replay.log") / table.log).resolve()
    if table.digest and not path.exists():
        return tables
    try:
        found = _checked(table, path)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise SettingError("replay.log", f"{table.log}: {why}") from error
    except ValueError as error:
        raise SettingError("replay.log", f"{table.log}: {error}") from error
    return tables.model_copy(update={"replay": found})


def digest_of(log: Path) -> str:
    """Return the checksum of a log."""
    with log.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()[:DIGITS]


def _checked(table: ReplayTable, path: Path) -> ReplayTable:
    """Note checksum and recorded times of the log; raises ValueError unless it can be replayed."""
    from transport.log.errors import LogError  # noqa: PLC0415
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a vehicle's process

    if not is_file(path):
        raise ValueError("is a directory" if path.is_dir() else "no such file")
    digest = digest_of(path)
    if table.digest not in {"", digest}:
        raise ValueError(f"has the checksum {digest}, replay.digest is {table.digest}")
    try:
        reader = LogReader(path)
        reader.require_all(*TOPICS)
        if not table.partial:
            reader.refuse_faults(*TOPICS, "start", remedy=PARTIAL)
        for name, topic in product(table.vehicles, TOPICS):
            if not reader.counts.get((name, topic)):
                senders = ", ".join(sorted({one for one, of in reader.counts if of == topic}))
                missing = f"holds no messages of {name} on the topic {topic}"
                raise ValueError(f"{missing}, but of {senders or 'none'}")
        columns = reader.columns(("truth", "start"), vehicles={*table.vehicles, RUN_SENDER})
    except LogError as error:
        raise ValueError(str(error).removeprefix(f"{path}: ")) from error
    starts = [one for (_, topic), one in columns.items() if topic == "start"]
    if not starts:
        raise ValueError("holds no start of the run")
    start_at = starts[0].fields["start_at_ns"][0]
    instants = [columns[name, "truth"].fields["true_at_ns"] - start_at for name in table.vehicles]
    first, last = max(int(at.min()) for at in instants), min(int(at.max()) for at in instants)
    update = {"log": str(path), "digest": digest, "recorded_s": (first / SECOND, last / SECOND)}
    return table.model_copy(update=update)
