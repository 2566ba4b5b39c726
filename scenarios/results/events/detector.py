"""What happened on the road that must not pass unseen, from the true poses and the modes.

A collision, a near miss, a departure from the lane, a path lost, a slide, a stop, a source that is
not believed: found message by message, live, in virtual time or from a log. The messages of each
vehicle come in order; how those of different vehicles are mixed does not matter.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.tables import EventsTable
from scenarios.results.events.bodies import BodySize, CarBody, body_of, corners
from scenarios.results.events.encounters import Encounters, Episode
from scenarios.results.events.run_event import RunEvent
from scenarios.results.events.watches import StopWatch, TrustWatch
from vehicles.car.tyres import SLIDING_SHARE
from vehicles.geometry.driven_path import MOST_WAITING, CrossTrack, CrossTrackError
from vehicles.messages import Tracking, TruePose
from vehicles.schedule import SECOND, nanoseconds

LOST_MODES = frozenset({"coast", "stop", "straight"})
"""Modes of a follower that has no trajectory from what it received, unless it knows the road."""
WELL_INSIDE_M = 0.5
"""A follower whose corners are all so far inside its lane is not across the edge before the next
look, LANE_LOOK_NS later: that would take 10 m/s sideways."""
LANE_LOOK_NS = SECOND // 20
UNRECORDED_NS = SECOND // 2
"""Between two tracking messages so far apart nobody knows what a vehicle steered along; the
slowest control runs at 5 Hz."""


@dataclass(slots=True)
class _Corners:
    """What is known of the corners of one follower, each a point with a name of its own.

    `known` are the distances (m) of those corners that the lead has passed, by instant; `seen` is
    where the follower was then.
    """

    vehicle: str
    points: tuple[str, str, str, str]
    known: dict[int, list[float]] = field(default_factory=dict)
    seen: dict[int, tuple[float, float]] = field(default_factory=dict)
    departure: Episode | None = None
    next_look: int = 0


class LaneWatch:
    """Departures of followers from the lane: a corner too far from the lead's driven path.

    A follower near the edge is looked at at every pose, one well inside less often: four corners of
    every pose would cost more than all other figures of a run. `excess` is how far (m) the corner
    farthest out of each follower was beyond the edge when it was last looked at.
    """

    def __init__(
        self, sizes: Mapping[str, BodySize], lane_width: float, road_yaw: float | None
    ) -> None:
        self._sizes = sizes
        self._half_width = 0.5 * lane_width
        self._lead, *followers = sizes
        self._followers: dict[str, _Corners] = {}
        self._of_point: dict[str, _Corners] = {}
        for name in followers:
            one = _Corners(name, (f"{name}/0", f"{name}/1", f"{name}/2", f"{name}/3"))
            self._followers[name] = one
            self._of_point |= dict.fromkeys(one.points, one)
        self._paths = CrossTrackError(self._lead, road_yaw, self._of_point)
        self.excess: dict[str, float] = {}

    def add(self, pose: TruePose, body: CarBody | None = None) -> Iterable[Episode]:
        """Take a pose; gives each departure as it begins.

        `body` is the one at the pose, where that is known already.
        """
        if pose.vehicle == self._lead:
            feet = self._paths.add(pose)
            return self._measure(feet) if feet else ()
        follower = self._followers[pose.vehicle]
        if pose.true_at_ns < follower.next_look:
            return ()
        return self._look(follower, pose, body or body_of(pose, self._sizes[pose.vehicle]))

    def _look(self, follower: _Corners, pose: TruePose, body: CarBody) -> Iterable[Episode]:
        at, place = pose.true_at_ns, (pose.east_m, pose.north_m)
        feet: list[CrossTrack] = []
        for point, (east, north) in zip(follower.points, corners(body), strict=True):
            feet += self._paths.add_point(point, at, east, north)
        seen = follower.seen
        if len(feet) == 4 and not follower.known:
            one, two, three, four = feet
            if at == one.at_ns == two.at_ns == three.at_ns == four.at_ns:  # as mostly
                if seen:
                    _forget(seen, at)
                sides = abs(one.lateral), abs(two.lateral), abs(three.lateral), abs(four.lateral)
                return self._follow(follower, at, place, max(sides) - self._half_width)
        if len(seen) > MOST_WAITING:
            del seen[next(iter(seen))]
        seen[at] = place
        return self._measure(feet) if feet else ()

    def _measure(self, feet: Iterable[CrossTrack]) -> Iterator[Episode]:
        """Take foot points of corners; whose four are known by then is looked at."""
        for foot in feet:
            follower = self._of_point[foot.vehicle]
            # The lead reaches the front corners' places later than those of the rear ones.
            waiting, seen, at = follower.known, follower.seen, foot.at_ns
            if len(waiting) > MOST_WAITING:
                del waiting[next(iter(waiting))]
            known = waiting.setdefault(at, [])
            known.append(abs(foot.lateral))
            if len(known) == 4:
                place = seen.get(at, (0.0, 0.0))
                _forget(waiting, at)
                _forget(seen, at)
                yield from self._follow(follower, at, place, max(known) - self._half_width)

    def _follow(
        self, follower: _Corners, at: int, place: tuple[float, float], excess: float
    ) -> tuple[Episode, ...]:
        self.excess[follower.vehicle] = excess
        follower.next_look = at + LANE_LOOK_NS if excess < -WELL_INSIDE_M else 0
        episode = follower.departure
        if excess > 0.0:
            begins = episode is None
            if episode is None:
                episode = Episode("lane_departure", (follower.vehicle,), at, at, place=place)
                follower.departure = episode
            episode.until_ns = at
            episode.most("excess_m_max", excess)
            episode.most("duration_s", (at - episode.at_ns) / SECOND)
            return (episode,) if begins else ()
        if episode is not None and episode.is_over(at):
            follower.departure = None
        return ()


def _forget(known: dict[int, Any], until: int) -> None:
    """Drop what was known of instants up to `until` (ns)."""
    for at in [at for at in known if at <= until]:
        del known[at]


class PathWatch:
    """Followers that had a trajectory and steer without one for longer than `after` (s).

    One that goes on along what it still knows of the road has not lost its path.
    """

    def __init__(self, after: float) -> None:
        self._after = nanoseconds(after)
        self._lost: dict[str, Episode | None] = {}
        self._last: dict[str, int] = {}
        self._told: set[str] = set()

    def add(self, tracking: Tracking, place: tuple[float, float] = (0.0, 0.0)) -> Iterable[Episode]:
        """Take the tracking of one instant; gives a loss as soon as it has lasted long enough.

        `place` is where the vehicle is (m).
        """
        name, at = tracking.vehicle, tracking.decided_at_ns
        before, self._last[name] = self._last.get(name, at), at
        if tracking.mode not in LOST_MODES or tracking.known_m > 0.0:  # false for NaN
            self._lost[name] = None
            if self._told:
                self._told.discard(name)
        elif name in self._lost:  # it has had one
            return self._losing(name, at, place, unseen=at - before > UNRECORDED_NS)
        return ()

    def _losing(
        self, name: str, at: int, place: tuple[float, float], *, unseen: bool
    ) -> Iterator[Episode]:
        episode = self._lost[name]
        if episode is None or unseen:
            episode = self._lost[name] = Episode("path_lost", (name,), at, at, place=place)
            self._told.discard(name)
        episode.until_ns = at
        episode.most("duration_s", (at - episode.at_ns) / SECOND)
        if name not in self._told and at - episode.at_ns > self._after:
            self._told.add(name)
            yield episode


class SlideWatch:
    """Vehicles an axle of which uses all the friction that there is, or with linear tyres more."""

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}

    def add(self, pose: TruePose) -> Iterator[Episode]:
        """Take a pose in which it slides; gives each slide as it begins."""
        name, at = pose.vehicle, pose.true_at_ns
        episode = self._open.get(name)
        if episode is None or episode.is_over(at):
            place = (pose.east_m, pose.north_m)
            episode = self._open[name] = Episode("slide", (name,), at, at, place=place)
            yield episode
        episode.until_ns = at
        episode.most("slip_rad_max", max(abs(pose.front_slip_rad), abs(pose.rear_slip_rad)))
        episode.most("friction_ratio_max", pose.friction_ratio)
        episode.most("duration_s", (at - episode.at_ns) / SECOND)


class EventDetector:
    """Finds the events of a run; `encounters` holds the true gaps beside.

    `collisions` counts those so far.
    """

    def __init__(
        self,
        sizes: Mapping[str, BodySize],
        table: EventsTable | None = None,
        road_yaw: float | None = None,
    ) -> None:
        """Take the bodies, lead first, and the direction of the road at the start (rad)."""
        rules = table or EventsTable()
        self._sizes = sizes
        self.encounters = Encounters(
            sizes, near_gap=rules.near_miss_gap_m, near_time=rules.near_miss_time_s
        )
        self._lane = LaneWatch(sizes, rules.lane_width_m, road_yaw)
        self._path = PathWatch(rules.path_lost_s)
        self._slide = SlideWatch()
        self._stop = StopWatch()
        self._trust = TrustWatch(list(sizes))
        self._found: list[Episode] = []
        self._told = 0
        self._places: dict[str, tuple[float, float]] = {}
        self.collisions = 0
        self._start_at: int | None = None
        self._first_at: int | None = None

    def begin(self, start_at: int) -> None:
        """Take the start of the run (ns), from which instants are counted."""
        self._start_at = start_at

    def add_truth(self, pose: TruePose) -> None:
        """Take a true pose of one of the vehicles."""
        name = pose.vehicle
        if self._first_at is None or pose.true_at_ns < self._first_at:
            self._first_at = pose.true_at_ns
        self._places[name] = (pose.east_m, pose.north_m)
        body = body_of(pose, self._sizes[name])
        if met := self.encounters.add(pose, body):
            self.collisions += sum([episode.kind == "collision" for episode in met])
            self._found += met
        if pose.friction_ratio >= SLIDING_SHARE:
            self._found += self._slide.add(pose)
        if departed := self._lane.add(pose, body):
            self._found += departed

    def add_tracking(self, tracking: Tracking) -> None:
        """Take what one of the vehicles steers along."""
        place = self._places.get(tracking.vehicle, (0.0, 0.0))
        if lost := self._path.add(tracking, place):
            self._found += lost
        if stopped := self._stop.add(tracking, place):
            self._found += stopped
        if doubted := self._trust.add(tracking, place):
            self._found += doubted

    def finish(self) -> None:
        """Count what had not ended when the run did."""
        self._found += self.encounters.finish()

    def news(self) -> list[RunEvent]:
        """Events found since the last call."""
        if self._told == len(self._found):
            return []
        new = self._found[self._told :]
        self._told = len(self._found)
        return [self.event(episode) for episode in new]

    def episodes(self, first: int) -> list[Episode]:
        """Events in the order in which they were found, from number `first` on."""
        return self._found[first:]

    def events(self) -> tuple[RunEvent, ...]:
        """All events so far, in order of time, whatever the order in which they were found."""
        found = [self.event(episode) for episode in self._found]
        return tuple(sorted(found, key=lambda one: (one.at_s, one.kind, one.vehicles)))

    def seconds(self, at: int) -> float:
        """Seconds from the start of the run, or, if that was not recorded, the first pose."""
        start = self._first_at if self._start_at is None else self._start_at
        return (at - (start or 0)) / SECOND

    def event(self, episode: Episode) -> RunEvent:
        """Put an episode as it stands in the summary."""
        return RunEvent(
            kind=episode.kind,
            at_s=self.seconds(episode.at_ns),
            vehicles=episode.vehicles,
            figures=dict(episode.figures),
        )


def sizes_of(scenario: Scenario) -> dict[str, BodySize]:
    """Bodies of the vehicles of `scenario`, the lead first."""
    return {name: BodySize.of(scenario.vehicle(name).parameters) for name in scenario.vehicle_names}


def detector_of(scenario: Scenario) -> EventDetector:
    """Make the detector for the vehicles of `scenario`, with its own thresholds."""
    return EventDetector(sizes_of(scenario), scenario.tables.events, scenario.route.start_yaw)
