"""A recorded run: the messages of its log as tables, by vehicle and by link."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario
from scenarios.definition.topology import usual_links
from scenarios.results.data_table import Array, DataTable, UnknownNameError, Values
from scenarios.results.link_account import CAUSE_WORDS, Link, MissingVerdict, accounts
from scenarios.results.log_summary import (
    METADATA_NAME,
    log_in,
    scenario_in,
    summary_of,
    tables_in,
)
from scenarios.results.summary import RunSummary
from scenarios.results.tables import RunTables
from scenarios.results.true_motion import at_instants, gaps, path_feet
from transport.columns import Columns
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER, TOPICS
from vehicles.schedule import SECOND

TRUE_FIGURES = ("error_m", "station_m", "gap_m")
"""Columns that the table of true poses has in addition to the messages: the offset to the left of
the lead's driven path and the straight before it, the place along it (0 at the lead's first pose),
and the distance of the bodies of the vehicle and of the one ahead; NaN if unknown."""


# ---- The outcome of each message of each link in a log


class LinkOutcomes(NamedTuple):
    """Messages of a link in the order of their numbers; shapes (N).

    `outcome` is delivered, dropped, not_arrived (the real transport lost it or the receiver did not
    run), in_flight (due after the end of the record) or unrecorded (the log lacks the verdict).
    `cause` is the reason of a drop, or why a message did not arrive; None otherwise. `delay_s` is
    the time from sending until the receiver can use the message, NaN unless it was delivered.
    """

    number: NDArray[np.int64]
    sent_at_ns: NDArray[np.int64]
    outcome: NDArray[np.object_]
    cause: NDArray[np.object_]
    delay_s: NDArray[np.float64]


def link_outcomes(
    link: Link, verdicts: Columns | None, missing: Sequence[MissingVerdict]
) -> LinkOutcomes:
    """Join the verdicts of a receiver on one link, and its messages without one."""
    known = _judged(link, verdicts) if verdicts is not None else _without_verdict(())
    parts = known, _without_verdict(missing)
    joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    return LinkOutcomes(*(column[order] for column in joined))


def _judged(link: Link, verdicts: Columns) -> LinkOutcomes:
    rows = np.flatnonzero(verdicts["sender"] == link[0])
    columns = {name: column[rows] for name, column in verdicts.fields.items()}
    delivered = columns["outcome"] == "delivered"
    usable_at = np.where(columns["late"], columns["received_at_ns"], columns["visible_at_ns"])
    delays = (usable_at - columns["sent_at_ns"]) / SECOND
    return LinkOutcomes(
        columns["pose_seq"],
        columns["sent_at_ns"],
        columns["outcome"],
        np.where(delivered, np.array(None, object), columns["reason"]),
        np.where(delivered, delays, np.nan),
    )


def _without_verdict(missing: Sequence[MissingVerdict]) -> LinkOutcomes:
    outcomes = ["not_arrived" if row.fate in CAUSE_WORDS else row.fate for row in missing]
    causes = [row.fate if row.fate in CAUSE_WORDS else None for row in missing]
    return LinkOutcomes(
        np.array([row.number for row in missing], np.int64),
        np.array([row.sent_at for row in missing], np.int64),
        np.array(outcomes, object),
        np.array(causes, object),
        np.full(len(missing), np.nan),
    )


# ---- One table of all vehicles, and one of all links: each row is an observation


TRUE_COLUMNS = {
    "east_m": "east_m",
    "north_m": "north_m",
    "yaw_rad": "yaw_rad",
    "speed_mps": "speed_mps",
    "error_m": "true_error_m",
    "station_m": "station_m",
    "gap_m": "true_gap_m",
}
"""Columns of the table of vehicles from true poses, by their names there."""
OWN_COLUMNS = (
    "lateral_error_m",
    "heading_error_rad",
    "estimated_gap_m",
    "measured_gap_m",
    "mode",
)
"""Columns from the vehicle's decisions: what it estimates and does."""


def vehicle_rows(
    name: str, truth: DataTable | None, tracking: Columns | None
) -> Mapping[str, Array]:
    """Columns of one vehicle: a row for each instant of a true pose or of a decision."""
    instants = [table.at_ns for table in (truth, tracking) if table is not None]
    at_ns: NDArray[np.int64] = np.unique(np.concatenate([np.zeros(0, np.int64), *instants]))
    columns: dict[str, Array] = {"at_ns": at_ns, "vehicle": np.full(len(at_ns), name, object)}
    for source, column in TRUE_COLUMNS.items():
        columns[column] = _at(at_ns, truth, source)
    for column in OWN_COLUMNS:
        columns[column] = _at(at_ns, tracking, column)
    return columns


def _at(at_ns: NDArray[np.int64], table: DataTable | Columns | None, name: str) -> Array:
    """Values of a column at instants, unknown at others."""
    values: Array = np.zeros(0) if table is None else table[name]
    is_text = name == "mode"
    column: Array = np.full(len(at_ns), None if is_text else np.nan, object if is_text else float)
    if table is not None:
        column[np.searchsorted(at_ns, table.at_ns)] = values
    return column


def joined(tables: Sequence[Mapping[str, Any]]) -> dict[str, Array]:
    """Join tables of the same columns, one below the other."""
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


# ---- Run record


ORIGIN_SCHEMA = "convoy.export/1"
Key = TypeVar("Key")
Entry = TypeVar("Entry")


class Named(Mapping[Key, Entry], Generic[Key, Entry]):
    """Entries by name in order; an unknown name raises Error with those that exist."""

    def __init__(self, kind: str, entries: Mapping[Key, Entry]) -> None:
        self._kind, self._entries = kind, entries

    def __getitem__(self, name: Key) -> Entry:
        try:
            return self._entries[name]
        except (KeyError, TypeError):
            raise UnknownNameError(self._kind, name, list(self._entries)) from None

    def __iter__(self) -> Iterator[Key]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return f"<{self._kind}s: {', '.join(map(str, self._entries))}>"


class RunRecord:
    """The log of a run, which may be incomplete or damaged; `faults` describes that in a line.

    Tables are read when they are first used.
    """

    def __init__(self, path: str | Path) -> None:
        """Open a log, or the log in the folder of a run; raises LogError."""
        self.log = log_in(Path(path))
        self._reader = LogReader(self.log)
        self._columns: dict[str, dict[str, Columns]] = {}

    @cached_property
    def faults(self) -> str:
        return self._reader.faults

    @cached_property
    def origin(self) -> Mapping[str, str]:
        """Where the data come from: log, run, scenario, seed, faults."""
        metadata = self._reader.metadata()
        texts = {
            "log_faults": self.faults.removeprefix(f"{self.log}: "),
            "thinned_hz": _listed(self._reader.thinned),
        }
        identity = metadata.get(METADATA_NAME, {}) | {"schema": ORIGIN_SCHEMA}
        return {"log": str(self.log)} | identity | texts

    @cached_property
    def summary(self) -> RunSummary:
        """Figures of the run, as in `summary.json`; those of an incomplete log are computed."""
        return summary_of(self.log)

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario that the log holds; raises LogError if it is damaged."""
        return scenario_in(self._reader)

    @cached_property
    def known_scenario(self) -> Scenario | None:
        """The scenario; None if the log lacks it or it cannot be read by this version."""
        try:
            return self.scenario
        except (LogError, ScenarioError):
            return None

    @cached_property
    def start_at_ns(self) -> int:
        """Instant of the start; without its record, that of the first true pose."""
        starts = self.columns_of("start").get(RUN_SENDER)
        if starts is not None and len(starts):
            return int(starts.at_ns[0])
        firsts = [truth.at_ns[0] for truth in self.columns_of("truth").values() if len(truth)]
        return int(min(firsts, default=0))

    @cached_property
    def vehicle_names(self) -> Sequence[str]:
        """Names of the vehicles, the lead first."""
        if self.known_scenario is not None:
            return self.known_scenario.vehicle_names
        return [name for name in self._reader.vehicles if name != RUN_SENDER]

    @cached_property
    def vehicles(self) -> Named[str, "VehicleRecord"]:
        """Tables of each vehicle, the lead first."""
        return Named("vehicle", {name: VehicleRecord(self, name) for name in self.vehicle_names})

    @cached_property
    def links(self) -> Named[Link, "LinkRecord"]:
        """Tables of each link, by (sender, receiver)."""
        if self.known_scenario is not None:
            links = tuple(self.known_scenario.links)
        else:
            links = usual_links(self.vehicle_names)
        return Named("link", {link: LinkRecord(self, link) for link in links})

    @cached_property
    def texts(self) -> DataTable:
        """Lines of text of all vehicles and of the recorder ("run"), in order of time."""
        tables = self.columns_of("log")
        none = np.zeros(0, object)  # a log may hold no texts
        names = [none, *(np.full(len(rows), name, object) for name, rows in tables.items())]
        whole = {
            field: np.concatenate([none.astype(kind), *(rows[field] for rows in tables.values())])
            for field, kind in (("logged_at_ns", np.int64), ("level", object), ("text", object))
        }
        order = np.argsort(whole["logged_at_ns"], kind="stable")
        return DataTable(
            {
                "t_s": self.seconds(whole["logged_at_ns"][order]),
                "at_ns": whole["logged_at_ns"][order],
                "vehicle": np.concatenate(names)[order],
                "level": whole["level"][order],
                "text": whole["text"][order],
            }
        )

    @cached_property
    def states(self) -> DataTable:
        """All vehicles in one table: a row for each instant of a true pose or a decision.

        True position, speed, error and gap, and the errors and the mode that the vehicle reports.
        """
        rows = []
        for name in self.vehicle_names:
            truth = self.true_table(name) if "truth" in self.topics_of(name) else None
            rows.append(vehicle_rows(name, truth, self.columns_of("tracking").get(name)))
        columns = joined(rows)
        return DataTable({"t_s": self.seconds(columns["at_ns"]), **columns})

    @cached_property
    def messages(self) -> DataTable:
        """All links in one table: a row for each sent message, see `LinkRecord.outcomes`."""
        tables = [self._rows_of(("", ""), link_outcomes(("", ""), None, ()))]
        tables += [self._rows_of(link, self._outcomes(link)) for link in self.links]
        return DataTable(joined(tables))

    def _rows_of(self, link: Link, rows: LinkOutcomes) -> dict[str, Array]:
        sender, receiver = (np.full(len(rows.number), name, object) for name in link)
        times = {"t_s": self.seconds(rows.sent_at_ns), "sender": sender, "receiver": receiver}
        return times | rows._asdict()

    def topics_of(self, vehicle: str) -> set[str]:
        """Topics of which the log holds messages of a vehicle."""
        counts = self._reader.counts.items()
        return {topic for (name, topic), count in counts if name == vehicle and count}

    def columns_of(self, topic: str) -> Mapping[str, Columns]:
        """Messages of a topic by vehicle."""
        if topic not in self._columns:
            read = self._reader.columns([topic])
            self._columns[topic] = {vehicle: columns for (vehicle, _), columns in read.items()}
        return self._columns[topic]

    def seconds(self, at_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Times (s) after the start of the run."""
        return (at_ns - self.start_at_ns) / SECOND

    def table(self, vehicle: str, topic: str) -> DataTable:
        """Messages of a vehicle, a row each: time, instant, and the fields of the message."""
        return DataTable(self._with_times(self._columns_of(vehicle, topic)))

    def _columns_of(self, vehicle: str, topic: str) -> Columns:
        columns = self.columns_of(topic).get(vehicle)
        if columns is None:
            raise LogError(f"{self.log}: no messages of topic {topic} of {vehicle}")
        return columns

    def _with_times(self, columns: Columns) -> dict[str, Values]:
        times: dict[str, Values] = {"t_s": self.seconds(columns.at_ns), "at_ns": columns.at_ns}
        order = list(TOPICS[columns.topic].message.__dataclass_fields__)
        fields: dict[str, Values] = {**columns.fields, **columns.lists}
        return times | {name: fields[name] for name in order if name in fields}

    @cached_property
    def tables(self) -> RunTables:
        """Messages of which metrics are made, and the functions' argument; raises LogError."""
        return tables_in(self._reader, self.scenario)

    def true_table(self, vehicle: str) -> DataTable:
        """True poses of a vehicle with its error, station and gap."""
        columns = self._columns_of(vehicle, "truth")
        figures = dict.fromkeys(TRUE_FIGURES, np.full(len(columns), np.nan))
        if self.known_scenario is not None:
            run = self.tables
            columns = run.table(vehicle, "truth")
            if vehicle != run.lead:
                station, error = path_feet(run, vehicle)
                apart = gaps(run, vehicle)
                gap = at_instants(columns.at_ns, apart.at_ns, apart.distance)
                figures = dict(zip(TRUE_FIGURES, (error, station, gap), strict=True))
        return DataTable({**self._with_times(columns), **figures})

    @cached_property
    def _missing_verdicts(self) -> Mapping[Link, Sequence[MissingVerdict]]:
        if self.known_scenario is None:
            return {}
        return {link: account.missing for link, account in accounts(self.tables).items()}

    def outcomes(self, link: Link) -> DataTable:
        """Outcomes of the messages of a link, see `LinkRecord.outcomes`."""
        rows = self._outcomes(link)
        return DataTable({"t_s": self.seconds(rows.sent_at_ns), **rows._asdict()})

    def _outcomes(self, link: Link) -> LinkOutcomes:
        verdicts = self.columns_of("verdict").get(link[1])
        return link_outcomes(link, verdicts, self._missing_verdicts.get(link, ()))


def _listed(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())


class VehicleRecord:
    """Tables of one vehicle; each has the time `t_s` after the start and the instant `at_ns`."""

    def __init__(self, run: RunRecord, name: str) -> None:
        self._run, self.name = run, name

    @cached_property
    def true(self) -> DataTable:
        """True states of the car, with `error_m`, `station_m` and `gap_m`."""
        return self._run.true_table(self.name)

    @cached_property
    def gps(self) -> DataTable:
        """Poses as broadcast."""
        return self._run.table(self.name, "gps")

    @cached_property
    def tracking(self) -> DataTable:
        """Errors, mode and sources as the vehicle estimates them."""
        return self._run.table(self.name, "tracking")

    @cached_property
    def command(self) -> DataTable:
        """Commands to steering and drive."""
        return self._run.table(self.name, "command")

    @cached_property
    def trajectory(self) -> DataTable:
        """Composite trajectories."""
        return self._run.table(self.name, "trajectory")

    @cached_property
    def verdict(self) -> DataTable:
        """Verdicts on messages that the vehicle received."""
        return self._run.table(self.name, "verdict")

    @cached_property
    def health(self) -> DataTable:
        """Counters of the process."""
        return self._run.table(self.name, "health")

    def __repr__(self) -> str:
        return f"<vehicle {self.name}>"


class LinkRecord:
    """Messages of one link from sender to receiver."""

    def __init__(self, run: RunRecord, link: Link) -> None:
        self._run = run
        self.sender, self.receiver = link

    @cached_property
    def outcomes(self) -> DataTable:
        """A row for each message that was sent, in the order of their numbers.

        `t_s` is the time of sending. `outcome` is "delivered", "dropped", "not_arrived",
        "in_flight" at the end, or "unrecorded". `cause` is None unless the message was dropped or
        did not arrive. `delay_s` is the time until the receiver could use it, NaN unless it was
        delivered.
        """
        return self._run.outcomes((self.sender, self.receiver))

    def __repr__(self) -> str:
        return f"<link {self.sender} → {self.receiver}>"


# ---- Changes of the mode of a vehicle


class ModeFrom(NamedTuple):
    """The mode of a vehicle from `at_s` (s after the start) on."""

    at_s: float
    mode: str


def mode_changes(vehicle: VehicleRecord) -> tuple[ModeFrom, ...]:
    """List the modes of a vehicle, the first one included; none without a record of them."""
    try:
        modes, at_s = vehicle.tracking["mode"], vehicle.tracking["t_s"]
    except LogError:  # the topic was not recorded
        return ()
    if not len(modes):
        return ()
    changed = np.flatnonzero(modes[1:] != modes[:-1]) + 1
    return tuple(ModeFrom(float(at_s[row]), str(modes[row])) for row in [0, *changed.tolist()])
