"""Departures of followers from their lane."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from scenarios.results.events.bodies import BodySize, CarBody, corners
from scenarios.results.events.encounters import Episode
from vehicles.geometry.driven_path import MAX_WAITING, CrossTrack, CrossTrackError
from vehicles.messages import TruePose
from vehicles.schedule import SECOND

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
        path.follow(self._of_point)

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
