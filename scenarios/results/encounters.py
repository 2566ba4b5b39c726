"""Gaps, near misses and collisions by true poses.

The poses of each vehicle come in order of time; how those of different vehicles are mixed does not
matter, since bodies are compared at equal instants only.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, hypot, inf, sin
from typing import Literal, NamedTuple

from vehicles.car.parameters import VehicleParameters
from vehicles.messages import TruePose
from vehicles.schedule import SECOND

# ---- Bodies of cars as oriented rectangles: overlap and distance


class BodySize(NamedTuple):
    """Length and width (m) of a body, and the offset of its centre from the centre of mass."""

    length: float
    width: float
    forward: float

    @classmethod
    def of(cls, car: VehicleParameters) -> "BodySize":
        return cls(car.length, car.width, car.body_offset)


@dataclass(slots=True)
class CarBody:
    """A body in the world: centre (m), unit vector forwards, half sizes (m), velocity (m/s)."""

    east: float
    north: float
    along_east: float
    along_north: float
    half_length: float
    half_width: float
    speed_east: float
    speed_north: float


class Separation(NamedTuple):
    """Distance (m) between two bodies, 0 where they overlap, and how fast it shrinks (m/s)."""

    distance: float
    closing: float


def body_of(pose: TruePose, size: BodySize) -> CarBody:
    ux, uy = cos(pose.yaw_rad), sin(pose.yaw_rad)
    length, width, forward = size
    sideways = pose.lateral_speed_mps + pose.yaw_rate_radps * forward
    return CarBody(
        pose.east_m + forward * ux,
        pose.north_m + forward * uy,
        ux,
        uy,
        0.5 * length,
        0.5 * width,
        pose.speed_mps * ux - sideways * uy,
        pose.speed_mps * uy + sideways * ux,
    )


def corners(body: CarBody) -> tuple[tuple[float, float], ...]:
    """Corners (east, north) of a body, counter-clockwise from front left."""
    forward_east = body.half_length * body.along_east
    forward_north = body.half_length * body.along_north
    left_east, left_north = -body.half_width * body.along_north, body.half_width * body.along_east
    front_east, front_north = body.east + forward_east, body.north + forward_north
    rear_east, rear_north = body.east - forward_east, body.north - forward_north
    return (
        (front_east + left_east, front_north + left_north),
        (rear_east + left_east, rear_north + left_north),
        (rear_east - left_east, rear_north - left_north),
        (front_east - left_east, front_north - left_north),
    )


def overlap(body: CarBody, other: CarBody) -> bool:
    """Whether two bodies share more than their edges (separating axis theorem).

    Two convex shapes are apart if and only if they are along the normal of one of their sides.
    """
    to_east, to_north = other.east - body.east, other.north - body.north
    # A rectangle's projection is the sum of the projections of its sides.
    cosine = abs(body.along_east * other.along_east + body.along_north * other.along_north)
    sine = abs(body.along_east * other.along_north - body.along_north * other.along_east)
    for here, there in ((body, other), (other, body)):
        along = abs(to_east * here.along_east + to_north * here.along_north)
        across = abs(to_north * here.along_east - to_east * here.along_north)
        if along >= here.half_length + there.half_length * cosine + there.half_width * sine:
            return False
        if across >= here.half_width + there.half_length * sine + there.half_width * cosine:
            return False
    return True


def separation(body: CarBody, other: CarBody) -> Separation:
    """Distance between two bodies and its rate from their velocities, without yaw rates.

    The nearest points of two disjoint convex polygons include a corner. Where the bodies overlap
    the rate is that along the line of their centres.
    """
    if overlap(body, other):
        to_east, to_north = other.east - body.east, other.north - body.north
        return Separation(0.0, _closing(body, other, to_east, to_north))
    nearest = inf
    east = north = 0.0
    for here, there, sign in ((body, other, 1.0), (other, body, -1.0)):
        there_east, there_north, ux, uy = (
            there.east,
            there.north,
            there.along_east,
            there.along_north,
        )
        length, width = there.half_length, there.half_width
        for corner_east, corner_north in corners(here):
            to_east, to_north = there_east - corner_east, there_north - corner_north
            along = to_east * ux + to_north * uy
            across = to_north * ux - to_east * uy
            # Distance beyond the half sizes of the other body.
            along -= min(max(along, -length), length)
            across -= min(max(across, -width), width)
            distance = hypot(along, across)
            if distance < nearest:
                nearest = distance
                east = sign * (along * ux - across * uy)
                north = sign * (along * uy + across * ux)
    return Separation(nearest, _closing(body, other, east, north))


def _closing(body: CarBody, other: CarBody, east: float, north: float) -> float:
    """Speed (m/s) at which `body` nears `other` along the direction (east, north)."""
    length = hypot(east, north)
    if length == 0.0:
        return 0.0
    faster_east = body.speed_east - other.speed_east
    faster_north = body.speed_north - other.speed_north
    return (faster_east * east + faster_north * north) / length


# ---- Encounters


# fmt: off
EventKind = Literal[
    "collision", "distrust", "falls_behind", "hard_braking", "lane_departure", "near_miss",
    "overridden", "overspeed", "own", "path_lost", "slide", "stop", "stranded",
]
# fmt: on

MOST_FRAMES = 3000
"""Instants that wait for poses, 60 s at 50 Hz; then the oldest are dropped."""
PARTED_M = 0.2
"""Distance at which collided bodies have separated, so that a grazing contact is one collision."""
QUIET_NS = SECOND
"""An episode ends when its condition has not held for this time."""


@dataclass(slots=True)
class Episode:
    """An event from `at_ns` until `until_ns`; figures have unit suffixes.

    Figures of a continuing event still grow. `place` (east, north, m) is where it began; `name` is
    that of an event of the user.
    """

    kind: EventKind
    vehicles: tuple[str, ...]
    at_ns: int
    until_ns: int
    figures: dict[str, float] = field(default_factory=dict)
    hit: bool = False
    place: tuple[float, float] = (0.0, 0.0)
    name: str = ""

    def least(self, figure: str, value: float) -> None:
        self.figures[figure] = min(value, self.figures.get(figure, inf))

    def most(self, figure: str, value: float) -> None:
        self.figures[figure] = max(value, self.figures.get(figure, -inf))

    def is_over(self, at: int) -> bool:
        """Whether the condition has not held for QUIET_NS at instant `at` (ns)."""
        return at - self.until_ns > QUIET_NS


@dataclass(slots=True)
class TrueGap:
    """Latest and extreme distances (m) between a vehicle's body and that of its predecessor."""

    vehicle: str
    now_m: float = inf
    now_at_ns: int = 0
    min_m: float = inf
    min_at_ns: int = 0
    max_m: float = -inf
    max_at_ns: int = 0

    def add(self, gap: float, at: int) -> None:
        """Take the distance at an instant (ns)."""
        self.now_m, self.now_at_ns = gap, at
        if gap < self.min_m:
            self.min_m, self.min_at_ns = gap, at
        if gap > self.max_m:
            self.max_m, self.max_at_ns = gap, at


@dataclass(slots=True)
class _Pair:
    names: tuple[str, str]
    gap: TrueGap


class Encounters:
    """Gaps and near misses of neighbours, collisions of any two vehicles."""

    def __init__(
        self, sizes: Mapping[str, BodySize], *, near_gap: float = 0.0, near_time: float = 0.0
    ) -> None:
        """Take the bodies, lead first; a near miss is below `near_gap` (m) or `near_time` (s)."""
        self._sizes = sizes
        self._place = {name: place for place, name in enumerate(sizes)}
        self._near_gap, self._near_time = near_gap, near_time
        # Largest distance of the centres of touching bodies.
        self._reach = max(hypot(size.length, size.width) for size in sizes.values())
        self._frames: dict[int, dict[str, CarBody]] = {}
        self._touching: dict[str, set[str]] = {name: set() for name in sizes}
        self._near: dict[tuple[str, str], Episode] = {}
        self.gaps = {name: TrueGap(name) for name in list(sizes)[1:]}
        self._pairs: dict[str, dict[str, _Pair]] = {name: {} for name in sizes}
        for ahead, behind in pairwise(sizes):
            pair = _Pair((ahead, behind), self.gaps[behind])
            self._pairs[ahead][behind] = self._pairs[behind][ahead] = pair

    def add(self, pose: TruePose, body: CarBody) -> list[Episode]:
        """Take a pose and its body; returns the events that are certain by now."""
        name, at = pose.vehicle, pose.true_at_ns
        frame = self._frames.get(at)
        if frame is None:
            if len(self._frames) >= MOST_FRAMES:
                del self._frames[next(iter(self._frames))]
            frame = self._frames[at] = {}
        neighbours, touching = self._pairs[name], self._touching[name]
        episodes: list[Episode] = []
        east, north, reach = body.east, body.north, self._reach
        for other, there in frame.items():
            if other in neighbours:
                pair = neighbours[other]
                if pair.names[0] == name:
                    episodes += self._follow(at, pair, body, there)
                else:
                    episodes += self._follow(at, pair, there, body)
            elif (
                -reach < there.east - east < reach
                and -reach < there.north - north < reach
                and other != name
            ) or (touching and other in touching):
                episodes += self._meet(at, name, body, other, there)
        frame[name] = body
        if len(frame) == len(self._sizes):
            del self._frames[at]
        return episodes

    def finish(self) -> list[Episode]:
        """Return the near misses that are still open."""
        left = [episode for episode in self._near.values() if not episode.hit]
        self._near.clear()
        return left

    def _meet(
        self, at: int, name: str, body: CarBody, other: str, there: CarBody
    ) -> Iterable[Episode]:
        if self._place[name] > self._place[other]:
            name, body, other, there = other, there, name, body
        return self._look(at, (name, other), body, there, None)

    def _follow(self, at: int, pair: _Pair, ahead: CarBody, behind: CarBody) -> Iterable[Episode]:
        return self._look(at, pair.names, ahead, behind, pair.gap)

    def _look(
        self,
        at: int,
        names: tuple[str, str],
        body: CarBody,
        there: CarBody,
        gap: TrueGap | None,
    ) -> Iterator[Episode]:
        """Compare two bodies, the one ahead first; only neighbours have a `gap`."""
        name, other = names
        apart = separation(body, there)
        place = (0.5 * (body.east + there.east), 0.5 * (body.north + there.north))
        touched = other in self._touching[name]
        if apart.distance == 0.0 and not touched:
            self._touching[name].add(other)
            self._touching[other].add(name)
            # For overlapping bodies the speed is that along the line of their centres.
            figures = {"closing_speed_mps": apart.closing}
            yield Episode("collision", names, at, at, figures, place=place)
        elif apart.distance > PARTED_M and touched:
            self._touching[name].discard(other)
            self._touching[other].discard(name)
        if gap is not None:
            gap.add(apart.distance, at)
            yield from self._keep_apart(at, names, apart, place)

    def _keep_apart(
        self, at: int, pair: tuple[str, str], apart: Separation, place: tuple[float, float]
    ) -> Iterator[Episode]:
        """Follow a near miss; it is certain once it has ended without a collision."""
        distance = apart.distance
        left = distance / apart.closing if apart.closing > 0.0 else inf
        episode = self._near.get(pair)
        if distance < self._near_gap or left < self._near_time or distance == 0.0:
            if episode is None:
                episode = self._near[pair] = Episode("near_miss", pair, at, at, place=place)
            episode.until_ns = at
            episode.hit |= distance == 0.0
            episode.least("gap_m_min", distance)
            if left < inf:
                episode.least("time_to_collision_s_min", left)
        elif episode is not None and episode.is_over(at):
            del self._near[pair]
            if not episode.hit:
                yield episode
