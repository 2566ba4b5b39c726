"""A recorded run: the messages of its log as tables, by vehicle and by link."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.data_table import Array, DataTable, UnknownNameError, Values
from scenarios.results.link_account import CAUSE_WORDS, Link, LinkAccount, accounts
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
from transport.columns import Columns, columns_from
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import TOPICS
from vehicles.schedule import SECOND

ORIGIN_SCHEMA = "convoy.export/1"
TRUE_COLUMNS = {
    "east_m": "east_m",
    "north_m": "north_m",
    "yaw_rad": "yaw_rad",
    "speed_mps": "speed_mps",
    "error_m": "true_error_m",
    "station_m": "station_m",
    "gap_m": "true_gap_m",
}
"""Columns of the table of all vehicles from true poses, by their names there."""
OWN_COLUMNS = (
    "lateral_error_m",
    "heading_error_rad",
    "estimated_gap_m",
    "measured_gap_m",
    "lead_age_s",
    "predecessor_age_s",
    "mode",
)
"""Columns from the vehicle's decisions: what it estimates and does, and the age of its data."""
Key = TypeVar("Key")
Entry = TypeVar("Entry")


class Named(dict[Key, Entry], Generic[Key, Entry]):
    """Entries by name in order; an unknown name raises Error with those that exist."""

    def __init__(self, kind: str, entries: Mapping[Key, Entry]) -> None:
        super().__init__(entries)
        self._kind = kind

    def __missing__(self, name: Key) -> Entry:
        raise UnknownNameError(self._kind, name, list(self))

    def __repr__(self) -> str:
        return f"<{self._kind}s: {', '.join(map(str, self))}>"


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
        thinned = [f"{topic} {rate}" for topic, rate in self._reader.thinned.items()]
        return {
            "log": str(self.log),
            **self._reader.metadata().get(METADATA_NAME, {}),
            "schema": ORIGIN_SCHEMA,
            "log_faults": self.faults.removeprefix(f"{self.log}: "),
            "thinned_hz": ", ".join(thinned),
        }

    @cached_property
    def summary(self) -> RunSummary:
        """Figures of the run, as in `summary.json`; those of an incomplete log are computed."""
        return summary_of(self.log)

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario that the log holds; raises LogError if it is damaged."""
        return scenario_in(self._reader)

    @cached_property
    def tables(self) -> RunTables:
        """Messages of which metrics are made, and the functions' argument; raises LogError."""
        return tables_in(self._reader, self.scenario)

    @property
    def start_at_ns(self) -> int:
        """Instant of the start; without its record, that of the first true pose."""
        return self.tables.beginning

    @property
    def vehicle_names(self) -> Sequence[str]:
        """Names of the vehicles, the lead first."""
        return self.scenario.vehicle_names

    @cached_property
    def vehicles(self) -> Named[str, "VehicleRecord"]:
        """Tables of each vehicle, the lead first."""
        return Named("vehicle", {name: VehicleRecord(self, name) for name in self.vehicle_names})

    @cached_property
    def links(self) -> Named[Link, "LinkRecord"]:
        """Tables of each link, by (sender, receiver)."""
        return Named("link", {link: LinkRecord(self, link) for link in self._accounts})

    @property
    def _accounts(self) -> Mapping[Link, LinkAccount]:
        return accounts(self.tables)

    @cached_property
    def texts(self) -> DataTable:
        """Lines of text of all vehicles and of the recorder ("run"), in order of time."""
        none = columns_from("log", [], [])  # a log may hold no texts
        tables = {"": none, **self.columns_of("log")}
        columns = {
            "at_ns": [rows.logged_at_ns for rows in tables.values()],
            "vehicle": [np.full(len(rows), name, object) for name, rows in tables.items()],
            "level": [rows["level"] for rows in tables.values()],
            "text": [rows["text"] for rows in tables.values()],
        }
        whole = {name: np.concatenate(parts) for name, parts in columns.items()}
        order = np.argsort(whole["at_ns"], kind="stable")
        whole = {name: column[order] for name, column in whole.items()}
        return DataTable({"t_s": self.seconds(whole["at_ns"]), **whole})

    @cached_property
    def states(self) -> DataTable:
        """All vehicles in one table: a row for each instant of a true pose or a decision.

        True position, speed, error and gap, and the errors and the mode that the vehicle reports.
        """
        columns = _joined([self._states_of(name) for name in self.vehicle_names])
        return DataTable({"t_s": self.seconds(columns["at_ns"]), **columns})

    def _states_of(self, name: str) -> dict[str, Array]:
        truth = self.true_table(name) if "truth" in self.topics_of(name) else None
        tracking = self.columns_of("tracking").get(name)
        instants = [table.at_ns for table in (truth, tracking) if table is not None]
        at: NDArray[np.int64] = np.unique(np.concatenate([np.zeros(0, np.int64), *instants]))
        columns: dict[str, Array] = {"at_ns": at, "vehicle": np.full(len(at), name, object)}
        columns |= {to: _at(at, truth, column) for column, to in TRUE_COLUMNS.items()}
        return columns | {column: _at(at, tracking, column) for column in OWN_COLUMNS}

    @cached_property
    def messages(self) -> DataTable:
        """All links in one table: a row for each sent message, see `LinkRecord.outcomes`."""
        none = LinkAccount(("", ""), 0, columns_from("verdict", [], []))
        return DataTable(_joined([*map(self._rows_of, (none, *self._accounts.values()))]))

    def _rows_of(self, account: LinkAccount) -> dict[str, Array]:
        rows = self._outcomes(account)
        sender, receiver = (np.full(len(rows["number"]), name, object) for name in account.link)
        times = {"t_s": self.seconds(rows["sent_at_ns"]), "sender": sender, "receiver": receiver}
        return times | rows

    def _outcomes(self, account: LinkAccount) -> dict[str, Array]:
        rows = _outcomes(account)
        return rows | {"distance_m": self._distance(account.link, rows["sent_at_ns"])}

    def _distance(self, link: Link, at_ns: Array) -> Array:
        """True distance (m) of the centres of mass of two vehicles at instants; NaN if unknown."""
        if not len(at_ns):
            return np.full(len(at_ns), np.nan)
        truths = [self.tables.table(name, "truth") for name in link]
        if not all(map(len, truths)):
            return np.full(len(at_ns), np.nan)
        (east, north), (other_east, other_north) = (
            [
                np.interp(at_ns, truth.at_ns, truth[axis], left=np.nan, right=np.nan)
                for axis in ("east_m", "north_m")
            ]
            for truth in truths
        )
        distance: Array = np.hypot(other_east - east, other_north - north)
        return distance

    def outcomes(self, link: Link) -> DataTable:
        """Outcomes of the messages of a link, see `LinkRecord.outcomes`."""
        rows = self._outcomes(self._accounts[link])
        return DataTable({"t_s": self.seconds(rows["sent_at_ns"]), **rows})

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

    def true_table(self, vehicle: str) -> DataTable:
        """True poses of a vehicle with `error_m`, `station_m` and `gap_m`, NaN if unknown.

        `error_m` is the offset to the left of the lead's driven path and the straight before it,
        `station_m` the place along it (0 at the lead's first pose), `gap_m` the distance of the
        bodies of the vehicle and of the one ahead.
        """
        columns = self._columns_of(vehicle, "truth")
        station = error = gap = np.full(len(columns), np.nan)
        if vehicle != self.tables.lead:
            run = self.tables
            columns, apart = run.table(vehicle, "truth"), gaps(run, vehicle)
            station, error = path_feet(run, vehicle)
            gap = at_instants(columns.at_ns, apart.at_ns, apart.distance)
        figures = {"error_m": error, "station_m": station, "gap_m": gap}
        return DataTable({**self._with_times(columns), **figures})

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


def _at(at_ns: NDArray[np.int64], table: DataTable | Columns | None, name: str) -> Array:
    """Values of a column at instants, unknown at others."""
    unknown, kind = (None, object) if name == "mode" else (np.nan, float)
    column: Array = np.full(len(at_ns), unknown, kind)
    if table is not None:
        column[np.searchsorted(at_ns, table.at_ns)] = table[name]
    return column


def _joined(tables: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Join tables of the same columns, one below the other."""
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def _outcomes(account: LinkAccount) -> dict[str, Array]:
    """Messages of a link in the order of their numbers, see `LinkRecord.outcomes`."""
    judged, (number, sent_at, fate, _) = account.verdicts, account.missing
    delivered, absent = account.is_delivered, np.isin(fate, list(CAUSE_WORDS))
    delays, unknown = account.delays / SECOND, np.full(len(fate), np.nan)
    fate, nothing = fate.astype(object), np.array(None, object)
    columns: dict[str, Array] = {
        "number": np.append(judged["pose_seq"], number),
        "sent_at_ns": np.append(judged["sent_at_ns"], sent_at),
        "outcome": np.append(judged["outcome"], np.where(absent, "not_arrived", fate)),
        "cause": np.append(
            np.where(delivered, nothing, judged["reason"]), np.where(absent, fate, nothing)
        ),
        "delay_s": np.append(np.where(delivered, delays, np.nan), unknown),
    }
    order = np.argsort(columns["number"], kind="stable")
    return {name: column[order] for name, column in columns.items()}


class VehicleRecord:
    """Tables of one vehicle; each has the time `t_s` after the start and the instant `at_ns`."""

    true: DataTable
    """True states of the car, with `error_m`, `station_m` and `gap_m`."""
    gps: DataTable
    """Poses as broadcast."""
    tracking: DataTable
    """Errors, mode and sources as the vehicle estimates them."""
    command: DataTable
    """Commands to steering and drive."""
    trajectory: DataTable
    """Composite trajectories."""
    verdict: DataTable
    """Verdicts on messages that the vehicle received."""
    health: DataTable
    """Counters of the process."""

    def __init__(self, run: RunRecord, name: str) -> None:
        self._run, self.name = run, name

    def __getattr__(self, topic: str) -> DataTable:
        """Read a table when it is first used; raises LogError for one that the log lacks."""
        if topic not in VehicleRecord.__annotations__:
            raise AttributeError(topic)
        table = (
            self._run.true_table(self.name)
            if topic == "true"
            else self._run.table(self.name, topic)
        )
        setattr(self, topic, table)
        return table

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *VehicleRecord.__annotations__]

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

        `t_s` is the time of sending. `outcome` is "delivered", "dropped", "not_arrived" (the real
        transport lost it or the receiver did not run), "in_flight" at the end, or "unrecorded" (the
        log lacks the verdict). `cause` is None unless the message was dropped or did not arrive.
        `delay_s` is the time until the receiver could use it, NaN unless it was delivered.
        `distance_m` is the true distance of both vehicles at the time of sending.
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
    rows = np.flatnonzero(np.append(True, modes[1:] != modes[:-1])[: len(modes)])
    return tuple(ModeFrom(float(at_s[row]), str(modes[row])) for row in rows)
