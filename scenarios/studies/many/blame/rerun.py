"""One run with other losses: its worst figure, and whether it breaks a limit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.results.drives import KINDS
from scenarios.results.events.encounters import TrueGap
from scenarios.results.limits.live_limit import LiveLimit
from scenarios.results.stream import FigureStream
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual.drive import drive
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Message, TruePose
from vehicles.schedule import SECOND

FigureName = Literal["error", "gap"]
"""The largest true cross-track error of a follower, or the smallest true gap to its predecessor."""
Truth = Mapping[tuple[str, int], tuple[float, float]]
"""True poses (east, north, m) by vehicle and instant (ns after the start)."""
NO_END = 2**63


@dataclass(frozen=True, slots=True, kw_only=True)
class RerunCriteria:
    """Figure and limit to evaluate, until an instant (ns after the start)."""

    figure: FigureName
    limit: Limit
    until: int = NO_END


@dataclass(frozen=True, slots=True, kw_only=True)
class RerunResult:
    """The worst figure of a run (m), its vehicle and instant, and the breach of the limit.

    `badness_m` is the error or the negative gap. Instants are in ns after the start; `broken_at` is
    None if the limit was kept. `series` are instants (s) and figures (m) of each vehicle, if
    requested.
    """

    badness_m: float
    vehicle: str
    worst_at: int
    broken_at: int | None
    series: dict[str, list[list[float]]] = field(default_factory=dict)

    @property
    def figure_m(self) -> float:
        return abs(self.badness_m)


class RerunObserver:
    kinds: frozenset[type[Message]] = KINDS

    def __init__(self, scenario: Scenario, criteria: RerunCriteria, start_at: int) -> None:
        self.criteria = criteria
        self._start_at = start_at
        self._stream = FigureStream.of(scenario)
        if criteria.figure == "error":
            self._stream.on_error(self._record_error)
        else:
            self._stream.on_gap(self._record_gap)
        self._live = LiveLimit(criteria.limit, self._stream, scenario.vehicle_names)
        self._series: dict[str, list[list[float]]] = {
            name: [] for name in scenario.vehicle_names[1:]
        }
        self._worst = (-inf, "", 0)
        self.broken_at: int | None = None
        self.now = 0

    def listen(self, at: int, message: Message) -> None:
        """Process a message; ignored after `criteria.until`."""
        if isinstance(message, TruePose):
            self.now = message.true_at_ns - self._start_at
        if self.now <= self.criteria.until:
            self._stream.listen(at, message)
            self._note_breach()

    def _record_error(self, foot: CrossTrack) -> None:
        self._note(foot.vehicle, foot.at_ns, abs(foot.lateral))

    def _record_gap(self, gap: TrueGap) -> None:
        self._note(gap.vehicle, gap.now_at_ns, -gap.now_m)

    def _note(self, vehicle: str, at: int, badness: float) -> None:
        after = at - self._start_at
        self._series[vehicle].append([after / SECOND, abs(badness)])
        if badness > self._worst[0]:
            self._worst = badness, vehicle, after

    def _note_breach(self) -> None:
        if self._live.broken and self.broken_at is None:
            self.broken_at = self.now

    def result(self, *, whole: bool = False) -> RerunResult:
        self._stream.finish()
        self._note_breach()
        badness, vehicle, at = self._worst
        return RerunResult(
            badness_m=badness if vehicle else 0.0,
            vehicle=vehicle,
            worst_at=at,
            broken_at=self.broken_at,
            series=self._series if whole else {},
        )


def result_of(
    scenario: Scenario, criteria: RerunCriteria, start_at: int, messages: Iterable[Message]
) -> RerunResult:
    observer = RerunObserver(scenario, criteria, start_at)
    for message in messages:
        observer.listen(start_at, message)
    return observer.result(whole=True)


def rerun(
    scenario: Scenario,
    criteria: RerunCriteria,
    *,
    whole: bool = False,
    ends_when_broken: bool = False,
) -> RerunResult:
    """Run in virtual time until `criteria.until`; `whole`: with series.

    A failed vehicle ends the run.
    """
    observer = RerunObserver(scenario, criteria, scenario.start_at_ns)

    def is_over() -> bool:
        broken = ends_when_broken and observer.broken_at is not None
        return broken or observer.now > criteria.until

    drive(scenario, [observer], until=is_over)
    return observer.result(whole=whole)


def first_difference(scenario: Scenario, truth: Truth) -> tuple[str, int] | None:
    """Run in virtual time; return vehicle and instant of the first true pose unlike `truth`."""
    poses: dict[tuple[str, int], tuple[float, float]] = {}

    def listen(_at: int, message: Message) -> None:
        if isinstance(message, TruePose):
            at = message.true_at_ns - scenario.start_at_ns
            poses[message.vehicle, at] = message.east_m, message.north_m

    drive(scenario, [OnMessage(listen, frozenset([TruePose]))])
    instants = sorted(truth, key=lambda key: (key[1], key[0]))
    return next((key for key in instants if poses.get(key) != truth[key]), None)
