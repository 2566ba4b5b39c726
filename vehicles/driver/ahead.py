"""Members of the lead's own convoy that stand or drive on its path ahead; SI units.

A convoy that grows longer than a closed lap has its last cars in front of its lead. The lead
receives their poses and keeps its distance from them like a follower. Cars that have yet to drive a
part of the path have the right of way there, since they follow the car ahead of them and do not
expect the lead.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator, Sequence
from math import cos, floor, inf, isnan, nan, pi, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.outline import Outline, outline_of
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.controller import GapLimits, SpacingPolicy, VehiclesAhead
from vehicles.driver.longitudinal_laws import DAMPING, GAP_STIFFNESS, gap_acceleration
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import (
    SourceState,
    braking_share,
    predicted_motion,
    safe_reserve,
    stopping_distance,
)
from vehicles.driver.watch import MemberTrack
from vehicles.geometry.sampled_path import FloatArray, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- The strip that a car sweeps along its path, and what reaches into it; SI units


SIDE_MARGIN: Final = 0.3  # Distance (m) to either side of the lead's body that must be free
SHARES: Final = np.linspace(0.0, 1.0, 33)  # Points between two samples, at most 8 mm apart


class LapRange(NamedTuple):
    """Stations (m) of a path to search, and what to add to them after its end."""

    low: float
    high: float
    added: float


def lap_ranges(path: SampledPath, lap: float, station: float, distance: float) -> list[LapRange]:
    """Ranges of the path within `distance` (m) ahead of `station` (m).

    Beyond the end of a closed path, whose lap is `lap` (m) long, they are those of the last lap.
    """
    end, until = float(path.station[-1]), station + distance
    ranges = [LapRange(station, min(until, end), 0.0)] if station < end else []
    if lap and until > end:
        begin = max(station, end) - lap
        ranges.append(LapRange(begin, min(until, end + lap) - lap, lap))
    return ranges


class Lane:
    """The strip that the body of a car sweeps along its path, with a margin on either side.

    The outer front corner sweeps sqrt((R + w/2)² + l²) - R to the side in a bend of radius R, for a
    car of width w whose front bumper is l ahead of its centre of mass.
    """

    def __init__(self, path: SampledPath, car: VehicleParameters) -> None:
        self._path = path
        self._width = car.width
        self.front = 0.5 * car.length + car.body_offset
        self._squares = 0.25 * car.width**2 + self.front**2
        self._widest = float(np.max(self._half_widths(path.curvature)))

    def first_contact(
        self, body: Outline, low: float, high: float, margin: float = 0.0
    ) -> float | None:
        """First station (m) from `low` to `high` at which the strip meets `body`.

        `margin` (m) widens the strip. None without a contact.
        """
        return next(iter(self.contacts(body, low, high, margin)), None)

    def contacts(self, body: Outline, low: float, high: float, margin: float = 0.0) -> list[float]:
        """Stations (m) from `low` to `high` at which the strip begins to meet `body`, in order.

        `margin` (m) widens the strip.
        """
        path = self._path
        first, last = np.searchsorted(path.station, (low, high)).tolist()
        dx, dy = path.east[first:last] - body.east, path.north[first:last] - body.north
        reach = self.reach(body) + margin
        near = np.flatnonzero(dx * dx + dy * dy <= reach * reach) + first
        if not near.size:
            return []
        samples = (path.station, path.east, path.north, path.yaw, path.curvature)
        met = near[self._meets(body, margin, [values[near] for values in samples[1:]])]
        begins = met[np.diff(met, prepend=-2) > 1].tolist()
        return [self._begin(body, margin, index, samples, first=first) for index in begins]

    def reach(self, body: Outline) -> float:
        """Distance (m) from the centre of `body` within which the strip can meet it."""
        return body.reach + self._widest

    def _begin(
        self, body: Outline, margin: float, index: int, samples: Sequence[FloatArray], *, first: int
    ) -> float:
        """Station (m) of a contact that a sample has and the one before it has not."""
        if index == first:
            return float(samples[0][index])
        station, *place = (
            values[index - 1] + SHARES * (values[index] - values[index - 1]) for values in samples
        )
        return float(station[int(np.argmax(self._meets(body, margin, place)))])

    def _meets(
        self, body: Outline, margin: float, samples: Sequence[FloatArray]
    ) -> NDArray[np.bool_]:
        """Whether the line across the strip at each sample meets the body (slab method)."""
        east, north, yaw, curvature = samples
        dx, dy = east - body.east, north - body.north
        ux, uy = body.along_east, body.along_north
        half = self._half_widths(curvature) + margin
        cosine, sine = np.cos(yaw), np.sin(yaw)
        enters, leaves = -half, half
        for place, slope, size in (
            (dx * ux + dy * uy, uy * cosine - ux * sine, body.half_length),
            (dy * ux - dx * uy, ux * cosine + uy * sine, body.half_width),
        ):
            steep = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
            near, far = (-size - place) / steep, (size - place) / steep
            enters = np.maximum(enters, np.minimum(near, far))
            leaves = np.minimum(leaves, np.maximum(near, far))
        return enters <= leaves

    def _half_widths(self, curvature: FloatArray) -> FloatArray:
        bend = np.abs(curvature)
        swept = self._width + bend * self._squares
        return swept / (np.sqrt(1.0 + bend * swept) + 1.0) + SIDE_MARGIN


# ---- Reserved
#
# Parts of the lead's path that its convoy has yet to drive, where the path meets itself; SI units.
#
# Followers drive the lead's path one after the other and do not look for crossing traffic. At a
# crossing, or where a closed path begins again, two cars can therefore meet only if the lead comes
# there a second time before its last car has passed it once. The lead waits for that.


STEP: Final = 1.0  # Distance (m) between the positions of the last car that are checked
LEAST_TURN: Final = 0.9 * pi  # A path whose direction (rad) varies less does not meet itself


class ReservedEntry(NamedTuple):
    """Station (m) of the path that the lead must not enter, infinite if there is none.

    It moves at `rate` times the speed of the last car: 1 behind the car on the same road, 0 before
    a crossing that the car has not passed.
    """

    station: float
    rate: float


FREE: Final = ReservedEntry(inf, 0.0)


def entries(
    path: SampledPath, lane: Lane, car: VehicleParameters, station: float, until: float
) -> list[float]:
    """Stations (m) up to `until` (m) at which a path later meets a `car` at `station` (m)."""
    place = path.at(station)
    body = outline_of(car, place.east, place.north, place.yaw)
    return lane.contacts(body, station + 2.0 * lane.reach(body), until)


def shortest_loop(
    path: SampledPath, lead: VehicleParameters, last: VehicleParameters, end: float, most: float
) -> float:
    """Length (m) of the shortest loop of a path up to `end` (m), infinite above `most` (m).

    A lead cannot drive around it while the spacings to all its followers up to the `last`, and the
    one that it keeps to that car ahead, add up to more. On a closed path it is the lap.
    """
    if np.ptp(path.yaw) < LEAST_TURN:
        return inf
    lane, rear = Lane(path, lead), 0.5 * last.length - last.body_offset
    shortest = inf
    for station in np.arange(float(path.station[0]), end, STEP).tolist():
        found = entries(path, lane, last, station, min(station + most, end))
        if found:
            shortest = min(shortest, found[0] + rear - station)
    return shortest


class ReservedPath:
    """The first part of the path ahead that the convoy must drive before the lead may enter it."""

    def __init__(self, path: SampledPath, lane: Lane, last: VehicleParameters) -> None:
        self._path, self._lane, self._car = path, lane, last
        self._end = float(path.station[-1])
        self._checked: deque[tuple[float, list[float]]] = deque()
        self._next: float | None = None

    def entry(self, last: float, station: float) -> ReservedEntry:
        """First entry from the lead's `station` (m) on, the last car being at `last` (m)."""
        checked = self._checked
        self._check(last, station)
        while len(checked) > 1 and checked[1][0] <= last:
            checked.popleft()
        firsts = [_first_from(station, found) for _, found in checked]
        first = min(firsts, default=inf)
        if first == inf:
            return FREE
        moved = min(firsts[1:], default=inf) - first
        if moved > 2.0 * STEP:  # the last car has yet to pass a crossing
            return ReservedEntry(first, 0.0)
        share = min(max((last - checked[0][0]) / STEP, 0.0), 1.0)
        return ReservedEntry(first + share * moved, min(moved / STEP, 1.0))

    def _check(self, last: float, station: float) -> None:
        """Find the entries of positions from the `last` car to the lead at `station` (m)."""
        if self._next is None:
            self._next = STEP * floor(last / STEP)
        while self._next <= station:
            found = entries(self._path, self._lane, self._car, self._next, self._end)
            self._checked.append((self._next, found))
            self._next += STEP


def _first_from(station: float, stations: list[float]) -> float:
    """First of increasing `stations` (m) that is at or after `station` (m), infinite without."""
    index = bisect_left(stations, station)
    return stations[index] if index < len(stations) else inf


# ---- Ahead


APPROACH_BRAKING: Final = 1.5  # Braking (m/s²) towards a slower vehicle far away
SEARCH_MARGIN: Final = 10.0  # Distance (m) searched beyond that of vehicles that matter


def approach_acceleration(
    ahead: VehiclesAhead, speed: float, policy: SpacingPolicy, limits: GapLimits
) -> float:
    """Acceleration (m/s²) behind a vehicle of any distance and speed, at the own `speed` (m/s).

    It is that of `gap_acceleration` near the desired spacing. Further away that law would brake at
    once for a standing vehicle; here the speed of approach is that of constant braking,
    sqrt(2 b (e - e0 / 2)) for a spacing error e, which continues the law smoothly at e0.
    """
    error = ahead.spacing - policy.desired(speed)
    stiffness = GAP_STIFFNESS / DAMPING
    linear = APPROACH_BRAKING / (stiffness * stiffness)
    if error <= linear:
        return gap_acceleration(ahead, speed, policy, limits)
    closing = sqrt(2.0 * APPROACH_BRAKING * (error - 0.5 * linear))
    wanted = DAMPING * (ahead.predecessor_speed + closing - speed)
    return min(max(wanted, -limits.deceleration), limits.acceleration)


class ConvoyMember(NamedTuple):
    """A follower: its name and car, the period (s) of its messages, and its first station (m)."""

    name: str
    car: VehicleParameters
    period: float
    station: float


class _AheadMember:
    """Newest pose of a member of the convoy, and where the lead's strip first meets its body.

    `contact` (m) is that station, NaN without one; `along` is the cosine of the angle between the
    member and the path there, at least 0. The path was searched until `searched` (m). `track` has
    the member's own station; it is `outdated` if a car behind it has been received further on.
    """

    def __init__(
        self, member: ConvoyMember, track: MemberTrack, settings: DegradationSettings
    ) -> None:
        self.name, self.car, self.track = member.name, member.car, track
        self.late = settings.late_periods * member.period
        self.lost = settings.lost_after_silence(member.period)
        self.pose: ReceivedPose | None = None
        self.contact = nan
        self.along = 0.0
        self.searched = -inf
        self.outdated = False


class _MemberMotion(NamedTuple):
    """Distance (m) driven since the newest pose, speed (m/s) and acceleration (m/s²)."""

    driven: float
    speed: float
    acceleration: float


class _Obstacle(NamedTuple):
    """First station (m) that the lead must not reach, at the instant of the member's newest pose.

    It moves at `along` times the speed of the member.
    """

    member: _AheadMember
    station: float
    along: float


class ConvoyAhead:
    """Limits the lead's acceleration behind members of its convoy on its path ahead.

    A member is on the path where its body reaches into the strip that the lead's body sweeps; on
    another leg of a loop it is not. The lead also waits before a part of the path that its last
    member has yet to drive (`ReservedPath`). A member moves as announced by its newest pose. Silent
    for longer than the time after which a source is lost, it is assumed to brake firmly from then
    on, and to stand until it or a car behind it is received further on. A silent car may stand
    anywhere on its path and nothing else would show it, so the lead waits for good if need be.

    `reason` is that of the last limit, `silent` the state of its member if that is silent.
    """

    def __init__(  # noqa: PLR0917 - parts of one law
        self,
        path: SampledPath,
        lap: float,
        car: VehicleParameters,
        members: Sequence[ConvoyMember],
        settings: DegradationSettings,
        policy: SpacingPolicy,
        limits: GapLimits,
        start_at: int = 0,
    ) -> None:
        """`members` are ordered from front to back at `start_at` (ns); `lap` (m) is 0 if open.

        `policy` gives the gap between bumpers.
        """
        self._path, self._lap = path, lap
        self._lane = Lane(path, car)
        self._firm, self._emergency = settings.firm, settings.emergency
        self._policy, self._limits = policy, limits
        self._members = {
            member.name: _AheadMember(member, MemberTrack(path, member.station, start_at), settings)
            for member in members
        }
        self._last = self._members[members[-1].name]
        self._reserved = ReservedPath(path, self._lane, members[-1].car)
        self._start_at = start_at
        self.reason = ""
        self.silent: SourceState | None = None

    def observe(self, received: Sequence[ReceivedPose]) -> None:
        for pose in received:
            member = self._members.get(pose.message.vehicle)
            if member is None:
                continue
            if member.pose is None or pose.measured_at > member.pose.measured_at:
                member.pose, member.searched = pose, -inf
                member.track.move(pose)
        furthest = -inf
        for member in reversed(self._members.values()):
            member.outdated = member.track.station <= furthest
            furthest = max(furthest, member.track.station)

    def acceleration(self, now: int, station: float, speed: float, last: float) -> float:
        """Largest acceleration (m/s²) at `station` (m) and `speed` (m/s), infinite if free.

        `last` (m/s²) is the last command.
        """
        most, self.reason, self.silent = inf, "", None
        for obstacle in self._obstacles(station, speed):
            member = obstacle.member
            motion = self._motion(now, obstacle)
            first_gap = obstacle.station - station - self._lane.front
            gap = first_gap + motion.driven
            if gap < -self._lane.front:
                continue  # the lead has passed it
            ahead = VehiclesAhead(gap, motion.speed, predecessor_acceleration=motion.acceleration)
            wanted = approach_acceleration(ahead, speed, self._policy, self._limits)
            silence = (now - self._received_at(member)) / SECOND
            if silence > member.late:
                wanted = min(wanted, self._guarded(first_gap, obstacle, speed, last))
            if wanted < most:
                most = wanted
                self.reason = f"keeps distance from {member.name}, {gap:.1f} m ahead"
                self.silent = None
                if silence > member.lost:
                    self.reason = (
                        f"keeps distance from where {member.name} may stand, {gap:.1f} m ahead, "
                        f"silent for {silence:.1f} s"
                    )
                    self.silent = SourceState("lost", silence, silence, known=max(gap, 0.0))
        return most

    def _received_at(self, member: _AheadMember) -> int:
        return self._start_at if member.pose is None else member.pose.received_at

    def _obstacles(self, station: float, speed: float) -> Iterator[_Obstacle]:
        """Yield the members whose bodies are in the strip ahead, and the reserved path."""
        matters = self._policy.desired(speed) + 0.5 * speed * speed / APPROACH_BRAKING
        until = station + self._lane.front + matters + SEARCH_MARGIN
        for member in self._members.values():
            pose = member.pose
            if pose is None or member.outdated:
                continue
            if member.searched == -inf or (
                until > member.searched and not member.contact <= member.searched
            ):
                member.searched = until + SEARCH_MARGIN
                self._search(member, pose, station)
            if not isnan(member.contact):
                yield _Obstacle(member, member.contact, member.along)
        yield from [one for one in self._behind_last(station) if one.station <= until]

    def _behind_last(self, station: float) -> Iterator[_Obstacle]:
        """Yield the reserved path, and on a closed path the last member a lap ahead of itself.

        The latter paces a lead that the reserved path would stop.
        """
        last = self._last
        accuracy = 0.0 if last.pose is None else last.pose.accuracy
        entry = self._reserved.entry(last.track.station - accuracy, station - self._lane.front)
        yield _Obstacle(last, entry.station, entry.rate)
        if self._lap:
            rear = 0.5 * last.car.length - last.car.body_offset
            yield _Obstacle(last, last.track.station + self._lap - rear, 1.0)

    def _search(self, member: _AheadMember, pose: ReceivedPose, station: float) -> None:
        body = outline_of(member.car, pose.east, pose.north, pose.yaw)
        member.contact = nan
        until = member.searched - station
        for low, high, added in lap_ranges(self._path, self._lap, station, until):
            contact = self._lane.first_contact(body, low, high, pose.accuracy)
            if contact is not None:
                member.contact = contact + added
                member.along = max(cos(pose.yaw - self._path.at(contact).yaw), 0.0)
                break

    def _motion(self, now: int, obstacle: _Obstacle) -> _MemberMotion:
        """Motion along the path since the pose, as announced; if silent, to a firm stop."""
        member, along, pose = obstacle.member, obstacle.along, obstacle.member.pose
        if pose is None:
            return _MemberMotion(0.0, 0.0, 0.0)
        message = pose.message
        age = (now - pose.measured_at) / SECOND
        known = min(age, member.lost)
        driven, speed, acceleration = predicted_motion(
            max(pose.speed, 0.0),
            message.achieved_acceleration_mps2,
            message.acceleration_mps2,
            known,
            0.0,
        )
        if age > known:
            braking = self._firm.deceleration
            rest = min(age - known, speed / braking)
            driven += (speed - 0.5 * braking * rest) * rest
            speed -= braking * rest
            acceleration = -braking if speed > 0.0 else 0.0
        return _MemberMotion(driven * along, speed * along, acceleration * along)

    def _guarded(self, gap: float, obstacle: _Obstacle, speed: float, last: float) -> float:
        """Largest acceleration (m/s²) that stops behind a member which braked after its pose."""
        emergency = self._emergency
        pose = obstacle.member.pose
        its_speed = 0.0 if pose is None else max(pose.speed, 0.0) * obstacle.along
        own_stop = stopping_distance(speed, last, emergency)
        reserve = safe_reserve(gap, its_speed, emergency.deceleration, own_stop)
        share = braking_share(reserve, speed)
        return -share * emergency.deceleration if share > 0.0 else inf
