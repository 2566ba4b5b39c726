"""Speed of a vehicle: a profile over time, or the gap to the vehicle ahead; SI units."""

import math
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf
from typing import Final

from vehicles.driver.controller import (
    GapLimits,
    LongitudinalController,
    LongitudinalSetup,
    VehiclesAhead,
)
from vehicles.driver.longitudinal_laws import Fallback, GapLaw
from vehicles.driver.own_state import Pose
from vehicles.geometry.geodesy import along
from vehicles.messages import Override
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

PROFILE_CORRECTION: Final = 0.5  # Acceleration per speed error when following a profile (1/s)
CORRECTION_MAX: Final = 2.0  # Limit (m/s²) of that correction, reached for example after a restart


@dataclass(frozen=True)
class SpeedProfile:
    """Speed (m/s) over time (s), piecewise linear, constant before the first and after the last.

    The predetermined profile of Section V-C.3, Fig. 11.
    """

    times: tuple[float, ...]
    speeds: tuple[float, ...]

    def __post_init__(self) -> None:
        times, speeds = self.times, self.speeds
        if len(times) != len(speeds) or not times:
            raise ValueError("times and speeds must be equal in number, at least one each")
        if not all(map(math.isfinite, (*times, *speeds))) or min(speeds) < 0.0:
            raise ValueError("times and speeds must be finite numbers, speeds not negative")
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("the times of a speed profile must increase")

    def at(self, seconds: float) -> tuple[float, float]:
        """Speed (m/s) and acceleration (m/s²); at a corner, the acceleration that follows it."""
        times, speeds = self.times, self.speeds
        index = bisect_right(times, seconds) - 1
        if index < 0:
            return speeds[0], 0.0
        if index == len(times) - 1:
            return speeds[-1], 0.0
        slope = (speeds[index + 1] - speeds[index]) / (times[index + 1] - times[index])
        return speeds[index] + slope * (seconds - times[index]), slope

    @cached_property
    def _corners(self) -> list[tuple[float, float, float]]:
        """Time (s), speed (m/s) and distance driven (m) at time 0 and each later corner."""
        corners = [(0.0, self.at(0.0)[0], 0.0)]
        for time, speed in zip(self.times, self.speeds, strict=True):
            begin, before, driven = corners[-1]
            if time > 0.0:
                corners.append((time, speed, driven + 0.5 * (before + speed) * (time - begin)))
        return corners

    def distance(self, seconds: float) -> float:
        """Distance (m) driven from time 0 to `seconds`, by the trapezoidal rule."""
        index = bisect_right(self._corners, (seconds, math.inf)) - 1
        begin, speed, driven = self._corners[max(index, 0)]
        return driven + 0.5 * (speed + self.at(seconds)[0]) * (seconds - begin)

    def time_to(self, distance: float) -> float:
        """Time (s) after which `distance` (m) is driven; infinite if it is never reached."""
        index = bisect_left([driven for *_, driven in self._corners], distance) - 1
        begin, speed, driven = self._corners[max(index, 0)]
        rest = distance - driven
        if rest <= 0.0:
            return begin
        root = math.sqrt(max(speed * speed + 2.0 * self.at(begin)[1] * rest, 0.0))
        return begin + 2.0 * rest / (speed + root) if speed + root > 0.0 else math.inf


# ---- Bends of the known path ahead: how fast a follower may drive now to take them


BEND_RATE: Final = 2.0  # Deceleration per excess speed in a bend (1/s)
BRAKING_BEFORE: Final = 0.5  # Driving time (s) before a bend in which braking fades out
MIN_SPEED: Final = 1.0  # Below this speed (m/s) a measured yaw rate does not determine a curvature
SPACING: Final = 0.5  # Poses of a source that has moved less than this (m) are skipped
CAPACITY: Final = 4096  # Largest number of poses kept ahead of the car


class BendsAhead:
    """Speed limit by the poses that a source sent from the path ahead.

    A pose at the distance s ahead with curvature κ, its yaw rate over its speed, allows
    v² <= a_lat/|κ| + 2 b s (elementary algebra). Of two poses only the later one counts if it
    allows less now: it will then do so until it is passed.
    """

    def __init__(self, lateral: float, limits: GapLimits) -> None:
        """`lateral` (m/s²) is the acceleration in bends."""
        self._lateral, self._limits = lateral, limits
        self._path: deque[tuple[float, float, float, float]] = deque(maxlen=CAPACITY)
        self._bends: deque[tuple[float, float]] = deque(maxlen=CAPACITY)
        self._newest_at = 0

    def add(self, pose: ReceivedPose) -> None:
        """Take a pose; late ones are ignored."""
        if pose.measured_at <= self._newest_at:
            return
        self._newest_at = pose.measured_at
        station = 0.0
        if self._path:
            before, east, north, _ = self._path[-1]
            moved = math.hypot(pose.east - east, pose.north - north)
            if moved < SPACING:
                return
            station = before + moved
        self._path.append((station, pose.east, pose.north, pose.yaw))
        if pose.speed < MIN_SPEED or pose.yaw_rate == 0.0:
            return
        bends = self._bends
        squared = self._lateral * pose.speed / abs(pose.yaw_rate)
        squared += 2.0 * self._limits.before_bends * station
        while bends and bends[-1][1] >= squared:
            bends.pop()
        bends.append((station, squared))

    def acceleration(self, pose: Pose) -> float:
        """Largest acceleration (m/s²) before and in bends, infinite without one ahead."""
        path, bends, limits = self._path, self._bends, self._limits
        while len(path) > 1 and _station_along(path[1], pose) >= path[1][0]:
            path.popleft()
        station = _station_along(path[0], pose) if path else 0.0
        while bends and bends[0][0] < station:
            bends.popleft()
        if not bends:
            return inf
        at, squared = bends[0]
        squared -= 2.0 * limits.before_bends * station
        return bend_acceleration(pose.speed, squared, at - station, limits)


def bend_acceleration(speed: float, squared: float, distance: float, limits: GapLimits) -> float:
    """Largest acceleration (m/s²) where `squared` (m²/s²) is allowed, `distance` (m) before a bend.

    The allowed speed decreases at `limits.before_bends` towards the bend. The car brakes by that in
    advance, because correcting an excess lags behind.
    """
    allowed = math.sqrt(max(squared, 0.0))
    share = distance / (BRAKING_BEFORE * speed) if speed > 0.0 else 0.0
    braking = limits.before_bends * min(share, 1.0)
    return max(BEND_RATE * (allowed - speed) - braking, -limits.deceleration)


def _station_along(point: tuple[float, float, float, float], pose: Pose) -> float:
    """Station (m) of a position by its distance ahead of a `point`."""
    station, east, north, yaw = point
    return station + along(yaw, pose.east - east, pose.north - north)


# ---- Speed control


@dataclass(slots=True)
class SpeedCommand:
    """Acceleration (m/s²), dv_x/dt of Section IV-A, and target speed (m/s).

    Of a follower, `law` is the acceleration of its longitudinal law, limited in bends, `override`
    why it was replaced, and `evidence` states the reason with its figures.
    """

    acceleration: float
    target_speed: float
    law: float = math.nan
    override: Override = ""
    evidence: str = ""


def profile_correction(wanted: float, speed: float) -> float:
    """Acceleration (m/s²) that gently reduces a speed error (m/s)."""
    return min(max(PROFILE_CORRECTION * (wanted - speed), -CORRECTION_MAX), CORRECTION_MAX)


class ProfileSpeed:
    """Follows the same speed over time as all other vehicles (paper, Section V-C)."""

    def __init__(self, profile: SpeedProfile, start_at: int, period: float) -> None:
        """`period` (s) is the control period over which a command is held."""
        self._profile = profile
        self._start_at = start_at
        self._period = period

    def follow(self, profile: SpeedProfile) -> None:
        """Replace the profile; its time still starts with the run."""
        self._profile = profile

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        """Mean acceleration of the profile over the coming period, plus a mild correction."""
        seconds = (now - self._start_at) / SECOND
        speed, _ = self._profile.at(seconds)
        next_speed, _ = self._profile.at(seconds + self._period)
        wanted = (next_speed - speed) / self._period + profile_correction(speed, pose.speed)
        return SpeedCommand(wanted, next_speed)


class GapKeeping:
    """Keeps a gap by a longitudinal controller."""

    def __init__(
        self, setup: LongitudinalSetup, controller: LongitudinalController | None = None
    ) -> None:
        """By `GapLaw` without a `controller`; without poses by ACC at `fallback_headway` (s)."""
        self._limits = setup.limits
        self._controller = controller or GapLaw(setup)
        self._needs_poses: bool = getattr(self._controller, "needs_poses", True)
        least = max(setup.policy.headway, Fallback.fallback_headway)
        self.fallback_headway: float = getattr(self._controller, "fallback_headway", least)

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        """Keep the gap; keep the speed until the predecessor, or any source, is received.

        A controller that needs no poses keeps the gap that the on-board sensor measures.
        """
        by_sensor = not self._needs_poses and not math.isnan(ahead.measured_gap)
        if math.isnan(ahead.spacing) and not ahead.sources and not by_sensor:
            return SpeedCommand(0.0, pose.speed)
        limits = self._limits
        wanted = self._controller.acceleration(pose.speed, ahead)
        wanted = min(max(wanted, -limits.deceleration), limits.acceleration)
        target = ahead.predecessor_speed
        return SpeedCommand(wanted, pose.speed if math.isnan(target) else target)


SpeedLaw = ProfileSpeed | GapKeeping
"""Longitudinal control: by a profile, as in Section V-C.3, or by a gap."""
