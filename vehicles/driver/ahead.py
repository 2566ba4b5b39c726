"""The last car of the lead's own convoy on its path ahead; SI units.

Followers drive the lead's path one after the other and do not look for crossing traffic. At a
crossing, or where a closed path begins again, two cars can therefore meet only if the lead comes
there a second time before its last car has passed it once. The lead receives the poses of that car
and keeps its distance from the part of the path that it has yet to drive, like a follower.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import InitVar, dataclass
from math import cos, floor, inf, pi, sin, sqrt
from typing import Final

import numpy as np

from vehicles.car.parameters import VehicleParameters
from vehicles.driver.controller import (
    GapLimits,
    SourceState,
    SpacingPolicy,
    VehiclesAhead,
    predicted_motion,
)
from vehicles.driver.longitudinal_laws import DAMPING, GAP_STIFFNESS, gap_acceleration
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.watch import ConvoyMember, MemberTrack
from vehicles.geometry.sampled_path import FloatArray, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Where a path meets itself


SIDE_MARGIN: Final = 0.3  # Distance (m) that must be free between two bodies side by side
STEP: Final = 1.0  # Length (m) of the slices of a path that are checked
SHORTEST: Final = 5.0  # Least distance (m) along a path between two places that meet
LEAST_TURN: Final = 0.9 * pi  # A path whose direction (rad) varies less does not meet itself


class ReservedPath:
    """The first part of the path ahead that the convoy must drive before the lead may enter it.

    That is where the path comes back to the strip that a car sweeps along it. The outer front
    corner sweeps sqrt((R + w/2)² + l²) - R to the side in a bend of radius R, for a car of width w
    whose front bumper is l ahead of its centre of mass.
    """

    def __init__(self, path: SampledPath, cars: Sequence[VehicleParameters]) -> None:
        """Assume the largest of `cars` in both places."""
        self._path = path
        self._widths = np.max([_half_widths(path.curvature, car) for car in cars], axis=0)
        self._slices: deque[tuple[float, list[float]]] = deque()

    def meetings(self, station: float, until: float) -> list[float]:
        """First stations (m), each up to `until`, of returns to the slice at `station`."""
        path, place = self._path, self._path.at(station)
        first, last = np.searchsorted(path.station, (station + SHORTEST, until)).tolist()
        if first >= last:
            return []
        east, north = path.east[first:last] - place.east, path.north[first:last] - place.north
        forward, left = cos(place.yaw), sin(place.yaw)
        along, aside = east * forward + north * left, north * forward - east * left
        here = np.interp(station, path.station, self._widths)
        free = self._widths[first:last] + here + SIDE_MARGIN
        met = np.flatnonzero((along >= 0.0) & (along <= STEP) & (np.abs(aside) <= free))
        begins = met[np.diff(met, prepend=-2) > 1]
        samples = path.station[first + begins]
        # A path in the same direction has entered the slice by `along` before the sample.
        before = np.minimum(along[begins], samples - path.station[first + begins - 1])
        stations: list[float] = (samples - before).tolist()
        return stations

    def entry(self, rear: float, station: float) -> tuple[float, float]:
        """First entry from `station` (m) on, the rear bumper of the last car being at `rear` (m).

        Returns its station (m), infinite if there is none, and its speed relative to that of the
        car: 1 behind the car on the same road, 0 before a crossing that it has not passed.
        """
        slices, end = self._slices, float(self._path.station[-1])
        place = slices[-1][0] + STEP if slices else STEP * floor(rear / STEP)
        while place <= station:
            slices.append((place, self.meetings(place, end)))
            place += STEP
        while len(slices) > 1 and slices[1][0] <= rear:
            slices.popleft()
        firsts = [min([one for one in found if one >= station], default=inf) for _, found in slices]
        first = min(firsts, default=inf)
        moved = min(firsts[1:], default=inf) - first if first < inf else inf
        if moved > 2.0 * STEP:
            return first, 0.0
        share = min(max((rear - slices[0][0]) / STEP, 0.0), 1.0)
        return first + share * moved, min(moved / STEP, 1.0)


def _half_widths(curvature: FloatArray, car: VehicleParameters) -> FloatArray:
    bend, front = np.abs(curvature), 0.5 * car.length + car.body_offset
    swept = car.width + bend * (0.25 * car.width**2 + front**2)
    widths: FloatArray = swept / (np.sqrt(1.0 + bend * swept) + 1.0)
    return widths


def shortest_loop(
    path: SampledPath, lead: VehicleParameters, last: VehicleParameters, end: float, most: float
) -> float:
    """Length (m) of the shortest loop of a path up to `end` (m), infinite above `most` (m).

    A lead cannot drive around it while the spacings to all its followers up to the `last`, and the
    one that it keeps to that car ahead, add up to more. On a closed path it is the lap.
    """
    if np.ptp(path.yaw) < LEAST_TURN:
        return inf
    reserved, shortest = ReservedPath(path, (lead, last)), inf
    for station in np.arange(float(path.station[0]), end, STEP).tolist():
        found = reserved.meetings(station, min(station + most, end))
        if found:
            shortest = min(shortest, found[0] - station)
    return shortest


# ---- Ahead


APPROACH_BRAKING: Final = 1.5  # Braking (m/s²) towards a slower vehicle far away


@dataclass(kw_only=True, eq=False)
class ConvoyAhead:
    """Limits the lead's acceleration behind the last member of its convoy on its path ahead.

    `members` are ordered from front to back at `start_at` (ns); `lap` (m) is 0 if the path is open.
    `policy` gives the gap between bumpers.

    The last member moves as announced by its newest pose. Silent for longer than the time after
    which a source is lost, it is assumed to stand where firm braking would have ended, until it is
    received again. Nothing else would show where it stands, so the lead waits for good if need be.
    A member that announces that it leaves no longer counts.

    `reason` is that of the last limit, `silent` the state of the member if it is silent.
    """

    path: SampledPath
    lap: float
    car: VehicleParameters
    members: InitVar[Sequence[ConvoyMember]]
    settings: DegradationSettings
    policy: SpacingPolicy
    limits: GapLimits
    start_at: InitVar[int] = 0
    reason: str = ""
    silent: SourceState | None = None

    def __post_init__(self, members: Sequence[ConvoyMember], start_at: int) -> None:
        self._front = 0.5 * self.car.length + self.car.body_offset
        self._tracks = {one.name: MemberTrack(one, self.path, start_at) for one in members}
        self._reserved = ReservedPath(self.path, (self.car, *[one.car for one in members]))

    def observe(self, received: Sequence[ReceivedPose]) -> None:
        for pose in received:
            if pose.message.vehicle in self._tracks:
                self._tracks[pose.message.vehicle].receive(pose)

    def acceleration(self, now: int, station: float, speed: float) -> float:
        """Largest acceleration (m/s²) at `station` (m) and `speed` (m/s), infinite if free."""
        most, self.reason, self.silent = inf, "", None
        present = [track for track in self._tracks.values() if not track.has_left]
        if not present:
            return most
        last = present[-1]
        member, pose = last.member, last.newest
        rear = last.station - 0.5 * member.car.length + member.car.body_offset
        rear -= pose.accuracy if pose is not None else 0.0
        lost = self.settings.lost_after_silence(member.period)
        driven, its_speed, acceleration = self._motion(now, pose, lost)
        silence = (now - last.received_at) / SECOND
        lap = rear + self.lap if self.lap else inf
        entries = self._reserved.entry(rear, station - self._front), (lap, 1.0)
        for entry, rate in entries:
            gap = entry - station - self._front + driven * rate
            ahead = VehiclesAhead(gap, its_speed * rate)
            ahead.predecessor_acceleration = acceleration * rate
            wanted = self._approach(ahead, speed)
            if -self._front <= gap < inf and wanted < min(most, self.limits.acceleration):
                most = wanted
                where, since = member.name, ""
                if silence > lost:
                    where, since = f"where {member.name} may stand", f", silent for {silence:.1f} s"
                    self.silent = SourceState("lost", silence, silence, known=max(gap, 0.0))
                self.reason = f"keeps distance from {where}, {gap:.1f} m ahead{since}"
        return most

    def _approach(self, ahead: VehiclesAhead, speed: float) -> float:
        """Acceleration (m/s²) behind a vehicle of any distance, at the own `speed` (m/s).

        It is that of `gap_acceleration` near the desired spacing. Further away that law would brake
        at once for a standing vehicle; here the speed of approach is that of constant braking,
        sqrt(2 b (e - e0 / 2)) for a spacing error e, which continues the law smoothly at e0.
        """
        error, limits = ahead.spacing - self.policy.desired(speed), self.limits
        stiffness = GAP_STIFFNESS / DAMPING
        linear = APPROACH_BRAKING / (stiffness * stiffness)
        if error <= linear:
            return gap_acceleration(ahead, speed, self.policy, limits)
        closing = sqrt(2.0 * APPROACH_BRAKING * (error - 0.5 * linear))
        wanted = DAMPING * (ahead.predecessor_speed + closing - speed)
        return min(max(wanted, -limits.deceleration), limits.acceleration)

    def _motion(
        self, now: int, pose: ReceivedPose | None, lost: float
    ) -> tuple[float, float, float]:
        """Distance (m) driven since the pose, speed (m/s) and acceleration (m/s²)."""
        if pose is None:
            return 0.0, 0.0, 0.0
        age, message = (now - pose.measured_at) / SECOND, pose.message
        achieved, command = message.achieved_acceleration_mps2, message.acceleration_mps2
        speed = max(pose.speed, 0.0)
        driven, speed, acceleration = predicted_motion(
            speed, achieved, command, min(age, lost), self.car.drive_lag
        )
        if age > lost:
            return driven + speed * speed / (2.0 * self.settings.firm_deceleration), 0.0, 0.0
        return driven, speed, acceleration
