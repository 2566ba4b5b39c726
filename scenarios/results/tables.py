"""The messages of a run as tables: a NumPy array per field, for each vehicle and topic.

Every metric is a function of these tables and the scenario, whether they come from a log or from a
virtual run in memory.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from transport.columns import Columns, Flags, Floats, Integers, columns_from, joined
from transport.topics import RUN_SENDER, TOPIC_OF, TOPICS
from vehicles.messages import (
    Change,
    Command,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND

Tables = Mapping[tuple[str, str], Columns]
"""Messages by (vehicle, topic)."""
KINDS: frozenset[type[Message]] = frozenset(
    {Change, Command, GpsPose, Health, LinkVerdict, LogText, RunStart, Tracking, TruePose}
)
"""Messages of which metrics are made; trajectories are only drawn."""
CONVERTED_EVERY = 4000
"""Messages that are converted at once, while they are in the processor's cache."""


class Signal(NamedTuple):
    """Values of a vehicle at instants (ns), NaN where they are unknown; shapes (N)."""

    at_ns: Integers
    values: Floats

    @property
    def known(self) -> "Signal":
        """The same without unknown values."""
        rows = ~np.isnan(self.values)
        return Signal(self.at_ns[rows], self.values[rows])


@dataclass(frozen=True)
class RunTables:
    """Messages of a run; a vehicle or a topic without messages has an empty table.

    `ran_ns` is the duration of the run (ns), at most the planned one.
    """

    scenario: Scenario
    tables: Tables
    ran_ns: int = 0
    results: dict[tuple[Any, ...], Any] = field(default_factory=dict, repr=False)
    """Results of functions of this run, see `once`."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the vehicles, the lead first."""
        return tuple(self.scenario.vehicle_names)

    @property
    def lead(self) -> str:
        return self.names[0]

    @property
    def followers(self) -> tuple[str, ...]:
        return self.names[1:]

    def ahead(self, follower: str) -> str:
        """Vehicle ahead of a follower."""
        return self.names[self.names.index(follower) - 1]

    def table(self, vehicle: str, topic: str) -> Columns:
        """Messages of a vehicle in the order of their numbers, each number once."""
        key = vehicle, topic
        if key not in self.results:
            columns = self.tables.get(key)
            self.results[key] = (
                columns_from(topic, [], [], vehicle) if columns is None else in_order(columns)
            )
        return cast("Columns", self.results[key])

    @cached_property
    def start_at(self) -> int | None:
        """Start of the run (ns); None if it was not recorded."""
        starts = self.table(RUN_SENDER, "start")
        return int(starts.at_ns[0]) if len(starts) else None

    @cached_property
    def beginning(self) -> int:
        """Start of the run (ns) or, if it was not recorded, the first true pose."""
        if self.start_at is not None:
            return self.start_at
        truths = [self.table(name, "truth").at_ns for name in self.names]
        return int(min([at.min() for at in truths if len(at)], default=0))

    def seconds(self, at: int | np.int64) -> float:
        """Seconds from the beginning to an instant (ns)."""
        return (int(at) - self.beginning) / SECOND

    @cached_property
    def last_at(self) -> Mapping[str, int]:
        """Instant (ns) of the last message of each vehicle; 0 without any.

        Instants later than a second after the recording are wrong time stamps.
        """
        last = dict.fromkeys(self.names, 0)
        for (name, topic), columns in self.tables.items():
            if name in last and topic != "log" and len(columns):
                stamped = np.minimum(columns.at_ns, columns.logged_at_ns + SECOND)
                last[name] = max(last[name], int(stamped.max()))
        return last

    def spans(self, vehicle: str, holds: Flags, topic: str = "truth") -> list[tuple[str, int, int]]:
        """Times in which a condition held: the vehicle, and first and last instant (ns).

        `holds` has an entry for each message of a vehicle and topic.
        """
        at = self.table(vehicle, topic).at_ns
        rows = spans(at, np.broadcast_to(holds, at.shape), QUIET_NS)
        return [(vehicle, int(at[first]), int(at[last])) for first, last in rows]

    def until(self, at: int) -> "RunTables":
        """The same run, cut at an instant (ns)."""
        tables = {key: columns.of(columns.at_ns <= at) for key, columns in self.tables.items()}
        return RunTables(self.scenario, tables, max(at - self.beginning, 0))


QUIET_NS = SECOND
"""Shorter breaks of a condition do not end its event."""


def spans(at: Integers, holds: Flags, quiet_ns: int | None = None) -> list[tuple[int, int]]:
    """First and last rows of the spans of a condition over rows at instants `at` (ns).

    Breaks of up to `quiet_ns` do not end a span; without it, any row without the condition does.
    """
    rows = np.flatnonzero(holds)
    if not len(rows):
        return []
    ends = np.diff(rows) > 1 if quiet_ns is None else np.diff(at[rows]) > quiet_ns
    firsts, lasts = rows[np.concatenate(([True], ends))], rows[np.concatenate((ends, [True]))]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def in_order(columns: Columns) -> Columns:
    """Sort messages by number; of several with one number the first in the log remains."""
    seq = columns["seq"]
    if bool((np.diff(seq) > 0).all()):  # the usual case
        return columns
    _, rows = np.unique(seq, return_index=True)
    return columns.of(rows)


def common(*instants: Integers) -> tuple[Integers, list[NDArray[np.intp]]]:
    """Instants that all arrays contain, in order, and their first rows in each of them.

    Messages from the bus may have wrong instants, so the arrays need not be sorted.
    """
    first, *more = instants
    if (np.diff(first) > 0).all() and all(np.array_equal(first, each) for each in more):
        return first, [np.arange(len(first))] * len(instants)  # the usual case
    at = np.unique(first)
    for others in more:
        at = np.intersect1d(at, others)
    orders = [np.argsort(each, kind="stable") for each in instants]
    rows = [
        order[np.searchsorted(each, at, sorter=order)]
        for each, order in zip(instants, orders, strict=True)
    ]
    return at, rows


class Collector:
    """Observer that keeps the messages of a run as tables."""

    def __init__(self, kinds: Iterable[type[Message]] = KINDS) -> None:
        self.kinds = frozenset(kinds)
        self._rows: list[tuple[int, Message]] = []
        self._last_at = 0
        self._parts: defaultdict[tuple[str, str], list[Columns]] = defaultdict(list)

    @property
    def last_at(self) -> int:
        """Instant (ns) of the last message; 0 without any."""
        return self._last_at if not self._rows else self._rows[-1][0]

    def listen(self, at: int, message: Message) -> None:
        """Keep a message that was recorded at an instant (ns)."""
        self._rows.append((at, message))
        if len(self._rows) >= CONVERTED_EVERY:
            self._convert()

    def _convert(self) -> None:
        self._last_at = self.last_at
        by_kind: defaultdict[type[Message], list[tuple[int, Message]]] = defaultdict(list)
        for row in self._rows:
            by_kind[type(row[1])].append(row)
        self._rows.clear()
        for kind, rows in by_kind.items():
            at, messages = zip(*rows, strict=True)
            columns = columns_from(TOPIC_OF[kind].name, messages, at)
            names = np.array([message.vehicle for message in messages])
            for vehicle in dict.fromkeys(names.tolist()):
                own = replace(columns.of(names == vehicle), vehicle=vehicle)
                self._parts[vehicle, columns.topic].append(own)

    def take(self) -> dict[tuple[str, str], Columns]:
        """Tables of the messages since the last call, which are released."""
        taken = self.tables()
        self._parts.clear()
        return taken

    def tables(self) -> dict[tuple[str, str], Columns]:
        """Tables of all messages so far."""
        self._convert()
        for key, parts in self._parts.items():
            if len(parts) > 1:
                self._parts[key] = [joined(parts)]
        return {(name, topic): parts[0] for (name, topic), parts in self._parts.items()}


TOPICS_OF_METRICS = tuple(row.name for row in TOPICS.values() if row.message in KINDS)
"""Topics of which metrics are made."""


# ---- Functions of a run that others use: computed once for each run and arguments


Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")


def once(
    function: Callable[Concatenate[RunTables, Arguments], Result],
) -> Callable[Concatenate[RunTables, Arguments], Result]:
    """Keep the results of a function of a run, which has only positional, hashable arguments."""

    @wraps(function)
    def known(run: RunTables, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        key = (function.__qualname__, *args)
        if key not in run.results:
            run.results[key] = function(run, *args, **kwargs)
        return cast("Result", run.results[key])

    return cast("Callable[Concatenate[RunTables, Arguments], Result]", known)
