"""How close a run comes to a limit over time, and whether it breaks it.

Faster than a summary, because only the figures of the limit are computed. The result agrees with
`broken_by` on the summary of the whole run.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Literal

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.results.events.encounters import Episode
from scenarios.results.limits.evaluation import collision_ends_run, severity
from scenarios.results.limits.live_limit import LiveLimit
from scenarios.results.stream import FigureStream
from scenarios.runs.virtual.drive import drive
from scenarios.runs.virtual.unlogged_run import run_unlogged
from scenarios.runs.virtual.virtual_convoy import Branch
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import nanoseconds

Measure = Literal["limit", "silence"]
"""Severity of a run: the figure of the limit, or the longest time without data."""


@dataclass(frozen=True, slots=True)
class SeverityRecord:
    """The severity reached a new maximum `value` at instant `at` (ns).

    In the unit of the measure, or inf if the limit is broken.
    """

    at: int
    value: float


@dataclass(frozen=True, slots=True)
class LimitHistory:
    """The increasing severity of a run, in order of time."""

    records: tuple[SeverityRecord, ...]

    @property
    def severity(self) -> float:
        """The largest severity: inf if the limit was broken, -inf if nothing was measured."""
        return self.records[-1].value if self.records else -inf

    @property
    def broken(self) -> bool:
        return self.severity == inf


def silence(message: Message, lead: str) -> float:
    """Time (s) since a follower last received a pose; -inf before the first pose.

    Also -inf for the lead, and for messages other than `Tracking`.
    """
    if not isinstance(message, Tracking) or message.vehicle == lead:
        return -inf
    ages = (message.lead_age_s, message.predecessor_age_s, *message.other_age_s)
    return min((age for age in ages if not isnan(age)), default=-inf)


class LimitObserver:
    """Observer of a virtual run that tracks a limit and stops the run when it is broken."""

    kinds: frozenset[type[Message]] = frozenset((TruePose, Tracking))

    def __init__(self, scenario: Scenario, limit: Limit, measure: Measure = "limit") -> None:
        self.is_finished = False
        self._lead = scenario.lead
        self._measures_silence = measure == "silence" or limit.row.live == "silence"
        self._limits = scenario.tables.limits
        self._collisions = 0
        self._records: list[SeverityRecord] = []
        self._stream = FigureStream.of(scenario)
        self._live = LiveLimit(limit, self._stream, scenario.vehicle_names)
        # As in a logged run, messages after a collision that ends the run do not count.
        if collision_ends_run(self._limits, 1 + (self._limits.collisions_max or 0)):
            self._stream.on_event(self._count_collision, ("collision",))

    def _count_collision(self, _event: Episode) -> None:
        self._collisions += 1

    def listen(self, at: int, message: Message) -> None:
        if self.is_finished:
            return
        self._stream.listen(at, message)
        excess = self._live.latest_excess()
        if self._live.broken:
            self._record(at, inf)
            self.is_finished = True
            return
        self._record(at, self._silence(message) if self._measures_silence else excess)
        if self._collisions:
            self.is_finished = collision_ends_run(self._limits, self._collisions)

    def _silence(self, message: Message) -> float:
        """Time without data (s) of a follower to which the limit applies, else -inf."""
        applies = self._live.limit.vehicle in {"", message.vehicle}
        return silence(message, self._lead) if applies else -inf

    def finish(self, at: int) -> LimitHistory:
        """Return the history of the run, which ended at instant `at` (ns)."""
        self._stream.finish()
        self._live.finish()
        if self._live.broken:
            self._record(at, inf)
        return LimitHistory(tuple(self._records))

    def _record(self, at: int, value: float) -> None:
        if value > (self._records[-1].value if self._records else -inf):
            self._records.append(SeverityRecord(at, value))


def watch_limit(
    scenario: Scenario,
    limit: Limit,
    *,
    branches: Sequence[Branch] = (),
    measure: Measure = "limit",
) -> LimitHistory:
    """Run `scenario` in virtual time until it breaks `limit`, or to its end.

    After the instants of the `branches`, random numbers come from other seeds. A failed vehicle
    ends the run. Raises PlugInError if the limit is on a figure of the user's class that fails.
    """
    if limit.row.live == "end" and measure == "limit":
        return _known_at_end(scenario, limit, branches)
    observer = LimitObserver(scenario, limit, measure)
    outcome = drive(scenario, [observer], until=lambda: observer.is_finished, branches=branches)
    return observer.finish(outcome.at)


def _known_at_end(scenario: Scenario, limit: Limit, branches: Sequence[Branch]) -> LimitHistory:
    summary = run_unlogged(scenario, branches=branches)
    value = severity(limit, summary)
    at = scenario.start_at_ns + nanoseconds(summary.ran_s)
    return LimitHistory((SeverityRecord(at, inf if value > 0.0 else value),))


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    return Scenario(scenario.tables.model_copy(update={"seed": seed}))
