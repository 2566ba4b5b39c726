"""One run watched for one limit: how near it came, when, and whether it broke it; there it ends.

Cheaper than a summary: of all figures only those are worked out that the limit depends on. Whether
the limit is broken is what `Limit.broken_by` says of the summary of the whole run.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Literal, Protocol

from scenarios.definition.scenario import Scenario
from scenarios.results.events.detector import LaneWatch, PathWatch, sizes_of
from scenarios.results.events.encounters import Encounters, Episode
from scenarios.results.limits import collision_ends_run
from scenarios.runs.virtual.convoy import Branch
from scenarios.runs.virtual.drive import drive
from scenarios.studies.many.limit import EVENTS, Limit
from vehicles.geometry.driven_path import CrossTrackError
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import SECOND

Measure = Literal["limit", "silence"]
"""How near a run is to a limit: by what the limit is about, or by how long nothing was received."""


@dataclass(frozen=True, slots=True)
class NearRecord:
    """At instant `at` (ns) the run came nearer to the limit than ever before: `value`.

    It is inf once the limit is broken; before, in the unit of the measure.
    """

    at: int
    value: float


@dataclass(frozen=True, slots=True)
class Watched:
    """What is known of a run; `records` are in order of time, each larger than the one before."""

    records: tuple[NearRecord, ...]

    @property
    def severity(self) -> float:
        """The last record: inf if the limit was broken, -inf if there was nothing to measure."""
        return self.records[-1].value if self.records else -inf

    @property
    def broken(self) -> bool:
        """Whether the limit was broken."""
        return self.severity == inf


class Watch(Protocol):
    """Follows one limit through the messages of a run."""

    broken: bool

    def take(self, message: Message) -> float:
        """Take a message; how near the run is to the limit now, negative where it holds."""
        ...

    def finish(self) -> None:
        """The run is over; what is certain only now may have broken the limit."""
        ...


class _Followed:
    """Base of watches: nothing is broken at first, and nothing becomes certain at the end."""

    def __init__(self) -> None:
        self.broken = False

    def finish(self) -> None:
        """Nothing waits."""


class DepartureWatch(_Followed):
    """No corner of a follower beyond the edge of the lane (m)."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__()
        width = scenario.tables.events.lane_width_m
        self._lane = LaneWatch(sizes_of(scenario), width, scenario.route.start_yaw)

    def take(self, message: Message) -> float:
        """Take a true pose."""
        if not isinstance(message, TruePose):
            return -inf
        self.broken |= bool(list(self._lane.add(message)))
        return max(self._lane.excess.values(), default=-inf)


class ErrorWatch(_Followed):
    """The true error of no follower beyond a bound (m)."""

    def __init__(self, scenario: Scenario, bound: float) -> None:
        super().__init__()
        lead, *followers = scenario.vehicle_names
        self._path = CrossTrackError(lead, scenario.route.start_yaw, followers)
        self._bound = bound

    def take(self, message: Message) -> float:
        """Take a true pose."""
        if not isinstance(message, TruePose):
            return -inf
        errors = [abs(foot.lateral) for foot in self._path.add(message)]
        excess = max(errors, default=-inf) - self._bound
        self.broken |= excess > 0.0
        return excess


class GapWatch(_Followed):
    """No gap between neighbours below a bound (m), or no collision or near miss of anybody."""

    def __init__(self, scenario: Scenario, kind: str = "", bound: float = 0.0) -> None:
        """`kind` is that of the event; without one the gaps themselves have the `bound`."""
        super().__init__()
        rules = scenario.tables.events
        self._met = Encounters(
            sizes_of(scenario), near_gap=rules.near_miss_gap_m, near_time=rules.near_miss_time_s
        )
        self._kind, self._bound = kind, bound

    def take(self, message: Message) -> float:
        """Take a true pose."""
        if not isinstance(message, TruePose):
            return -inf
        self._note(self._met.add(message))
        excess = self._bound - min((gap.now_m for gap in self._met.gaps.values()), default=inf)
        self.broken |= not self._kind and excess > 0.0
        return excess

    def finish(self) -> None:
        """Take the near misses that had not ended."""
        self._note(self._met.finish())

    def _note(self, episodes: Sequence[Episode]) -> None:
        self.broken |= any(episode.kind == self._kind for episode in episodes)


class LostPathWatch(_Followed):
    """No follower without a path for too long; its measure is that of silence (s)."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__()
        self._path = PathWatch(scenario.tables.events.path_lost_s)
        self._lead = scenario.vehicle_names[0]

    def take(self, message: Message) -> float:
        """Take what a follower steers along."""
        if isinstance(message, Tracking) and message.vehicle != self._lead:
            self.broken |= bool(list(self._path.add(message)))
        return silence(message, self._lead)


def silence(message: Message, lead: str) -> float:
    """For how long (s) a follower has received nothing from anybody; -inf before it ever did.

    Told by what it steers along; -inf for other messages, and those of the `lead`.
    """
    if not isinstance(message, Tracking) or message.vehicle == lead:
        return -inf
    ages = (message.lead_age_s, message.predecessor_age_s)
    return min((age for age in ages if not isnan(age)), default=-inf)


def watch_of(limit: Limit, scenario: Scenario) -> Watch:
    """Make what follows `limit` through a run of `scenario`."""
    match limit.word:
        case "lane":
            return DepartureWatch(scenario)
        case "path_lost":
            return LostPathWatch(scenario)
        case "error_m":
            return ErrorWatch(scenario, limit.bound)
        case "gap_m":
            return GapWatch(scenario, bound=limit.bound)
    return GapWatch(scenario, EVENTS[limit.word])


class WatchedRun:
    """An observer of a virtual run that follows one limit, and ends the run once it is broken."""

    kinds: frozenset[type[Message]] = frozenset((TruePose, Tracking))

    def __init__(self, scenario: Scenario, limit: Limit, measure: Measure = "limit") -> None:
        self.is_over = False
        self._watch = watch_of(limit, scenario)
        self._lead = scenario.vehicle_names[0]
        self._measures_silence = measure == "silence"
        # A collision ends a logged run as well: later messages do not count there either.
        self._limits = scenario.tables.limits
        ends = collision_ends_run(self._limits, 1 + (self._limits.collisions_max or 0))
        self._collisions = Encounters(sizes_of(scenario)) if ends else None
        self._collided = 0
        self._records: list[NearRecord] = []

    def listen(self, at: int, message: Message) -> None:
        """Take a message of one of the vehicles at instant `at` (ns)."""
        if self.is_over:
            return
        value = self._watch.take(message)
        if self._watch.broken:
            self._note(at, inf)
            self.is_over = True
            return
        if self._measures_silence:
            value = silence(message, self._lead)
        self._note(at, value)
        if self._collisions is not None and isinstance(message, TruePose):
            met = self._collisions.add(message)
            self._collided += sum(episode.kind == "collision" for episode in met)
            self.is_over = collision_ends_run(self._limits, self._collided)

    def finish(self, at: int) -> Watched:
        """Return what is known of the run, which ended at instant `at` (ns)."""
        self._watch.finish()
        if self._watch.broken:
            self._note(at, inf)
        return Watched(tuple(self._records))

    def _note(self, at: int, value: float) -> None:
        if value > (self._records[-1].value if self._records else -inf):
            self._records.append(NearRecord(at, value))


def watched(
    scenario: Scenario,
    limit: Limit,
    *,
    branches: Sequence[Branch] = (),
    measure: Measure = "limit",
) -> Watched:
    """Run `scenario` in virtual time until it breaks `limit`, or to its end.

    Random numbers come from other seeds after the instants of the `branches`. A fault of a vehicle
    ends the run.
    """
    run = WatchedRun(scenario, limit, measure)
    outcome = drive(scenario, [run], until=lambda: run.is_over, branches=branches)
    return run.finish(outcome.at)


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """The same scenario with another seed."""
    return Scenario(scenario.tables.model_copy(update={"seed": seed}))


def after_start_s(scenario: Scenario, at: int) -> float:
    """Seconds from the start of the virtual run to an instant (ns)."""
    return (at - scenario.start_at_ns) / SECOND
