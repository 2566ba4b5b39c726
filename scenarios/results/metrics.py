"""Figures of a run, gathered message by message: live, in virtual time, or from a log."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from operator import attrgetter
from typing import Any

from scenarios.definition.changes import VEHICLE_CHANGES, is_changed
from scenarios.definition.changing.asked import changed_links
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.links import LinkTable
from scenarios.definition.sending import sends_every_instant
from scenarios.results.channel.account import LinkSummary, link_summary, misses
from scenarios.results.channel.alarms import AlarmSummary, AlarmTally
from scenarios.results.channel.tally import LinkTally
from scenarios.results.degradation.deadlines import Deadlines
from scenarios.results.events.bodies import BodySize
from scenarios.results.events.run_event import EventLog
from scenarios.results.holes import RecordHole
from scenarios.results.stream import FigureStream
from scenarios.results.vehicles.figures import (
    USUAL_CONTROL_RATE_HZ,
    USUAL_RATE_HZ,
    RunSpan,
    VehicleFigures,
    VehicleSummary,
)
from transport.topics import TOPIC_OF
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.car.tyres import linear_range
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import (
    Change,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import nanoseconds

MOST_WARNINGS = 50
"""Lines about stamps that cannot be right that the summary holds."""
_Source = tuple[LinkTally, AlarmTally]
"""What is kept of the link from one source of a follower."""


class Metrics:
    """Gathers the figures of a run from its messages."""

    def __init__(
        self,
        vehicles: Sequence[str],
        requested: Mapping[tuple[str, str], LinkTable],
        road_yaw: float | None = None,
        *,
        stream: FigureStream | None = None,
        rates_hz: Mapping[str, float | None] | None = None,
        control_rate_hz: float = USUAL_CONTROL_RATE_HZ,
        duration_ns: int = 0,
        linear_slips: Mapping[str, tuple[float, float]] | None = None,
        deadlines: Deadlines | None = None,
    ) -> None:
        """Take the vehicles' names, lead first, and what was asked of each (sender, receiver).

        `road_yaw` (rad) is the direction of the road on which the convoy starts; `rates_hz` are
        those at which poses are sent from the start on, None for a vehicle whose poses come by no
        such schedule; `duration_ns` is as planned; `linear_slips` are the slip angles
        (rad) of front and rear axle up to which each vehicle's tyres are linear; `deadlines` are
        what followers have to have done by an instant. Without a `stream` of figures, one with
        usual cars and thresholds is made; others can subscribe to it, too.
        """
        self._names = list(vehicles)
        self._lead = self._names[0]
        self._requested = requested
        self._duration_ns = duration_ns
        self.stream = stream or FigureStream(
            dict.fromkeys(vehicles, BodySize.of(LINCOLN_MKZ)), road_yaw=road_yaw
        )
        self.events = EventLog(self.stream.seconds)
        self.stream.on_error(self._add_error)
        self.stream.on_event(self.events.add)
        self.warnings: list[str] = []
        self.out_of_linear: dict[str, str] = {}
        self._told_of_linear = 0
        self._linear_slips = linear_slips or dict.fromkeys(vehicles, linear_range(LINCOLN_MKZ))
        self.vehicles = {
            name: VehicleFigures(
                name,
                is_lead=name == self._lead,
                rate_hz=(rates_hz or {}).get(name, USUAL_RATE_HZ),
                control_rate_hz=control_rate_hz,
            )
            for name in vehicles
        }
        self.links: defaultdict[tuple[str, str], LinkTally] = defaultdict(LinkTally)
        self._alarms: defaultdict[tuple[str, str], AlarmTally] = defaultdict(AlarmTally)
        self.deadlines = deadlines or Deadlines()
        self._has_deadlines = bool(self.deadlines)
        self._ahead = {behind: ahead for ahead, behind in pairwise(self._names)}
        self._sources: dict[str, tuple[_Source | None, _Source | None]] = {}
        takes: Mapping[type[Message], Callable[[VehicleFigures, Any, int], None]] = {
            TruePose: self._add_truth,
            Tracking: self._add_tracking,
            GpsPose: self._add_pose,
            LinkVerdict: self._add_verdict,
            Health: self._add_health,
            Change: self._add_change,
        }
        self._takes = {
            kind: (take, attrgetter(TOPIC_OF[kind].instant)) for kind, take in takes.items()
        }
        self.kinds: frozenset[type[Message]] = frozenset((*self._takes, LogText, RunStart))

    @classmethod
    def of(cls, scenario: Scenario) -> "Metrics":
        """Figures of a run of `scenario`."""
        return cls(
            scenario.vehicle_names,
            scenario.links,
            scenario.route.start_yaw,
            stream=FigureStream.of(scenario),
            rates_hz={name: _steady_rate_hz(scenario, name) for name in scenario.vehicle_names},
            control_rate_hz=scenario.control_rate_hz,
            duration_ns=nanoseconds(scenario.duration_s),
            linear_slips={
                name: linear_range(scenario.vehicle(name).parameters)
                for name in scenario.vehicle_names
            },
            deadlines=Deadlines(scenario.tables.limits, scenario.lead),
        )

    @property
    def start_at(self) -> int | None:
        """The start of the run (ns), once that is known."""
        return self.stream.start_at

    @property
    def topics(self) -> list[str]:
        """Topics of the kinds of message that carry a figure."""
        return [TOPIC_OF[kind].name for kind in (*self._takes, LogText, RunStart)]

    def listen(self, _at: int, message: Message) -> None:
        """Take one message, as an observer of a run."""
        self.add(message)

    def add(self, message: Message) -> None:
        """Take one message; kinds that carry no figure, and strangers, are passed over."""
        if (found := self._takes.get(type(message))) is not None:
            figures = self.vehicles.get(message.vehicle)
            if figures is not None:
                take, instant_of = found
                at: int = instant_of(message)
                if at > figures.last_at:  # noqa: PLR1730 - twice as fast as max
                    figures.last_at = at
                take(figures, message, at)
        elif isinstance(message, LogText):
            self._add_text(message)
        elif isinstance(message, RunStart):
            self.stream.add(message)
            self.deadlines.begin(message.start_at_ns)

    def _add_text(self, text: LogText) -> None:
        if text.doubts_figures and len(self.warnings) < MOST_WARNINGS:
            self.warnings.append(f"{text.vehicle}: {text.text}")

    def _add_truth(self, figures: VehicleFigures, pose: TruePose, _at: int) -> None:
        figures.add_truth(pose)
        front, rear = self._linear_slips[pose.vehicle]
        tyres = figures.tyres
        if tyres.front_slip > front or tyres.rear_slip > rear:
            self._note_slips(pose, front, rear)
        self.stream.add_truth(pose)

    def _note_slips(self, pose: TruePose, front: float, rear: float) -> None:
        if pose.vehicle in self.out_of_linear:
            return
        after_s = self.stream.seconds(pose.true_at_ns)
        self.out_of_linear[pose.vehicle] = (
            f"{pose.vehicle}: its tyres left their linear range, up to {front:.4f} rad of slip in "
            f"front and {rear:.4f} rad behind, {after_s:.2f} s after the start"
        )

    def news(self) -> list[str]:
        """Lines about tyres that left their linear range since the last call."""
        if self._told_of_linear == len(self.out_of_linear):
            return []
        new = list(self.out_of_linear.values())[self._told_of_linear :]
        self._told_of_linear = len(self.out_of_linear)
        return new

    def _add_error(self, foot: CrossTrack) -> None:
        self.vehicles[foot.vehicle].add_error(foot)
        if self._has_deadlines:
            self.deadlines.add_error(foot.vehicle, foot.at_ns, foot.lateral)

    def _add_tracking(self, figures: VehicleFigures, tracking: Tracking, at: int) -> None:
        figures.add_tracking(tracking)
        if not figures.is_lead:
            self.stream.add_tracking(tracking)
            self._add_sources(tracking, at)
            if self._has_deadlines:
                self.deadlines.add_tracking(tracking)

    def _add_sources(self, tracking: Tracking, at: int) -> None:
        """Take how fresh each source is."""
        found = self._sources.get(tracking.vehicle)
        if found is None:
            found = self._sources[tracking.vehicle] = self._sources_of(tracking.vehicle)
        lead, ahead = found
        if lead is not None:
            link, alarms = lead
            link.add_age(tracking.lead_age_s)
            alarms.add(at, tracking.lead_status)
        if ahead is not None:
            link, alarms = ahead
            link.add_age(tracking.predecessor_age_s)
            alarms.add(at, tracking.predecessor_status)

    def _sources_of(self, name: str) -> tuple[_Source | None, _Source | None]:
        """Sources of a follower; the lead is the first follower's predecessor, too."""
        lead, ahead = self._lead, self._ahead[name]
        return self._source(lead, name), self._source(ahead, name) if ahead != lead else None

    def _source(self, sender: str, receiver: str) -> _Source | None:
        pair = sender, receiver
        return (self.links[pair], self._alarms[pair]) if pair in self._requested else None

    def _add_pose(self, figures: VehicleFigures, pose: GpsPose, _at: int) -> None:
        figures.add_pose(pose)

    def _add_health(self, figures: VehicleFigures, health: Health, _at: int) -> None:
        figures.add_health(health)

    def _add_change(self, figures: VehicleFigures, change: Change, _at: int) -> None:
        """From now on its poses come by no schedule, or links are not as they were asked for."""
        if change.kind in VEHICLE_CHANGES:
            figures.rate_hz = None
        for pair in changed_links(change.table, self._names, self._requested):
            self.links[pair].changed |= pair[1] == change.vehicle

    def _add_verdict(self, _receiver: VehicleFigures, verdict: LinkVerdict, _at: int) -> None:
        pair = verdict.sender, verdict.vehicle
        if pair in self._requested:
            self.links[pair].add(verdict)

    def finish(self) -> None:
        """Count the events that had not ended when the run did."""
        self.stream.finish()

    def vehicle_summaries(self, ran_ns: int = 0) -> tuple[VehicleSummary, ...]:
        """Figures per vehicle, the lead first, of a run of `ran_ns`."""
        span, gaps, seconds = self._span(ran_ns), self.stream.gaps, self.stream.seconds
        return tuple(
            figures.summary(span, gaps.get(name), seconds)
            for name, figures in self.vehicles.items()
        )

    def holes(self, ran_ns: int = 0) -> tuple[RecordHole, ...]:
        """Poses that were not recorded of a run of `ran_ns`, in order of time."""
        found = [
            hole
            for figures in self.vehicles.values()
            for holes in [figures.holes(self._span(ran_ns))]
            for hole in (*holes, *figures.true_holes(holes))
        ]
        return tuple(sorted(found, key=lambda hole: hole.from_s))

    def _span(self, ran_ns: int) -> RunSpan:
        return RunSpan(self.start_at, ran_ns, self._duration_ns)

    def link_summaries(self) -> tuple[LinkSummary, ...]:
        """Figures per directed link, by receiver and then sender from the lead on."""
        return tuple(self._link(link) for link in sorted(self._requested, key=self._order))

    def _order(self, link: tuple[str, str]) -> tuple[int, int]:
        sender, receiver = link
        return self._names.index(receiver), self._names.index(sender)

    def _link(self, link: tuple[str, str]) -> LinkSummary:
        requested, sent = self._requested[link], self.vehicles[link[0]].poses
        # Alarms count while the sender ran.
        alarms = AlarmSummary(counted=self._alarms[link].counted(self.vehicles[link[0]].last_at))
        return link_summary(link, requested, sent, self.links[link], alarms)

    def link_misses(self) -> Iterator[str]:
        """Say which links did something else than was asked of them, beyond sampling error."""
        for link in sorted(self._requested, key=self._order):
            yield from misses(link, self._requested[link], self.links[link])
        if changed := [f"{a} → {b}" for (a, b), one in sorted(self.links.items()) if one.changed]:
            these = ", ".join(changed)
            yield f"changed during the run, so not held against what was asked: {these}"


def _steady_rate_hz(scenario: Scenario, name: str) -> float | None:
    """Rate of the poses of a vehicle that sends at every instant of measuring, else None."""
    setup = scenario.vehicle(name)
    if is_changed(scenario.tables.change, name):
        return None
    return setup.gnss.rate if sends_every_instant(setup.sending, setup.gnss) else None
