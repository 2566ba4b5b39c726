"""The stream of figures of a run: values derived once from its messages, for all subscribers.

The messages of each vehicle come in order; how those of different vehicles are mixed does not
matter.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from math import nan
from typing import NamedTuple, get_args

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.scenario_tables import EventsTable
from scenarios.results.encounters import BodySize, Encounters, Episode, EventKind, TrueGap, body_of
from scenarios.results.run_event import OwnMeasures
from scenarios.results.traffic import OverrideWatch, TrafficWatch
from scenarios.results.watches import (
    LaneWatch,
    PathWatch,
    SlideWatch,
    StopWatch,
    TrackingWatch,
    TrustWatch,
)
from vehicles.car.tyres import SLIDING_SHARE
from vehicles.driver.controller import SpacingPolicy
from vehicles.geometry.driven_path import CrossTrack, CrossTrackError, PathWalk
from vehicles.messages import Change, Command, Message, RunStart, Tracking, TruePose
from vehicles.schedule import MILLISECOND, SECOND

ALL_EVENTS: tuple[EventKind, ...] = get_args(EventKind)
OF_TRAFFIC: frozenset[EventKind] = frozenset(
    {"falls_behind", "hard_braking", "overspeed", "stranded"}
)


class RoadError(NamedTuple):
    """Distance (m, left positive) of a vehicle from its road at an instant (ns)."""

    vehicle: str
    at_ns: int
    lateral: float


TakeError = Callable[[CrossTrack], None]
TakeRoadError = Callable[[RoadError], None]
TakeGap = Callable[[TrueGap], None]
TakeEvent = Callable[[Episode], None]
TakeTruth = Callable[[TruePose], None]
TakeTracking = Callable[[Tracking], None]


class FigureStream:
    """Observer that passes figures to its subscribers; nothing else is computed.

    Subscribe before the first message. `sizes` are the bodies, lead first. `gaps` holds the gap of
    each follower to its predecessor, if a subscriber needs gaps.
    """

    def __init__(
        self,
        sizes: Mapping[str, BodySize],
        rules: EventsTable | None = None,
        road_yaw: float | None = None,
        roads: Mapping[str, PathWalk] | None = None,
        replayed: Collection[str] = (),
        *,
        own: OwnMeasures | None = None,
        policies: Mapping[str, SpacingPolicy] | None = None,
        away: Collection[str] = (),
        control_rate_hz: float = 50.0,
    ) -> None:
        """Bodies, lead first, thresholds, and the yaw (rad) of the road at the start.

        `roads` are those of the vehicles, as far as known: the path of the scenario, and for
        `replayed` vehicles their own drive. `policies` are the gaps, bumper to bumper, of followers
        that keep one; vehicles that are `away` join later.
        """
        self.sizes = sizes
        self._lead, *self.followers = sizes
        self._rules = rules or EventsTable()
        self._path = CrossTrackError(self._lead, road_yaw, replayed=replayed)
        self._roads = roads or {}
        self.own = own or OwnMeasures(())
        self._lane: LaneWatch | None = None
        self._encounters: Encounters | None = None
        self._traffic = TrafficWatch(sizes, policies, away, replayed)
        self.overrides = OverrideWatch(self.followers, control_rate_hz)
        self._slides = SlideWatch()
        self._of_lead: tuple[TrackingWatch, ...] = (StopWatch(),)
        self._watches: tuple[TrackingWatch, ...] = (
            PathWatch(self._rules.path_lost_s),
            *self._of_lead,
            TrustWatch(list(sizes)),
        )
        self._on_foot: list[TakeError] = []
        self._on_road_error: list[TakeRoadError] = []
        self._on_gap: list[TakeGap] = []
        self._on_truth: list[TakeTruth] = []
        self._on_tracking: list[TakeTracking] = []
        self._on_event: dict[EventKind, list[TakeEvent]] = {kind: [] for kind in ALL_EVENTS}
        self.gaps: Mapping[str, TrueGap] = {}
        self._gaps_of: dict[str, list[TrueGap]] = {name: [] for name in sizes}
        self._places: dict[str, tuple[float, float]] = {}
        self.start_at: int | None = None
        self._first_at: int | None = None

    @property
    def kinds(self) -> frozenset[type[Message]]:
        """Messages that the subscribers so far need."""
        kinds: set[type[Message]] = {RunStart, Tracking, TruePose}
        if self._watches_traffic:
            kinds.add(Change)
        if self._on_event["overridden"]:
            kinds.add(Command)
        return frozenset(kinds)

    @property
    def _watches_traffic(self) -> bool:
        return any(self._on_event[kind] for kind in OF_TRAFFIC)

    @classmethod
    def of(cls, scenario: Scenario) -> "FigureStream":
        gap, names = scenario.tables.speed.gap, scenario.vehicle_names
        keep = names[1:] if scenario.tables.speed.followers == "gap" else ()
        return cls(
            sizes_of(scenario),
            scenario.tables.events,
            scenario.route.start_yaw,
            {name: PathWalk(*scenario.road_of(name)) for name in scenario.vehicle_names},
            scenario.replays.keys(),
            own=OwnMeasures.of(scenario),
            policies=dict.fromkeys(keep, SpacingPolicy(gap.standstill_m, gap.headway_s)),
            away=[name for name in names if scenario.joins_late(name)],
            control_rate_hz=scenario.control_rate_hz,
        )

    def on_foot(self, take: TakeError) -> None:
        """Subscribe to the foot point of each follower on the lead's path, from the start on."""
        self._on_foot.append(take)

    def on_error(self, take: TakeError) -> None:
        """Subscribe to the true error of each follower once it has passed the lead's start.

        On the stretch before, it starts its own motion, and there is no path that the lead drove.
        """
        self.on_foot(lambda foot: take(foot) if foot.station >= 0.0 else None)

    def on_road_error(self, take: TakeRoadError) -> None:
        """Subscribe to the true error of each vehicle with a known road."""
        self._on_road_error.append(take)

    def on_gap(self, take: TakeGap) -> None:
        """Subscribe to the true gap of each follower, once per instant of both vehicles."""
        self._compare_bodies()
        self._on_gap.append(take)

    def on_truth(self, take: TakeTruth) -> None:
        """Subscribe to the true poses of each vehicle, each passed on after its figures."""
        self._on_truth.append(take)

    def on_tracking(self, take: TakeTracking) -> None:
        """Subscribe to the decisions of each vehicle."""
        self._on_tracking.append(take)

    def on_event(self, take: TakeEvent, kinds: Sequence[EventKind] = ALL_EVENTS) -> None:
        """Subscribe to events of some kinds; figures of a continuing event still grow."""
        if "lane_departure" in kinds:
            self._watch_lane()
        if "collision" in kinds or "near_miss" in kinds:
            self._compare_bodies()
        for kind in kinds:
            self._on_event[kind].append(take)

    def _watch_lane(self) -> None:
        if self._lane is None:
            width = self._rules.lane_width_m
            self._lane = LaneWatch(self.sizes, width, self._path)

    def _compare_bodies(self) -> None:
        if self._encounters is not None:
            return
        self._encounters = Encounters(
            self.sizes,
            near_gap=self._rules.near_miss_gap_m,
            near_time=self._rules.near_miss_time_s,
        )
        gaps = self.gaps = self._encounters.gaps
        for name, behind in zip_longest(self.sizes, self.followers, fillvalue=""):
            self._gaps_of[name] = [
                gaps[follower] for follower in (name, behind) if follower in gaps
            ]

    def listen(self, _at: int, message: Message) -> None:
        """Take one message; those of unknown vehicles are ignored."""
        if isinstance(message, RunStart):
            self.start_at = message.start_at_ns
        elif message.vehicle in self.sizes:
            if isinstance(message, TruePose):
                self.add_truth(message)
            elif isinstance(message, Tracking):
                self.add_tracking(message)
            elif isinstance(message, Command):
                self.add_command(message)
            elif isinstance(message, Change):
                self.add_change(message)

    def add_truth(self, pose: TruePose) -> None:
        name, at = pose.vehicle, pose.true_at_ns
        if self._first_at is None or at < self._first_at:
            self._first_at = at
        self._places[name] = (pose.east_m, pose.north_m)
        lane, encounters = self._lane, self._encounters
        if self._on_road_error:
            self._pass_road_error(pose)
        feet: list[CrossTrack] = []
        if self._on_foot or (lane is not None and name == self._lead):
            feet = self._path.add(pose)
            if feet:
                self._pass_errors(feet)
        body = body_of(pose, self.sizes[name])
        if encounters is not None:
            self._pass_on(encounters.add(pose, body))
        if pose.friction_ratio >= SLIDING_SHARE:
            self._pass_on(self._slides.add(pose))
        self._pass_on(lane.add(pose, body, feet) if lane is not None else ())
        self._pass_on(self._traffic.add(pose, body) if self._watches_traffic else ())
        if self._on_gap:
            self._pass_gaps(name, at)
        self._pass_on(self.own.add(pose))
        for take_truth in self._on_truth:
            take_truth(pose)

    def _pass_road_error(self, pose: TruePose) -> None:
        if (road := self._roads.get(pose.vehicle)) is not None:
            _, offset = road.foot(pose.east_m, pose.north_m, pose.distance_m)
            for take in self._on_road_error:
                take(RoadError(pose.vehicle, pose.true_at_ns, offset))

    def _pass_errors(self, feet: Iterable[CrossTrack]) -> None:
        for foot in feet:
            if foot.vehicle in self.sizes:
                for take in self._on_foot:
                    take(foot)

    def _pass_gaps(self, name: str, at: int) -> None:
        for gap in self._gaps_of[name]:
            if gap.now_at_ns == at:
                for take in self._on_gap:
                    take(gap)

    def _pass_on(self, episodes: Iterable[Episode]) -> None:
        for episode in episodes:
            for take in self._on_event[episode.kind]:
                take(episode)

    def add_tracking(self, tracking: Tracking) -> None:
        place = self._places.get(tracking.vehicle, (0.0, 0.0))
        for take in self._on_tracking:
            take(tracking)
        for watch in self._of_lead if tracking.vehicle == self._lead else self._watches:
            if began := watch.add(tracking, place):
                self._pass_on(began)

    def add_command(self, command: Command) -> None:
        if command.vehicle != self._lead:
            place = self._places.get(command.vehicle, (0.0, 0.0))
            self.overrides.add(command, self._beginning, place)

    def add_change(self, change: Change) -> None:
        self._traffic.add_change(change)

    @property
    def _beginning(self) -> int:
        """Start of the run (ns) or, if that was not recorded, the first pose."""
        return (self._first_at or 0) if self.start_at is None else self.start_at

    def finish(self) -> None:
        """Close events that are still open."""
        if self._watches_traffic:
            self._pass_on(self._traffic.finish())
        self._pass_on(self.overrides.finish())
        if self._encounters is not None:
            self._pass_on(self._encounters.finish())

    def seconds(self, at: int) -> float:
        """Seconds from the start of the run or, if that was not recorded, from the first pose."""
        return (at - self._beginning) / SECOND


def sizes_of(scenario: Scenario) -> dict[str, BodySize]:
    """Bodies of the vehicles of `scenario`, the lead first."""
    return {name: BodySize.of(scenario.vehicle(name).parameters) for name in scenario.vehicle_names}


# ---- True errors and true gaps ten times a second, for plots of a log without this project


PERIOD_NS = 100 * MILLISECOND
PATIENCE_NS = SECOND
"""How long an error or a gap waits for its counterpart."""


class TrueDeviation(NamedTuple):
    """Offset of a follower from the lead's path, and gap to the body ahead (m); NaN if unknown."""

    vehicle: str
    at_ns: int
    error: float
    gap: float


@dataclass(slots=True)
class _Values:
    """Period of the latest value, and values that wait for their counterpart."""

    period: int = -1
    waiting: dict[int, float] = field(default_factory=dict)

    def is_next(self, at: int) -> bool:
        before, self.period = self.period, at // PERIOD_NS
        return self.period != before


class Deviations:
    """Pairs errors and gaps of equal instants, in either order.

    The first instant in each period of a vehicle counts, so the pairs do not depend on the order of
    messages of different vehicles. A value that waits for too long is passed on alone.
    """

    def __init__(self, followers: Iterable[str]) -> None:
        self._of = {name: (_Values(), _Values()) for name in followers}
        self._ready: list[TrueDeviation] = []

    @classmethod
    def of(cls, stream: FigureStream) -> "Deviations":
        """Subscribe to the errors and gaps of a stream."""
        made = cls(stream.followers)
        stream.on_foot(made.take_error)
        stream.on_gap(made.take_gap)
        return made

    def take_error(self, foot: CrossTrack) -> None:
        self.add_error(foot.vehicle, foot.at_ns, foot.lateral)

    def take_gap(self, gap: TrueGap) -> None:
        if self.wants_gap(gap.vehicle, gap.now_at_ns):
            self.add_gap(gap.vehicle, gap.now_at_ns, gap.now_m)

    def add_error(self, vehicle: str, at: int, error: float) -> None:
        """Take an error (m) of a follower at instant `at` (ns)."""
        errors, gaps = self._of[vehicle]
        if errors.is_next(at):
            if at in gaps.waiting:
                self._ready.append(TrueDeviation(vehicle, at, error, gaps.waiting.pop(at)))
            else:
                errors.waiting[at] = error
            self._release_old(vehicle, at)

    def wants_gap(self, vehicle: str, at: int) -> bool:
        _, gaps = self._of[vehicle]
        return gaps.period != at // PERIOD_NS

    def add_gap(self, vehicle: str, at: int, gap: float) -> None:
        """Take a gap (m) of a follower at instant `at` (ns)."""
        errors, gaps = self._of[vehicle]
        if gaps.is_next(at):
            if at in errors.waiting:
                self._ready.append(TrueDeviation(vehicle, at, errors.waiting.pop(at), gap))
            else:
                gaps.waiting[at] = gap
            self._release_old(vehicle, at)

    def _release_old(self, vehicle: str, now: int) -> None:
        errors, gaps = self._of[vehicle]
        for at in [at for at in errors.waiting if now - at > PATIENCE_NS]:
            self._ready.append(TrueDeviation(vehicle, at, errors.waiting.pop(at), nan))
        for at in [at for at in gaps.waiting if now - at > PATIENCE_NS]:
            self._ready.append(TrueDeviation(vehicle, at, nan, gaps.waiting.pop(at)))

    def take_new(self) -> list[TrueDeviation]:
        if not self._ready:
            return []
        ready, self._ready = self._ready, []
        return ready
