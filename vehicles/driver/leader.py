"""The lead: it drives its own path, keeps its distance from members of its convoy ahead, and waits.

It waits, if configured, while a follower is lost or has fallen behind.
"""

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from math import inf, remainder, sqrt, tau
from typing import Final

from vehicles.car.dynamics import Actuation, Body, achieved_acceleration
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.ahead import ConvoyAhead
from vehicles.driver.command_limit import CommandLimit, PositionLimit
from vehicles.driver.controller import VehiclesAhead
from vehicles.driver.decision import Decision
from vehicles.driver.own_state import OwnState, Pose
from vehicles.driver.settings import Braking, InstantDraw
from vehicles.driver.situation import STANDSTILL, Situation, SourceState
from vehicles.driver.slip_estimator import LoadWatch
from vehicles.driver.speed import (
    ProfileSpeed,
    SpeedCommand,
    SpeedLaw,
    SpeedProfile,
    profile_correction,
)
from vehicles.driver.steering import LateralController
from vehicles.driver.tracking import TrackingErrors
from vehicles.driver.watch import ConvoyWatch
from vehicles.geometry.sampled_path import SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND, Cadence

WAITING_SHARE: Final = 0.5  # Share of the set speed, so that followers catch up
SLOWEST: Final = 1.0  # Below this speed (m/s) the pace changes as at this speed


class WaitingProfile(ProfileSpeed):
    """Follows a speed profile, slower while the lead `waits` for a follower or is restrained.

    It also keeps a `limit` (m/s). While it is slower, its time passes more slowly, so the lead is
    never faster than the profile at the same position, for example in a bend. Otherwise it equals
    `ProfileSpeed`.
    """

    def __init__(
        self, profile: SpeedProfile, start_at: int, period: float, braking: Braking
    ) -> None:
        """Each command is held for `period` (s); `braking` limits the change of speed."""
        super().__init__(profile, start_at, period)
        self._braking, self._at = braking, start_at
        self._pace, self._change, self._behind, self._planned = 1.0, 0.0, 0.0, 0.0
        self.waits, self.limit = False, inf

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        self._behind += (1.0 - self._pace) * (now - self._at) / SECOND
        self._at = now
        seconds = (now - self._start_at) / SECOND - self._behind
        self._planned = self._profile.at(seconds)[0]
        speed = self._pace * self._planned
        after = seconds + self._pace * self._period
        self._change_pace(self._planned)
        next_speed = self._pace * self._profile.at(after)[0]
        wanted = (next_speed - speed) / self._period
        return SpeedCommand(wanted + profile_correction(speed, pose.speed), next_speed)

    def restrained(self, planned: SpeedCommand, most: float, speed: float) -> SpeedCommand:
        """Replace the `planned` command by the acceleration `most` (m/s²) at `speed` (m/s).

        Afterwards the profile continues from there.
        """
        speed = max(speed, 0.0)
        if speed < self._planned:
            self._pace = speed / self._planned
        self._change = min(max(most, 0.0), self._braking.deceleration)
        return SpeedCommand(most, min(planned.target_speed, speed))

    def _change_pace(self, speed: float) -> None:
        full, braking = max(speed, SLOWEST), self._braking
        target = min(WAITING_SHARE if self.waits else 1.0, self.limit / full)
        left = (target - self._pace) * full
        # The change must be able to end at this jerk when the target is reached.
        fastest = min(braking.deceleration, sqrt(2.0 * braking.jerk * abs(left)))
        change = fastest if left > 0.0 else -fastest
        step = braking.jerk * self._period
        self._change = min(max(change, self._change - step), self._change + step)
        pace = self._pace + self._change * self._period / full
        if abs(left) <= abs(self._change) * self._period:
            pace, self._change = target, 0.0
        self._pace = min(max(pace, 0.0), 1.0)


@dataclass(kw_only=True, eq=False)
class Leader:
    """Tracks a path from the arc length `station` (m) on (Section V-C, Fig. 8).

    `limit` is that of the steering command. `watch` decides whether the lead waits for its
    followers, `ahead` keeps its distance from them, and `position_limit` slows it down while its
    position is uncertain. All three are optional and require a `WaitingProfile` as the speed law.
    `draw` has the random numbers of the controller. The lead repeats the announced stops of its
    `followers`, from front to back. `drive_lag` (s) is the car's.
    """

    own_state: OwnState
    controller: LateralController
    speed_law: SpeedLaw
    control: Cadence
    path: SampledPath
    station: float
    limit: CommandLimit = field(default_factory=CommandLimit)
    load: LoadWatch = field(default_factory=LoadWatch)
    watch: ConvoyWatch | None = None
    ahead: ConvoyAhead | None = None
    position_limit: PositionLimit | None = None
    draw: InstantDraw | None = None
    followers: InitVar[Sequence[str]] = ()
    drive_lag: float = 0.0
    _achieved: float = 0.0
    _decided_at: int = 0
    _held: SourceState | None = None
    _decision: Decision | None = None

    def __post_init__(self, followers: Sequence[str]) -> None:
        self._stops = dict.fromkeys(followers, (-1, 0))  # instants of measurement and stop (ns)

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[ReceivedPose],
        gap: GapMeasurement | None = None,
    ) -> Decision:
        """Decide at `now` (ns); between control instants hold the last decision.

        Errors of Section III-B against the path, steering of Section III-C.
        """
        self.load.observe(now, motion)
        self.own_state.update(now, fix, motion)
        for pose in received:
            name, stops_at = pose.message.vehicle, pose.message.stops_at_ns
            if name in self._stops and pose.measured_at > self._stops[name][0]:
                self._stops[name] = pose.measured_at, stops_at
        if self.watch is not None:
            self.watch.observe(now, received, self.station)
        if self.ahead is not None:
            self.ahead.observe(received)
        if self._decision is not None and not self.control.due(now):
            self._decision = decision = self._decision.held()
            decision.achieved = self._reached(now)
            return decision
        if self.draw is not None:
            self.draw.now = now
        own = self.own_state.at(now)
        self._achieved = self._reached(now) if own.speed > 0.0 else 0.0
        self._decided_at = now
        errors = self._track(own)
        steering = self.limit.limited(self.controller.steer(errors, own.speed))
        self.load.record_command(steering.steering)
        speed, reason = self._speed(now, own, errors.station)
        self._decision = Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode="path",
            reason=reason,
            target_speed=speed.target_speed,
            achieved=self._achieved,
            lateral_deviation=self.own_state.lateral_deviation,
            own_pose=own,
            situation=self._situation(own.speed),
        )
        return self._decision

    def _reached(self, now: int) -> float:
        """Acceleration (m/s²) that the drive has reached at `now` (ns) by the last command."""
        if self._decision is None:
            return 0.0
        span, command = (now - self._decided_at) / SECOND, self._decision.actuation.acceleration
        return achieved_acceleration(self._achieved, command, span, self.drive_lag)

    def _speed(self, now: int, pose: Pose, station: float) -> tuple[SpeedCommand, str]:
        """Planned speed, unless the lead waits or must keep its distance, and the reason."""
        law, watch, ahead = self.speed_law, self.watch, self.ahead
        if not isinstance(law, WaitingProfile):
            return law.command(now, pose, VehiclesAhead()), ""
        reason = ""
        if watch is not None:
            law.waits, reason = watch.waits, watch.reason
        if self.position_limit is not None:
            self.position_limit.observe(self.own_state.lateral_deviation)
            law.limit = self.position_limit.speed
            reason = self.position_limit.joined(reason)
        planned = law.command(now, pose, VehiclesAhead())
        most = inf if ahead is None else ahead.acceleration(now, station, pose.speed)
        if ahead is None or most >= planned.acceleration:
            return planned, reason
        reason = f"{ahead.reason}; {reason}" if reason else ahead.reason
        return law.restrained(planned, most, pose.speed), reason

    def _situation(self, speed: float) -> Situation:
        """Announced stops, and the state of a silent member behind which the lead stands."""
        situation = Situation(relayed_stops=tuple([stop for _, stop in self._stops.values()]))
        silent = self.ahead.silent if self.ahead else None
        if silent is not None and speed < STANDSTILL:
            self._held = silent
        elif speed > SLOWEST:
            self._held = None
        if self._held is not None:
            situation.predecessor, situation.known = self._held, self._held.known
        return situation

    def _track(self, pose: Pose) -> TrackingErrors:
        foot = self.path.project(pose.east, pose.north, self.station)
        # At low control rates the next foot point lies beyond the window of the projection.
        self.station = foot.station + pose.speed / self.control.rate_hz
        heading = remainder(pose.yaw - foot.yaw, tau)
        yaw_rate = pose.yaw_rate - pose.speed * foot.curvature
        return TrackingErrors(
            foot.lateral, heading, yaw_rate, foot.curvature, self.path, foot.station
        )
