"""Members of the lead's own convoy that stand or drive on its path ahead; SI units.

A convoy that grows longer than a closed lap has its last cars in front of its lead. The lead
receives their poses and keeps its distance from them like a follower. Cars that have yet to drive a
part of the path have the right of way there, since they follow the car ahead of them and do not
expect the lead.
"""

from collections.abc import Iterator, Sequence
from math import cos, inf, isnan, nan, sqrt
from typing import Final, NamedTuple

from vehicles.car.outline import outline_of
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.convoy.lane import Lane, lap_ranges
from vehicles.driver.convoy.reserved import ReservedPath
from vehicles.driver.convoy.stations import MemberTrack
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import SourceFreshness
from vehicles.driver.degradation.stopping import braking_share, safe_reserve, stopping_distance
from vehicles.driver.longitudinal.controller import VehiclesAhead
from vehicles.driver.longitudinal.gap_keeping import DAMPING, GAP_STIFFNESS, gap_acceleration
from vehicles.driver.longitudinal.spacing import GapLimits, SpacingPolicy
from vehicles.geometry.sampled_path import SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

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
        self.silent: SourceFreshness | None = None

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
                    self.silent = SourceFreshness("lost", silence, silence, known=max(gap, 0.0))
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
        announced = SourceFreshness(
            age=known, speed=max(pose.speed, 0.0), acceleration=message.acceleration_mps2
        )
        driven, speed, acceleration = announced.predicted_motion()
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
