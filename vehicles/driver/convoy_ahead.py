"""Members of the lead's own convoy that stand or drive on its path ahead; SI units.

A convoy that grows longer than a closed lap has its last cars in front of its lead. The lead
receives their poses and keeps its distance from them like a follower. Cars that have not yet joined
the lap have the right of way, since they follow the car ahead of them and do not expect the lead.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, isnan, nan, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import VehicleParameters
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import SourceFreshness
from vehicles.driver.degradation.speed_guard import GUARD_MARGIN, braking_share
from vehicles.driver.degradation.stopping import stopping_distance
from vehicles.driver.speed import (
    DAMPING,
    GAP_STIFFNESS,
    GapLimits,
    SpacingPolicy,
    VehiclesAhead,
    gap_acceleration,
)
from vehicles.geometry.sampled_path import WINDOW, FloatArray, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

APPROACH_BRAKING: Final = 1.5
"""Braking (m/s²) with which the lead approaches a slower vehicle from far away."""

SIDE_MARGIN: Final = 0.3
"""Distance (m) to either side of the lead's body that must be free."""

SEARCH_MARGIN: Final = 10.0
"""The path is searched this distance (m) beyond that within which a vehicle matters."""

ON_PATH: Final = 2.0
"""Distance (m) from the path up to which a member drives along it."""

SHARES: Final = np.linspace(0.0, 1.0, 33)
"""Points between two samples of the path, at most 8 mm apart, to locate the first contact."""


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


@dataclass(frozen=True, slots=True)
class Outline:
    """Body of a car on the ground: centre (m), yaw (rad) and half sizes (m)."""

    east: float
    north: float
    yaw: float
    half_length: float
    half_width: float

    @classmethod
    def of(cls, car: VehicleParameters, east: float, north: float, yaw: float) -> "Outline":
        """Outline of `car` with its centre of mass at (east, north)."""
        ahead = car.body_offset
        return cls(
            east + ahead * cos(yaw),
            north + ahead * sin(yaw),
            yaw,
            0.5 * car.length,
            0.5 * car.width,
        )


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
        path = self._path
        first, last = np.searchsorted(path.station, (low, high)).tolist()
        dx, dy = path.east[first:last] - body.east, path.north[first:last] - body.north
        reach = hypot(body.half_length, body.half_width) + self._widest + margin
        near = np.flatnonzero(dx * dx + dy * dy <= reach * reach) + first
        if not near.size:
            return None
        samples = (path.station, path.east, path.north, path.yaw, path.curvature)
        met = near[self._meets(body, margin, [values[near] for values in samples[1:]])]
        if not met.size:
            return None
        index = int(met[0])
        if index == first:
            return float(path.station[index])
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
        ux, uy = cos(body.yaw), sin(body.yaw)
        half = self._half_widths(curvature) + margin
        turned = yaw - body.yaw
        enters, leaves = -half, half
        for place, slope, size in (
            (dx * ux + dy * uy, -np.sin(turned), body.half_length),
            (dy * ux - dx * uy, np.cos(turned), body.half_width),
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


class _AheadMember:
    """Newest pose of a member of the convoy, and where the lead's strip first meets its body.

    `contact` (m) is that station, NaN without one; `along` is the cosine of the angle between the
    member and the path there, at least 0. The path was searched until `searched` (m). `station` (m)
    is the member's own on the path, NaN if unknown.
    """

    def __init__(self, name: str, car: VehicleParameters, late: float, lost: float) -> None:
        """Silent for `late` (s), it may be stopping; for `lost` (s), it is assumed to do so."""
        self.name = name
        self.car = car
        self.late = late
        self.lost = lost
        self.pose: ReceivedPose | None = None
        self.contact = nan
        self.along = 0.0
        self.searched = -inf
        self.station = nan
        self.measured_at = 0


class _MemberMotion(NamedTuple):
    """Distance (m) driven since the newest pose, speed (m/s) and acceleration (m/s²)."""

    driven: float
    speed: float
    acceleration: float


class ConvoyAhead:
    """Limits the lead's acceleration behind members of its convoy on its path ahead.

    A member is on the path where its body reaches into the strip that the lead's body sweeps; on
    another leg of a loop it is not. On a closed path it is also a lap ahead of its own station, so
    that the lead lets the last member join the lap before it. A member moves as announced by its
    newest pose. Silent for longer than the time after which a source is lost, it is assumed to
    brake firmly from then on, and to stand until it is received again.
    """

    def __init__(  # noqa: PLR0917 - parts of one law
        self,
        path: SampledPath,
        lap: float,
        car: VehicleParameters,
        members: Mapping[str, tuple[VehicleParameters, float]],
        settings: DegradationSettings,
        policy: SpacingPolicy,
        limits: GapLimits,
    ) -> None:
        """`members` are parameters and period (s) of messages by name; `lap` (m) is 0 if open.

        `policy` gives the gap between bumpers.
        """
        self._path, self._lap = path, lap
        self._lane = Lane(path, car)
        self._firm, self._emergency = settings.firm, settings.emergency
        self._policy, self._limits = policy, limits
        self._members = {
            name: _AheadMember(
                name,
                parameters,
                settings.late_periods * period,
                settings.lost_after_silence(period),
            )
            for name, (parameters, period) in members.items()
        }
        self.reason = ""

    def observe(self, received: Sequence[ReceivedPose]) -> None:
        for pose in received:
            member = self._members.get(pose.message.vehicle)
            if member is None:
                continue
            if member.pose is None or pose.measured_at > member.pose.measured_at:
                member.pose, member.searched = pose, -inf

    def acceleration(self, now: int, station: float, speed: float, last: float) -> float:
        """Largest acceleration (m/s²) at `station` (m) and `speed` (m/s), infinite if free.

        `last` (m/s²) is the last command.
        """
        most, self.reason = inf, ""
        for member, pose in self._on_path(station, speed):
            motion = self._motion(now, member, pose)
            gap = member.contact + motion.driven - station - self._lane.front
            if gap < -self._lane.front:
                continue  # the lead has passed it
            ahead = VehiclesAhead(gap, motion.speed, predecessor_acceleration=motion.acceleration)
            wanted = approach_acceleration(ahead, speed, self._policy, self._limits)
            silence = (now - pose.received_at) / SECOND
            if silence > member.late:
                first_gap = member.contact - station - self._lane.front
                wanted = min(wanted, self._guarded(first_gap, pose, member, speed, last))
            if wanted < most:
                most = wanted
                silent = f", silent for {silence:.1f} s" if silence > member.lost else ""
                self.reason = f"keeps distance from {member.name}, {gap:.1f} m ahead{silent}"
        return most

    def _on_path(self, station: float, speed: float) -> Iterator[tuple[_AheadMember, ReceivedPose]]:
        """Yield the members whose bodies are in the strip ahead, with their newest poses."""
        matters = self._policy.desired(speed) + 0.5 * speed * speed / APPROACH_BRAKING
        until = station + self._lane.front + matters + SEARCH_MARGIN
        for member in self._members.values():
            pose = member.pose
            if pose is None:
                continue
            if member.searched == -inf or (
                until > member.searched and not member.contact <= member.searched
            ):
                member.searched = until + SEARCH_MARGIN
                self._search(member, pose, station)
            if not isnan(member.contact):
                yield member, pose

    def _search(self, member: _AheadMember, pose: ReceivedPose, station: float) -> None:
        body = Outline.of(member.car, pose.east, pose.north, pose.yaw)
        member.contact = nan
        until = member.searched - station
        for low, high, added in lap_ranges(self._path, self._lap, station, until):
            contact = self._lane.first_contact(body, low, high, pose.accuracy)
            if contact is not None:
                member.contact = contact + added
                member.along = max(cos(pose.yaw - self._path.at(contact).yaw), 0.0)
                break
        if self._lap:
            self._search_lap(member, pose, station)

    def _search_lap(self, member: _AheadMember, pose: ReceivedPose, station: float) -> None:
        """Take the contact a lap ahead of the member's own station, if it is nearer.

        That station lies within a lap behind the lead, and near the last one.
        """
        low, high = station - self._lap, station
        if not isnan(member.station):
            driven = max(pose.speed, 0.0) * (pose.measured_at - member.measured_at) / SECOND
            low = max(low, member.station - WINDOW)
            high = max(min(high, member.station + driven + WINDOW), low)
        foot = self._path.project(pose.east, pose.north, 0.5 * (low + high), 0.5 * (high - low))
        if abs(foot.lateral) > ON_PATH:
            member.station = nan
            return
        member.station, member.measured_at = foot.station, pose.measured_at
        rear = 0.5 * member.car.length - member.car.body_offset
        contact = foot.station + self._lap - rear
        if not contact >= member.contact:
            member.contact, member.along = contact, max(cos(pose.yaw - foot.yaw), 0.0)

    def _motion(self, now: int, member: _AheadMember, pose: ReceivedPose) -> _MemberMotion:
        """Motion along the path since the pose, as announced; if silent, to a firm stop."""
        message, along = pose.message, member.along
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

    def _guarded(
        self, gap: float, pose: ReceivedPose, member: _AheadMember, speed: float, last: float
    ) -> float:
        """Largest acceleration (m/s²) that stops behind a member which braked after its pose.

        The safe distance of Shalev-Shwartz, Shammah and Shashua, 2017 (RSS), as in `SpeedGuard`.
        """
        emergency = self._emergency
        its_speed = max(pose.speed, 0.0) * member.along
        stands = gap + its_speed * its_speed / (2.0 * emergency.deceleration)
        reserve = stands - GUARD_MARGIN - stopping_distance(speed, last, emergency)
        share = braking_share(reserve, speed)
        return -share * emergency.deceleration if share > 0.0 else inf
