"""Metrics of a running convoy: the same functions over the last seconds of its tables."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.events import (
    Event,
    distrusts,
    encounters,
    in_time_order,
    lane_departures,
    slides,
    stops,
)
from scenarios.results.tables import QUIET_NS, Collector, RunTables
from scenarios.results.true_motion import (
    cross_track_error,
    gaps,
)
from transport.columns import Columns, columns_from, joined
from transport.topics import counts_as_loss
from vehicles.messages import (
    Change,
    Health,
    LinkVerdict,
    Message,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND

LIVE_KINDS: frozenset[type[Message]] = frozenset(
    {Change, Health, LinkVerdict, RunStart, Tracking, TruePose}
)
WINDOW_NS = 5 * SECOND
"""Time of which messages are kept, besides the lead's path and the first pose of each vehicle."""
PATIENCE_NS = SECOND
"""A vehicle whose poses are further behind the newest ones is not waited for."""


@dataclass(frozen=True, slots=True)
class LiveValues:
    """Current metrics of one vehicle, NaN where unknown, and its worst ones so far (m, m/s).

    `delivered`, `dropped` and `late` count the messages that it received; late ticks count as late.
    """

    error_m: float = np.nan
    error_m_max: float = np.nan
    gap_m: float = np.nan
    gap_m_min: float = np.nan
    estimated_error_m: float = np.nan
    speed_mps: float = np.nan
    mode: str = ""
    delivered: int = 0
    dropped: int = 0
    late: int = 0


class LiveRun:
    """Observer that keeps the last seconds of a run as tables, and its metrics up to now.

    `update` evaluates the rows up to an instant that every vehicle has passed. Of the whole run it
    keeps only the lead's path.
    """

    kinds = LIVE_KINDS

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.values = {name: LiveValues() for name in scenario.vehicle_names}
        self.events: list[Event] = []
        """Events so far: those that are certain at once, and at the end of the run all."""
        self.new_rows: Mapping[tuple[str, str], Columns] = {}
        """Rows of the last update."""
        self.window = RunTables(scenario, {})
        """Tables of the last seconds, and of the lead's whole path."""
        self.evaluated_until = 0
        self._collector = Collector(self.kinds)
        self._parts: defaultdict[tuple[str, str], list[Columns]] = defaultdict(list)
        self._passed = dict.fromkeys(scenario.vehicle_names, 0)
        self._newest_events: dict[tuple[str, ...], int] = {}
        self._late_messages: Counter[str] = Counter()

    def listen(self, at: int, message: Message) -> None:
        if type(message) is TruePose and message.vehicle in self._passed:
            self._passed[message.vehicle] = message.true_at_ns
        elif type(message) is RunStart:
            self._passed = dict.fromkeys(self._passed, message.start_at_ns - 1)
        self._collector.listen(at, message)

    @property
    def now(self) -> int:
        """Newest instant (ns) that every vehicle has passed."""
        newest = max(self._passed.values())
        return min(at for at in self._passed.values() if at >= newest - PATIENCE_NS)

    @property
    def seconds(self) -> float:
        """Time (s) of the run so far."""
        return max(self.evaluated_until - self.window.beginning, 0) / SECOND

    def update(self) -> bool:
        """Evaluate the rows since the last update; returns whether there are any."""
        now = self.now
        if now <= self.evaluated_until and self.window.tables:
            return False
        since, self.evaluated_until = self.evaluated_until, now
        self.new_rows = self._collector.take()
        for key, columns in self.new_rows.items():
            self._parts[key].append(columns)
        tables = {key: self._kept(key) for key in self._parts}
        beginning = RunTables(self.scenario, tables).beginning
        self.window = RunTables(self.scenario, tables, max(now - beginning, 0))
        for name in self.values:
            self.values[name] = self._values(name)
        self._find_events(since)
        return True

    def _kept(self, key: tuple[str, str]) -> Columns:
        """Join the rows to keep: the window, the lead's poses, and the first row of each table."""
        columns = joined(self._parts[key])
        is_path = key == (self.scenario.lead, "truth")
        if not is_path and key[1] != "change" and len(columns):
            keep = columns.at_ns >= self.evaluated_until - WINDOW_NS
            keep[0] = True
            columns = columns.of(keep)
        self._parts[key] = [columns]
        return columns

    def _values(self, name: str) -> LiveValues:
        run, before, unknown = self.window, self.values[name], np.zeros(0)
        tables = [run.table(name, topic) for topic in ("truth", "tracking", "health")]
        truth, tracking, health = tables
        errors, distances = unknown, unknown
        if name != run.lead:
            errors, distances = cross_track_error(run, name), gaps(run, name).distance
        verdicts = self.new_rows.get((name, "verdict"), columns_from("verdict", [], []))
        is_delivered = verdicts["outcome"] == "delivered"
        self._late_messages[name] += int(verdicts["late"].sum())
        return LiveValues(
            error_m=_last(errors[~np.isnan(errors)], np.nan),
            error_m_max=float(np.fmax.reduce(np.abs(errors), initial=before.error_m_max)),
            gap_m=_last(distances[~np.isnan(distances)], np.nan),
            gap_m_min=float(np.fmin.reduce(distances, initial=before.gap_m_min)),
            estimated_error_m=_last(tracking["lateral_error_m"], np.nan),
            speed_mps=_last(truth["speed_mps"], np.nan),
            mode=_last(tracking["mode"], ""),
            delivered=before.delivered + int(is_delivered.sum()),
            dropped=before.dropped + sum(map(counts_as_loss, verdicts["reason"][~is_delivered])),
            late=self._late_messages[name] + _last(health["late_ticks"], 0),
        )

    def _find_events(self, since: int) -> None:
        """Add new events; near misses once they have ended without a collision."""
        run = self.window
        found = [*encounters(run)]
        for name in run.names:
            found += [*slides(run, name), *stops(run, name)]
        for name in run.followers:
            found += [*lane_departures(run, name), *distrusts(run, name)]
        begin = self.evaluated_until - WINDOW_NS + QUIET_NS if since else 0
        for event in in_time_order(found):
            key = (event.kind, *event.vehicles)
            is_known = event.at_ns < begin or event.at_ns <= self._newest_events.get(key, -1)
            if not is_known and not (event.kind == "near_miss" and self._may_continue(event)):
                self._newest_events[key] = event.at_ns
                self.events.append(event)

    def _may_continue(self, event: Event) -> bool:
        apart = gaps(self.window, event.vehicles[1])
        near = self.scenario.tables.events.near_miss_gap_m
        recent = apart.at_ns > self.evaluated_until - QUIET_NS
        return bool((apart.distance[recent] < near).any())


def _last(values: NDArray[Any], unknown: Any) -> Any:
    return [unknown, *values[-1:].tolist()][-1]
