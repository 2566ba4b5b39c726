"""Speed of a vehicle: a profile over time, or the gap to the vehicle ahead; SI units.

A gap is between bumpers; a *spacing*, by which it is kept, is between centres of mass.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Final, Protocol

from vehicles.driver.ego.own_state import Pose
from vehicles.schedule import SECOND

PROFILE_CORRECTION: Final = 0.5
"""Acceleration per speed error when following a profile (1/s)."""

CORRECTION_MAX: Final = 2.0
"""Limit (m/s²) of that correction, reached for example after a restart."""

GAP_STIFFNESS: Final = 3.0
"""k_p, acceleration per metre of spacing error (1/s²)."""

DAMPING: Final = 4.0
"""k_v + k_l, acceleration per m/s of speed difference to predecessor and lead (1/s)."""

LEAD_SHARE: Final = 0.5
"""Share of k_l in the damping at constant distance, and of the lead in the CACC feedforward."""

LEAD_PULL_DISTANCE: Final = 0.5
"""Limit (m) of the spacing error due to a lead that is faster than the predecessor."""

STABLE_HEADWAY: Final = 0.35
"""From this headway (s) on the lead's speed is neither needed nor used."""

CATCH_UP_DISTANCE: Final = 5.0
"""Limit (m) of the spacing error."""

BEND_RATE: Final = 2.0
"""Deceleration per excess speed in a bend (1/s)."""

BRAKING_BEFORE: Final = 0.5
"""Driving time (s) before a bend within which braking for the bend fades out."""

BEND_TIMES = (0.0, 0.4, 0.8)
"""Times ahead (s) at which a follower evaluates the curvature, up to the paper's preview."""


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


@dataclass(frozen=True, slots=True)
class SpacingPolicy:
    """The spacing to keep (m): `standstill` (m) plus `headway` (s) times speed.

    Constant time headway policy; a headway of 0 keeps a constant distance.
    """

    standstill: float
    headway: float = 0.0

    def __post_init__(self) -> None:
        _require_not_negative(self)

    def desired(self, speed: float) -> float:
        return self.standstill + self.headway * speed


@dataclass(frozen=True, slots=True)
class GapLimits:
    """Limits of acceleration and braking (m/s²) for the constant time headway policy.

    Both are positive. 2 m/s² is brisk driving; 6 m/s² is hard braking on a dry road with some grip
    in reserve, twice the braking of a lead, so that followers can compensate their delay. `lateral`
    (m/s²) is the largest lateral acceleration in bends, infinite for no limit; `before_bends` is
    the braking before bends of the known path.
    """

    acceleration: float = 2.0
    deceleration: float = 6.0
    lateral: float = math.inf
    before_bends: float = 2.5

    def __post_init__(self) -> None:
        _require_not_negative(self)


def _require_not_negative(values: SpacingPolicy | GapLimits) -> None:
    for field in fields(values):
        value = getattr(values, field.name)
        if not (value >= 0.0 and (math.isfinite(value) or field.name == "lateral")):
            raise ValueError(f"{field.name} must be a number of at least 0, not {value}")


@dataclass(slots=True)
class VehiclesAhead:
    """Motion of the vehicles ahead, predicted from their newest poses; NaN where unknown.

    `spacing` (m) to the predecessor is along its trace; speeds are in m/s, accelerations in m/s².
    `curvature_ahead` maps a distance (m) ahead to the curvature (1/m) of the path. `bend` is the
    squared speed (m²/s²) that the received path allows, and the distance (m) of its bend, if any.
    """

    spacing: float = math.nan
    predecessor_speed: float = math.nan
    lead_speed: float = math.nan
    predecessor_acceleration: float = 0.0
    lead_acceleration: float = math.nan
    curvature_ahead: Callable[[float], float] | None = None
    bend: tuple[float, float] | None = None

    def __init__(  # noqa: PLR0917 - its fields
        self,
        spacing: float = math.nan,
        predecessor_speed: float = math.nan,
        lead_speed: float = math.nan,
        predecessor_acceleration: float = 0.0,
        lead_acceleration: float = math.nan,
        curvature_ahead: Callable[[float], float] | None = None,
        bend: tuple[float, float] | None = None,
    ) -> None:
        self.spacing = spacing
        self.predecessor_speed = predecessor_speed
        self.lead_speed = lead_speed
        self.predecessor_acceleration = predecessor_acceleration
        self.lead_acceleration = lead_acceleration
        self.curvature_ahead = curvature_ahead
        self.bend = bend

    def replaced(
        self, spacing: float, lead_speed: float, lead_acceleration: float
    ) -> "VehiclesAhead":
        """Copy with another spacing and motion of the lead; `replace` costs 1 % of a tick."""
        return VehiclesAhead(
            spacing,
            self.predecessor_speed,
            lead_speed,
            self.predecessor_acceleration,
            lead_acceleration,
            self.curvature_ahead,
            self.bend,
        )


def gap_acceleration(
    ahead: VehiclesAhead, own_speed: float, policy: SpacingPolicy, limits: GapLimits
) -> float:
    """Acceleration (m/s²) within `limits` that keeps the gap at `own_speed` (m/s).

    a = k_p (spacing - desired) + k_v (v_pred - v) + k_l (v_lead - v) + feedforward, the CACC law of
    PATH (Rajamani, Vehicle Dynamics and Control, eq. 7.39). At constant distance the feedforward is
    the mean of both accelerations, which all vehicles then share; without it, spacings would be
    b / k_p too short while all brake at b: 2 m for 6 m/s².

    At constant distance the transfer of errors from one vehicle to the next,
    (s²/2 + k_v s + k_p) / (s² + (k_v + k_l) s + k_p), never exceeds 1 if
    (k_v + k_l)² - k_v² >= k_p: here 12 >= 3, with a margin for radio delay. Without the lead's
    speed (k_l = 0) there would be none (Swaroop and Hedrick, 1996).

    With a headway h the predecessor alone suffices if k_p h² + 2 k_v h >= 2 (h >= 0.23 s here)
    without feedforward. The lead's speed would even do harm: in steady braking the i-th vehicle is
    i h a faster than the lead, so errors would grow with i. Its share therefore fades out towards
    STABLE_HEADWAY. The feedforward fades out as 1 - (k_v + k_l) h, which leaves no spacing error in
    steady braking; from 0.25 s on the speed difference is enough.

    The wider gap behind a predecessor that brakes as hard as the car can is not closed: the car
    could no longer lose the speed for it. From half of the limit on, it is closed less.

    Motion of the lead that is NaN (nothing received) is replaced by the predecessor's. A lead that
    drives on while the predecessor brakes on its own, for example without data, moves the car at
    most `LEAD_PULL_DISTANCE` closer.
    """
    speed, acceleration = ahead.predecessor_speed, ahead.predecessor_acceleration
    feedforward = max(0.0, 1.0 - DAMPING * policy.headway)
    pull = 0.0
    if not math.isnan(ahead.lead_speed):
        share = LEAD_SHARE * max(0.0, 1.0 - policy.headway / STABLE_HEADWAY)
        pull = DAMPING * share * (ahead.lead_speed - speed)
    if not math.isnan(ahead.lead_acceleration):
        pull += feedforward * LEAD_SHARE * (ahead.lead_acceleration - acceleration)
    error = min(ahead.spacing - policy.desired(own_speed), CATCH_UP_DISTANCE)
    if error > 0.0 and 0.0 < limits.deceleration < -2.0 * acceleration:
        left = max(2.0 * (1.0 + acceleration / limits.deceleration), 0.0)
        error = min(error, CATCH_UP_DISTANCE * left)
    wanted = GAP_STIFFNESS * error + DAMPING * (speed - own_speed) + feedforward * acceleration
    wanted += min(pull, GAP_STIFFNESS * LEAD_PULL_DISTANCE)
    return min(max(wanted, -limits.deceleration), limits.acceleration)


def bend_acceleration(
    speed: float, curvature_ahead: Callable[[float], float] | None, limits: GapLimits
) -> float:
    """Largest acceleration (m/s²) of a follower in the bends of its path (m/s, 1/m).

    A predecessor that leaves a bend accelerates while its followers are still in it. At a distance
    s the bend allows v² <= a_lat/|κ| + 2 b s, where b is half the braking limit; an excess is
    reduced at `BEND_RATE`.
    """
    if curvature_ahead is None or limits.lateral == math.inf:
        return math.inf
    allowed = math.inf
    for time in BEND_TIMES:
        bend = abs(curvature_ahead(time * speed))
        if bend > 0.0:
            squared = limits.lateral / bend + limits.deceleration * time * speed
            allowed = min(allowed, squared)
    return max(BEND_RATE * (math.sqrt(allowed) - speed), -limits.deceleration)


def known_bend_acceleration(speed: float, bend: tuple[float, float], limits: GapLimits) -> float:
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
    """Acceleration (m/s²), dv_x/dt of Section IV-A, and target speed (m/s)."""

    acceleration: float
    target_speed: float

    def __init__(self, acceleration: float, target_speed: float) -> None:
        self.acceleration = acceleration
        self.target_speed = target_speed


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
        self,
        profile: SpeedProfile,
        start_at: int,
        period: float,
        limits: GapLimits | None = None,
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
        if self._limits is not None and ahead.bend is not None:
            wanted = min(wanted, known_bend_acceleration(pose.speed, ahead.bend, self._limits))
        return SpeedCommand(wanted, next_speed)


class GapKeeping:
    """Keeps a constant distance or time gap (see `gap_acceleration`)."""

    def __init__(self, policy: SpacingPolicy, limits: GapLimits) -> None:
        self._policy = policy
        self._limits = limits

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:  # noqa: ARG002
        """Keep the gap; keep the speed until the predecessor is received."""
        if math.isnan(ahead.spacing):
            return SpeedCommand(0.0, pose.speed)
        wanted = gap_acceleration(ahead, pose.speed, self._policy, self._limits)
        wanted = min(wanted, bend_acceleration(pose.speed, ahead.curvature_ahead, self._limits))
        if ahead.bend is not None:
            wanted = min(wanted, known_bend_acceleration(pose.speed, ahead.bend, self._limits))
        return SpeedCommand(wanted, ahead.predecessor_speed)
