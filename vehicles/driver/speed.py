"""Speed of a vehicle: a profile over time, or the gap to the vehicle ahead; SI units."""

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol

from vehicles.driver.controller import (
    GapLimits,
    LongitudinalController,
    LongitudinalSetup,
    VehiclesAhead,
)
from vehicles.driver.longitudinal_laws import GapLaw
from vehicles.driver.own_state import Pose
from vehicles.messages import Override
from vehicles.schedule import SECOND

PROFILE_CORRECTION: Final = 0.5  # Acceleration per speed error when following a profile (1/s)
CORRECTION_MAX: Final = 2.0  # Limit (m/s²) of that correction, reached for example after a restart
BEND_RATE: Final = 2.0  # Deceleration per excess speed in a bend (1/s)
BRAKING_BEFORE: Final = 0.5  # Driving time (s) before a bend in which braking fades out


@dataclass(frozen=True, slots=True)
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

    def distance(self, seconds: float) -> float:
        """Distance (m) driven from time 0 to `seconds`, by the trapezoidal rule."""
        begin, speed = 0.0, self.at(0.0)[0]
        parts: list[float] = []
        for time, following in zip(self.times, self.speeds, strict=True):
            if time >= seconds:
                break
            if time > 0.0:
                parts.append(0.5 * (speed + following) * (time - begin))
                begin, speed = time, following
        parts.append(0.5 * (speed + self.at(seconds)[0]) * (seconds - begin))
        return sum(parts)

    def time_to(self, distance: float) -> float:
        """Time (s) after which `distance` (m) is driven; infinite if it is never reached."""
        driven, begin, speed = 0.0, 0.0, self.at(0.0)[0]
        for time, following in zip(self.times, self.speeds, strict=True):
            if time <= 0.0:
                continue
            step = 0.5 * (speed + following) * (time - begin)
            if driven + step >= distance:
                slope = (following - speed) / (time - begin)
                rest = distance - driven
                root = math.sqrt(max(speed * speed + 2.0 * slope * rest, 0.0))
                return begin + 2.0 * rest / (speed + root) if speed + root > 0.0 else begin
            driven += step
            begin, speed = time, following
        last = self.speeds[-1]
        return self.times[-1] + (distance - driven) / last if last > 0.0 else math.inf


def bend_acceleration(speed: float, bend: tuple[float, float], limits: GapLimits) -> float:
    """Largest acceleration (m/s²) of a follower before and in bends of the received path.

    `bend` is that of `VehiclesAhead`. The allowed speed decreases at `limits.before_bends`
    towards the bend. The car brakes by that in advance, because correcting an excess lags behind.
    """
    squared, distance = bend
    if squared == math.inf:
        return math.inf
    allowed = math.sqrt(squared) if squared > 0.0 else 0.0
    share = distance / (BRAKING_BEFORE * speed) if speed > 0.0 else 0.0
    braking = limits.before_bends * (share if share < 1.0 else 1.0)
    return max(BEND_RATE * (allowed - speed) - braking, -limits.deceleration)


@dataclass(slots=True)
class SpeedCommand:
    """Acceleration (m/s²), dv_x/dt of Section IV-A, and target speed (m/s).

    `bend` is the largest acceleration that bends permit, `unbent` the one wanted without them. Of a
    follower, `law` is the acceleration of its longitudinal law, `override` why it was replaced, and
    `evidence` states the reason with its figures.
    """

    acceleration: float
    target_speed: float
    bend: float = math.inf
    unbent: float = 0.0
    law: float = math.nan
    override: Override = ""
    evidence: str = ""


class SpeedLaw(Protocol):
    """Longitudinal control, as in Section V-C.3 or another."""

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand: ...


def profile_correction(wanted: float, speed: float) -> float:
    """Acceleration (m/s²) that gently reduces a speed error (m/s)."""
    correction = PROFILE_CORRECTION * (wanted - speed)
    if -CORRECTION_MAX <= correction <= CORRECTION_MAX:  # usual, and faster than min and max
        return correction
    return min(max(correction, -CORRECTION_MAX), CORRECTION_MAX)


class ProfileSpeed:
    """Follows the same speed over time as all other vehicles (paper, Section V-C)."""

    def __init__(
        self, profile: SpeedProfile, start_at: int, period: float, limits: GapLimits | None = None
    ) -> None:
        """`period` (s) is the control period over which a command is held.

        With `limits` a follower brakes before bends of the received path, and falls behind.
        """
        self._profile = profile
        self._start_at = start_at
        self._period = period
        self._limits = limits

    def follow(self, profile: SpeedProfile) -> None:
        """Replace the profile; its time still starts with the run."""
        self._profile = profile

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        """Mean acceleration of the profile over the coming period, plus a mild correction."""
        seconds = (now - self._start_at) / SECOND
        speed, _ = self._profile.at(seconds)
        next_speed, _ = self._profile.at(seconds + self._period)
        wanted = (next_speed - speed) / self._period + profile_correction(speed, pose.speed)
        if self._limits is None or ahead.bend is None:
            return SpeedCommand(wanted, next_speed, math.inf, wanted)
        bend = bend_acceleration(pose.speed, ahead.bend, self._limits)
        return SpeedCommand(min(wanted, bend), next_speed, bend, wanted)


class GapKeeping:
    """Keeps a gap by a longitudinal controller, and slows down in bends."""

    def __init__(
        self, setup: LongitudinalSetup, controller: LongitudinalController | None = None
    ) -> None:
        """Without a `controller`, that of `GapLaw`."""
        self._limits = setup.limits
        self._controller = controller or GapLaw(setup)
        self._needs_poses: bool = getattr(self._controller, "needs_poses", True)

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
        bend = math.inf
        if ahead.bend is not None:
            bend = bend_acceleration(pose.speed, ahead.bend, limits)
        target = ahead.predecessor_speed
        target = pose.speed if math.isnan(target) else target
        return SpeedCommand(min(wanted, bend), target, bend, wanted)
