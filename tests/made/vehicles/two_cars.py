"""Two cars on a straight, to test the speed guard of the follower with late or lost messages."""

from math import inf, nan

from tests.made.vehicles.fusions import REACTION_OF
from vehicles.driver.controller import GapLimits, SpacingPolicy, VehiclesAhead
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings, Reaction
from vehicles.driver.situation import Situation, SourceFreshness
from vehicles.driver.speed import GapKeeping, ProfileSpeed, SpeedCommand, SpeedLaw, SpeedProfile
from vehicles.driver.speed_guard import GuardedCar
from vehicles.messages import Mode, SourceStatus
from vehicles.schedule import MILLISECOND, SECOND

TICK, PERIOD, LATENCY = 20 * MILLISECOND, 50 * MILLISECOND, 20 * MILLISECOND
LENGTH, LIMITS = 4.93, GapLimits(2.0, 6.0)
POLICY = SpacingPolicy(8.0, 0.5)
SENSED_AFTER = 4
"""Ticks after which a measurement of the gap sensor is available."""
EMERGENCY = DegradationSettings().emergency


class Road:
    """Two cars on a straight; the follower receives some exact, delayed messages.

    `ahead` and `place` (m) are the positions of predecessor and follower, `known` is the newest
    received sample, `least` the smallest gap (m) so far. An exact gap sensor with a latency of
    `SENSED_AFTER` measures if `has_sensor`.
    """

    def __init__(
        self,
        law: SpeedLaw,
        *,
        speed: float = 25.0,
        spacing: float | None = None,
        reaction: Reaction = "degrade",
        friction: float = 0.9,
        policy: SpacingPolicy = POLICY,
        has_sensor: bool = False,
    ) -> None:
        self.spacing = policy.desired(speed) if spacing is None else spacing
        car = GuardedCar(
            least_spacing=LENGTH,
            friction=friction,
            policy=policy,
            limits=LIMITS,
            initial_spacing=self.spacing,
            period=PERIOD / SECOND,
        )
        settings = DegradationSettings(reaction=reaction)
        self.guard = REACTION_OF[reaction].guard(law, settings, car)
        self.law = law
        self.has_sensor = has_sensor
        self.sensed: list[tuple[float, float]] = []
        self.ahead, self.place = self.spacing, 0.0
        self.ahead_speed = self.speed = speed
        self.ahead_acceleration = 0.0
        self.now = 0
        self.in_transit: list[tuple[int, float, float, float]] = []
        self.known: tuple[int, float, float, float] | None = None
        self.yaw_rate = 0.0
        self.lead: SourceStatus = "fresh"
        self.predecessor_lost_at = 0
        self.mode: Mode = "composite"
        self.path = nan
        self.commands: list[float] = []
        self.least = inf

    def tick(self, acceleration: float, *, received: bool, hazard: bool = False) -> SpeedCommand:
        self.ahead_acceleration = acceleration
        if received and self.now % PERIOD < TICK:
            self.in_transit.append((self.now, self.ahead, self.ahead_speed, acceleration))
        while self.in_transit and self.in_transit[0][0] + LATENCY <= self.now:
            self.known = self.in_transit.pop(0)
        pose = Pose(self.place, 0.0, 0.0, self.speed, self.yaw_rate)
        vehicles, situation = self._seen(hazard=hazard)
        command = self.guard.command(self.now, pose, vehicles, situation, self.mode)
        self.commands.append(command.acceleration)
        self._move(command.acceleration)
        return command

    def _seen(self, *, hazard: bool) -> tuple[VehiclesAhead, Situation]:
        situation = Situation(lead=SourceFreshness(status=self.lead), known=self.path)
        if self.known is None:
            situation.predecessor.lost_at = self.predecessor_lost_at
            return VehiclesAhead(), situation
        measured_at, place, speed, acceleration = self.known
        age = (self.now - measured_at) / SECOND
        predecessor = situation.predecessor = SourceFreshness(
            status="fresh", age=age, hazard=hazard, acceleration=acceleration, speed=speed
        )
        driven, speed, acceleration = predecessor.predicted_motion()
        spacing = place + driven - self.place
        ahead = VehiclesAhead(spacing, speed, speed, acceleration, acceleration)
        if self.has_sensor:
            predecessor.status = "lost" if age > 0.5 else "late" if age > 0.2 else "fresh"
            self.sensed.append((self.ahead - self.place - LENGTH, self.ahead_speed - self.speed))
            ticks = min(SENSED_AFTER, len(self.sensed) - 1)
            gap, rate = self.sensed[-1 - ticks]
            ahead.measured_gap_age = ticks * TICK / SECOND
            ahead.measured_gap, ahead.measured_gap_rate = gap + rate * ahead.measured_gap_age, rate
        return ahead, situation

    def _move(self, acceleration: float) -> None:
        span = TICK / SECOND
        after = max(self.speed + acceleration * span, 0.0)
        self.place += 0.5 * (self.speed + after) * span
        self.path -= 0.5 * (self.speed + after) * span
        self.speed = after
        after = max(self.ahead_speed + self.ahead_acceleration * span, 0.0)
        self.ahead += 0.5 * (self.ahead_speed + after) * span
        self.ahead_speed = after
        self.now += TICK
        self.least = min(self.least, self.ahead - self.place - LENGTH)


def keeping() -> GapKeeping:
    return GapKeeping(POLICY, LIMITS)


def profile(speed: float = 25.0) -> ProfileSpeed:
    return ProfileSpeed(SpeedProfile((0.0,), (speed,)), 0, TICK / SECOND)


class RecordingLaw:
    def __init__(self, law: SpeedLaw) -> None:
        self.law = law
        self.commands: list[SpeedCommand] = []

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        self.commands.append(self.law.command(now, pose, ahead))
        return self.commands[-1]
