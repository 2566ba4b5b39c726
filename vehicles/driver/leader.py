"""The lead: it drives its own path, keeps its distance from members of its convoy ahead, and waits.

It waits, if configured, while a follower is lost or has fallen behind.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Final

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.command_limit import CommandLimit, PositionLimit
from vehicles.driver.controller import VehiclesAhead
from vehicles.driver.convoy import ConvoyAhead, ConvoyWatch, MemberTrack
from vehicles.driver.decision import Decision
from vehicles.driver.own_state import Pose
from vehicles.driver.pose_estimator import OwnState
from vehicles.driver.settings import Braking
from vehicles.driver.situation import Situation
from vehicles.driver.slip_estimator import LoadWatch
from vehicles.driver.speed import (
    ProfileSpeed,
    SpeedCommand,
    SpeedLaw,
    SpeedProfile,
    profile_correction,
)
from vehicles.driver.steering import LateralController
from vehicles.driver.tracking import TrackingErrors, errors_at
from vehicles.geometry.sampled_path import SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND, Cadence

APPROACH: Final = 0.25  # Acceleration per difference of speed (1/s), within comfortable jerk
WAITING_SHARE: Final = 0.5  # Share of the set speed, so that followers catch up
SLOWEST: Final = 1.0  # Speed (m/s) below which the lead stands; least speed for its pace


class WaitingProfile(ProfileSpeed):
    """Follows a speed profile, slower while the lead `waits` for a follower or is restrained.

    It also keeps a `limit` (m/s). While it is slower, its time passes more slowly, at the same
    pace, so the lead is never faster than the profile at the same position, for example in a bend.
    """

    def __init__(
        self, profile: SpeedProfile, start_at: int, period: float, braking: Braking
    ) -> None:
        """Each command is held for `period` (s); `braking` limits the change of speed."""
        super().__init__(profile, start_at, period)
        self._braking, self._at = braking, start_at
        self._pace, self._change, self._planned = 1.0, 0.0, 0.0
        self.waits, self.limit = False, inf

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:
        self._start_at += round((1.0 - self._pace) * (now - self._at))
        self._at, seconds = now, (now - self._start_at) / SECOND
        after = seconds + self._pace * self._period
        self._planned = self._profile.at(seconds)[0]
        speed = self._pace * self._planned
        self._change_pace(max(self._planned, SLOWEST))
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

    def _change_pace(self, full: float) -> None:
        """Approach the wanted share of the `full` speed (m/s) comfortably."""
        target = min(WAITING_SHARE if self.waits else 1.0, self.limit / full)
        most, step = self._braking.deceleration, self._braking.jerk * self._period
        wanted = min(max(APPROACH * (target - self._pace) * full, -most), most)
        self._change = min(max(wanted, self._change - step), self._change + step)
        self._pace = min(max(self._pace + self._change * self._period / full, 0.0), 1.0)


@dataclass(kw_only=True, eq=False)
class Leader:
    """Tracks a path from the arc length `station` (m) on (Section V-C, Fig. 8).

    `limit` is that of the steering command. `watch` decides whether the lead waits for the
    `members` of its convoy, ordered from front to back, `ahead` keeps its distance from the last
    one, and `position_limit` slows it down while its position is uncertain. All three are optional
    and require a `WaitingProfile` as the speed law. The lead repeats the announced stops of its
    first members, `relays` in number. `drive_lag` (s) is the car's.
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
    members: Sequence[MemberTrack] = ()
    relays: int = 0
    drive_lag: float = 0.0
    _decision: Decision | None = None

    def __post_init__(self) -> None:
        self._tracks = {track.name: track for track in self.members}

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
            if pose.message.vehicle in self._tracks:
                self._tracks[pose.message.vehicle].receive(pose)
        if self._decision is not None and not self.control.due(now):
            self._decision = self._decision.held(now, self.drive_lag)
            return self._decision
        own = self.own_state.at(now)
        last, achieved = self._decision, 0.0
        if last is not None and own.speed > 0.0:
            achieved = last.achieved_at(now, self.drive_lag)
        errors = self._track(own)
        steering = self.limit.limited(self.controller.steer(errors, own.speed))
        self.load.record_command(steering.steering)
        speed, reason = self._speed(now, own, errors.station)
        self._decision = Decision(
            at=now,
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode="path",
            reason=reason,
            target_speed=speed.target_speed,
            achieved=achieved,
            lateral_deviation=self.own_state.lateral_deviation,
            own_pose=own,
            situation=self._situation(own.speed),
        )
        return self._decision

    def _speed(self, now: int, pose: Pose, station: float) -> tuple[SpeedCommand, str]:
        """Planned speed, unless the lead waits or must keep its distance, and the reason."""
        law, watch, ahead = self.speed_law, self.watch, self.ahead
        if not isinstance(law, WaitingProfile):
            return law.command(now, pose, VehiclesAhead()), ""
        present, reason = [track for track in self.members if not track.has_left], ""
        if watch is not None:
            reason = watch.reason(now, present, station)
            law.waits = bool(reason)
        if self.position_limit is not None:
            self.position_limit.observe(self.own_state.lateral_deviation)
            law.limit = self.position_limit.speed
            reason = "; ".join(filter(None, [reason, self.position_limit.reason]))
        planned = law.command(now, pose, VehiclesAhead())
        most = inf if ahead is None else ahead.acceleration(now, present, station, pose.speed)
        if ahead is None or most >= planned.acceleration:
            return planned, reason
        reason = "; ".join(filter(None, [ahead.reason, reason]))
        return law.restrained(planned, most, pose.speed), reason

    def _situation(self, speed: float) -> Situation:
        """Announced stops, and the state of a silent member behind which the lead stands."""
        newest = [track.newest for track in self.members[: self.relays]]
        stops = tuple([pose.message.stops_at_ns if pose else 0 for pose in newest])
        situation = Situation(relayed_stops=stops)
        if self.ahead is not None and self.ahead.silent is not None and speed < SLOWEST:
            situation.predecessor, situation.known = self.ahead.silent, self.ahead.silent.known
        return situation

    def _track(self, pose: Pose) -> TrackingErrors:
        foot = self.path.project(pose.east, pose.north, self.station)
        # At low control rates the next foot point lies beyond the window of the projection.
        self.station = foot.station + pose.speed / self.control.rate_hz
        return errors_at(foot, self.path, pose)
