"""One run and one limit: how near the run came, when, and whether it broke the limit and ended.

Cheaper than a summary: only the figures of the limit are computed. The verdict agrees with that of
`broken_by` on the summary of the whole run.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Literal

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.results.events.encounters import Episode
from scenarios.results.limits.evaluation import collision_ends_run
from scenarios.results.limits.live_limit import LiveLimit
from scenarios.results.stream import FigureStream
from scenarios.runs.virtual.drive import drive
from scenarios.runs.virtual.virtual_convoy import Branch
from vehicles.messages import Message, Tracking, TruePose

Measure = Literal["limit", "silence"]
"""Nearness to a limit: by the limit's figure, or by how long nothing was received."""


@dataclass(frozen=True, slots=True)
class SeverityRecord:
    """At instant `at` (ns) the run came nearer to the limit than before: `value`.

    It is inf once the limit is broken; before, in the unit of the measure.
    """

    at: int
    value: float


@dataclass(frozen=True, slots=True)
class LimitHistory:
    """The records of a run, in order of time, each larger than the one before."""

    records: tuple[SeverityRecord, ...]

    @property
    def severity(self) -> float:
        """The last record: inf if the limit was broken, -inf if there was nothing to measure."""
        return self.records[-1].value if self.records else -inf

    @property
    def broken(self) -> bool:
        return self.severity == inf


def silence(message: Message, lead: str) -> float:
    """How long (s) a follower has received nothing from its sources; -inf before it ever did.

    -inf for messages other than `Tracking`, and those of the `lead`.
    """
    if not isinstance(message, Tracking) or message.vehicle == lead:
        return -inf
    ages = (message.lead_age_s, message.predecessor_age_s)
    return min((age for age in ages if not isnan(age)), default=-inf)


class LimitObserver:
    """An observer of a virtual run that follows one limit, and ends the run at a breach."""

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
        # A collision ends a logged run as well: later messages do not count there either.
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
        """How long (s) a follower to which the limit applies has received nothing."""
        applies = self._live.limit.vehicle in {"", message.vehicle}
        return silence(message, self._lead) if applies else -inf

    def finish(self, at: int) -> LimitHistory:
        """Return the records of the run, which ended at instant `at` (ns)."""
        self._stream.finish()
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

    Random numbers come from other seeds after the instants of the `branches`. A fault of a vehicle
    ends the run.
    """
    run = LimitObserver(scenario, limit, measure)
    outcome = drive(scenario, [run], until=lambda: run.is_finished, branches=branches)
    return run.finish(outcome.at)


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    return Scenario(scenario.tables.model_copy(update={"seed": seed}))
