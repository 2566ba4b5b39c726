"""Events of single vehicles: lost paths, slides, stops, and distrusted sources."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite
from typing import Any, Protocol

from scenarios.results.encounters import BodySize, CarBody, Episode, corners
from vehicles.geometry.driven_path import MAX_WAITING, CrossTrack, CrossTrackError
from vehicles.messages import Tracking, TruePose
from vehicles.schedule import SECOND, nanoseconds

# ---- Departures of followers from their lane


WELL_INSIDE_M = 0.5
"""A follower with all corners this far inside its lane is checked again LANE_LOOK_NS later only:
to leave it until then would take 10 m/s sideways."""
LANE_LOOK_NS = SECOND // 20


@dataclass(slots=True)
class _Corners:
    """State of the corners of one follower, each a named point.

    `known` are the distances (m) of corners that the lead has passed, by instant; `seen` is the
    follower's position then.
    """

    vehicle: str
    points: tuple[str, str, str, str]
    known: dict[int, list[float]] = field(default_factory=dict)
    seen: dict[int, tuple[float, float]] = field(default_factory=dict)
    departure: Episode | None = None
    next_look: int = 0


class LaneWatch:
    """Departures of followers from the lane: a corner too far from the lead's driven path.

    A follower near the edge is checked at every pose, one well inside less often: checking four
    corners of every pose would cost more than all other figures.
    """

    def __init__(
        self,
        sizes: Mapping[str, BodySize],
        lane_width: float,
        path: CrossTrackError,
    ) -> None:
        """`lane_width` is in m."""
        self._half_width = 0.5 * lane_width
        self._lead, *followers = sizes
        self._followers: dict[str, _Corners] = {}
        self._of_point: dict[str, _Corners] = {}
        for name in followers:
            follower = _Corners(name, (f"{name}/0", f"{name}/1", f"{name}/2", f"{name}/3"))
            self._followers[name] = follower
            self._of_point |= dict.fromkeys(follower.points, follower)
        self._path = path

    def add(self, pose: TruePose, body: CarBody, feet: Sequence[CrossTrack]) -> Iterable[Episode]:
        """Take a pose and its body; yields each departure as it begins.

        `feet` are foot points that a pose of the lead made known.
        """
        if pose.vehicle == self._lead:
            return self._measure(feet) if feet else ()
        follower = self._followers[pose.vehicle]
        if pose.true_at_ns < follower.next_look:
            return ()
        return self._look(follower, pose, body)

    def _look(self, follower: _Corners, pose: TruePose, body: CarBody) -> Iterable[Episode]:
        at, place = pose.true_at_ns, (pose.east_m, pose.north_m)
        feet: list[CrossTrack] = []
        for point, (east, north) in zip(follower.points, corners(body), strict=True):
            feet += self._path.add_point(point, at, east, north)
        seen = follower.seen
        if len(feet) == 4 and not follower.known:
            one, two, three, four = feet
            if at == one.at_ns == two.at_ns == three.at_ns == four.at_ns:  # the usual case
                if seen:
                    _forget(seen, at)
                sides = abs(one.lateral), abs(two.lateral), abs(three.lateral), abs(four.lateral)
                return self._follow(follower, at, place, max(sides) - self._half_width)
        if len(seen) > MAX_WAITING:
            del seen[next(iter(seen))]
        seen[at] = place
        return self._measure(feet) if feet else ()

    def _measure(self, feet: Iterable[CrossTrack]) -> Iterator[Episode]:
        """Take foot points; a follower is checked once its four corners are known."""
        for foot in feet:
            follower = self._of_point.get(foot.vehicle)
            if follower is None:
                continue
            # The lead passes the front corners later than the rear ones.
            waiting, seen, at = follower.known, follower.seen, foot.at_ns
            if len(waiting) > MAX_WAITING:
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
    for at in [at for at in known if at <= until]:
        del known[at]


# ---- Watches


ORIGIN = (0.0, 0.0)
LOST_MODES = frozenset({"coast", "stop", "straight"})
"""Modes of a follower that has no trajectory from what it received, unless it knows the road."""
UNRECORDED_NS = SECOND // 2
"""Longest time between two tracking messages of one episode; the slowest control runs at 5 Hz."""


class TrackingWatch(Protocol):
    """Finds events of followers in their tracking."""

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        """Take the tracking of one instant at a place (m); yields each event as it begins."""
        ...


class PathWatch:
    """Followers that had a trajectory and steer without one for longer than `after` (s).

    A follower that continues along a known road has not lost its path.
    """

    def __init__(self, after: float) -> None:
        self._after = nanoseconds(after)
        self._lost: dict[str, Episode | None] = {}
        self._last: dict[str, int] = {}
        self._reported: set[str] = set()

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        """Take the tracking of one instant at a place (m); yields a loss after `after` (s)."""
        name, at = tracking.vehicle, tracking.decided_at_ns
        before, self._last[name] = self._last.get(name, at), at
        if tracking.mode not in LOST_MODES or tracking.known_m > 0.0:  # false for NaN
            self._lost[name] = None
            if self._reported:
                self._reported.discard(name)
        elif name in self._lost:  # it had a trajectory before
            return self._note_loss(name, at, place, unseen=at - before > UNRECORDED_NS)
        return ()

    def _note_loss(
        self, name: str, at: int, place: tuple[float, float], *, unseen: bool
    ) -> Iterator[Episode]:
        episode = self._lost[name]
        if episode is None or unseen:
            episode = self._lost[name] = Episode("path_lost", (name,), at, at, place=place)
            self._reported.discard(name)
        episode.until_ns = at
        episode.most("duration_s", (at - episode.at_ns) / SECOND)
        if name not in self._reported and at - episode.at_ns > self._after:
            self._reported.add(name)
            yield episode


class SlideWatch:
    """Vehicles with an axle that uses all available friction, or more with linear tyres."""

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}

    def add(self, pose: TruePose) -> Iterator[Episode]:
        """Take a pose in which the vehicle slides; yields each slide as it begins."""
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


class StopWatch:
    """Stops of cars that know too little of the road ahead, each until it drives again.

    Those of a lead begin when it stands behind a member of its convoy that is silent.
    """

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        if tracking.mode == "stop" or (
            tracking.mode == "path" and tracking.predecessor_status == "lost"
        ):
            return self._note_stop(tracking, place)
        if self._open:
            self._open.pop(tracking.vehicle, None)
        return ()

    def _note_stop(self, tracking: Tracking, place: tuple[float, float]) -> Iterator[Episode]:
        name, at = tracking.vehicle, tracking.decided_at_ns
        episode = self._open.get(name)
        if episode is None:
            episode = self._open[name] = Episode("stop", (name,), at, at, place=place)
            figures = {"known_m": tracking.known_m, "predicted_blind_m": tracking.blind_m}
            episode.figures |= {name: value for name, value in figures.items() if isfinite(value)}
            yield episode
        episode.until_ns = at
        episode.most("duration_s", (at - episode.at_ns) / SECOND)


class TrustWatch:
    """Sources that a follower distrusts, each until it is trusted again."""

    def __init__(self, names: Sequence[str]) -> None:
        self._lead = names[0]
        self._ahead = {behind: ahead for ahead, behind in pairwise(names)}
        self._open: dict[tuple[str, str], Episode] = {}

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        if (
            self._open
            or tracking.lead_status == "distrusted"
            or tracking.predecessor_status == "distrusted"
            or "distrusted" in tracking.other_sources
        ):
            return self._note_distrust(tracking, place)
        return ()  # the usual case

    def _note_distrust(self, tracking: Tracking, place: tuple[float, float]) -> Iterator[Episode]:
        name, at = tracking.vehicle, tracking.decided_at_ns
        ahead = self._ahead.get(name)
        if ahead is None:  # the lead has no sources
            return
        statuses = {self._lead: tracking.lead_status}
        if ahead != self._lead:
            statuses[ahead] = tracking.predecessor_status
        statuses |= tracking.statuses()
        for source, status in statuses.items():
            pair = source, name
            if status != "distrusted":
                self._open.pop(pair, None)
                continue
            episode = self._open.get(pair)
            if episode is None:
                begun = Episode("distrust", pair, at, at, place=place)
                episode = self._open[pair] = begun
                yield episode
            episode.until_ns = at
            episode.most("duration_s", (at - episode.at_ns) / SECOND)
