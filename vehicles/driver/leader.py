"""The lead: it drives its own path, keeps its distance from members of its convoy ahead, and waits.

It waits, if configured, while a follower is lost or has fallen behind.
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import Final

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.ahead import ConvoyAhead
from vehicles.driver.command_limit import CommandLimit, PositionLimit
from vehicles.driver.controller import VehiclesAhead
from vehicles.driver.decision import Decision
from vehicles.driver.own_state import OwnState, Pose
from vehicles.driver.settings import Braking, InstantDraw
from vehicles.driver.situation import STANDSTILL, Situation
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
from vehicles.geometry.geodesy import wrap_angle
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
        self._braking = braking
        self._pace = 1.0
        self._change = 0.0
        self._behind = 0.0
        self._at = start_at
        self._planned = 0.0
        self.waits = False
        self.limit = inf

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
        target = WAITING_SHARE if self.waits else 1.0
        full, braking = max(speed, SLOWEST), self._braking
        if self.limit < target * full:
            target = self.limit / full
        if self._pace == target and not self._change:
            return
        left = (target - self._pace) * full
        # The change must be able to end at this jerk when the target is reached.
        fastest = min(braking.deceleration, sqrt(2.0 * braking.jerk * abs(left)))
        change = fastest if left > 0.0 else -fastest
        step = braking.jerk * self._period
        self._change = min(max(change, self._change - step), self._change + step)
        pace = self._pace + self._change * self._period / full
        if abs(left) <= abs(self._change) * self._period or (target - pace) * left <= 0.0:
            pace, self._change = target, 0.0
        self._pace = min(max(pace, 0.0), 1.0)


class Leader:
    """Tracks a path from a given station (m) on (Section V-C, Fig. 8).

    It receives the poses of its followers if it waits for them or keeps its distance from them.
    """

    def __init__(
        self,
        *,
        own_state: OwnState,
        controller: LateralController,
        speed_law: SpeedLaw,
        control: Cadence,
        path: SampledPath,
        station: float,
        limit: CommandLimit | None = None,
        load: LoadWatch | None = None,
        watch: ConvoyWatch | None = None,
        ahead: ConvoyAhead | None = None,
        position_limit: PositionLimit | None = None,
        draw: InstantDraw | None = None,
        followers: Sequence[str] = (),
    ) -> None:
        """`station` (m) is the initial arc length, `limit` that of the steering command.

        `watch` decides whether it waits for its followers, `ahead` keeps its distance from them,
        and `position_limit` slows it down while its position is uncertain. All three are optional
        and require a `WaitingProfile` as the speed law. `draw` has the random numbers of the
        controller.
        """
        self._own_state = own_state
        self._controller = controller
        self._speed_law = speed_law
        self._control = control
        self._path = path
        self._near = station
        self._limit = limit or CommandLimit()
        self._load = load or LoadWatch()
        self._watch = watch
        self._ahead = ahead
        self._position_limit = position_limit
        self._draw = draw
        self._stops: dict[str, tuple[int, int]] = dict.fromkeys(followers, (-1, 0))
        self._waiting = speed_law if isinstance(speed_law, WaitingProfile) else None
        self._held: Situation | None = None
        self._decision: Decision | None = None

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
        self._load.observe(now, motion)
        self._own_state.update(now, fix, motion)
        if self._watch is not None:
            self._watch.observe(now, received, self._near)
        if self._ahead is not None:
            self._ahead.observe(received)
        for pose in received:
            known = self._stops.get(pose.message.vehicle)
            if known is not None and pose.measured_at > known[0]:
                self._stops[pose.message.vehicle] = pose.measured_at, pose.message.stops_at_ns
        if self._decision is not None and not self._control.due(now):
            self._decision = self._decision.held()
            return self._decision
        if self._draw is not None:
            self._draw.now = now
        pose = self._own_state.at(now)
        errors = self._track(pose)
        steering = self._limit.limited(self._controller.steer(errors, pose.speed))
        self._load.record_command(steering.steering)
        speed, reason = self._speed(now, pose, errors.station)
        self._decision = Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode="path",
            reason=reason,
            target_speed=speed.target_speed,
            lateral_deviation=self._own_state.lateral_deviation,
            own_pose=pose,
            situation=self._situation(pose.speed) or Situation(),
        )
        self._decision.situation.relayed_stops = tuple([at for _, at in self._stops.values()])
        return self._decision

    def _speed(self, now: int, pose: Pose, station: float) -> tuple[SpeedCommand, str]:
        """Planned speed, unless the lead waits or must keep its distance, and the reason."""
        law, watch, ahead = self._waiting, self._watch, self._ahead
        if law is None:
            return self._speed_law.command(now, pose, VehiclesAhead()), ""
        reason = ""
        if watch is not None:
            law.waits, reason = watch.waits, watch.reason
        if self._position_limit is not None:
            self._position_limit.observe(self._own_state.lateral_deviation)
            law.limit = self._position_limit.speed
            reason = self._position_limit.joined(reason)
        planned = law.command(now, pose, VehiclesAhead())
        if ahead is None:
            return planned, reason
        last = self._decision.actuation.acceleration if self._decision else 0.0
        most = ahead.acceleration(now, station, pose.speed, last)
        if most >= planned.acceleration:
            return planned, reason
        reason = f"{ahead.reason}; {reason}" if reason else ahead.reason
        return law.restrained(planned, most, pose.speed), reason

    def _situation(self, speed: float) -> Situation | None:
        """State of a silent member of the convoy behind which the lead stands, until it drives."""
        silent = self._ahead.silent if self._ahead else None
        if silent is not None and speed < STANDSTILL:
            self._held = Situation(predecessor=silent, known=silent.known)
        elif speed > SLOWEST:
            self._held = None
        return self._held

    def _track(self, pose: Pose) -> TrackingErrors:
        foot = self._path.project(pose.east, pose.north, self._near)
        # At low control rates the next foot point lies beyond the window of the projection.
        self._near = foot.station + pose.speed / self._control.rate_hz
        return TrackingErrors(
            lateral=foot.lateral,
            heading=wrap_angle(pose.yaw - foot.yaw),
            yaw_rate=pose.yaw_rate - pose.speed * foot.curvature,
            curvature=foot.curvature,
            path=self._path,
            station=foot.station,
        )
