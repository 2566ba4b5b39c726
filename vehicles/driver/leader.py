"""The lead: it drives its own path and, if configured, slows down while a follower is lost."""

from collections.abc import Mapping, Sequence
from math import inf, sqrt
from typing import Final

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.decision import Decision
from vehicles.driver.degradation.settings import Braking, DegradationSettings
from vehicles.driver.degradation.situation import SLOWING
from vehicles.driver.ego.own_state import OwnState, Pose
from vehicles.driver.ego.slip_estimator import LoadWatch
from vehicles.driver.speed import (
    ProfileSpeed,
    SpeedCommand,
    SpeedLaw,
    SpeedProfile,
    VehiclesAhead,
    profile_correction,
)
from vehicles.driver.steering import LateralController
from vehicles.driver.tracking import TrackingErrors
from vehicles.geometry.geodesy import wrap_angle
from vehicles.geometry.sampled_path import SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND, Cadence

WAITING_SHARE: Final = 0.5
"""Share of the set speed while waiting: slow enough for followers to catch up."""

SLOWEST: Final = 1.0
"""Below this speed (m/s) the pace changes as at this speed."""


class ConvoyWatch:
    """Decides whether the lead `waits` for followers that are lost or announce trouble.

    A follower is lost after the silence after which a source is lost, counted from the start. The
    lead waits until no follower has been in trouble for the duration of the probation.
    """

    def __init__(
        self, settings: DegradationSettings, periods: Mapping[str, float], start_at: int
    ) -> None:
        """`periods` (s) between messages are by follower; the run starts at `start_at` (ns)."""
        self._allowed = {
            name: settings.lost_after_silence(period) for name, period in periods.items()
        }
        self._probation = settings.probation
        self._received_at = dict.fromkeys(periods, start_at)
        self._measured_at = dict.fromkeys(periods, -1)
        self._troubled: dict[str, str] = {}
        self._trouble_at: int | None = None
        self.waits = False
        self.reason = ""

    def observe(self, now: int, received: Sequence[ReceivedPose]) -> None:
        for pose in received:
            self._receive(pose)
        troubles = [why for name in self._received_at if (why := self._trouble_of(now, name))]
        if troubles:
            self._trouble_at, self.waits = now, True
            self.reason = f"waiting: {', '.join(troubles)}"
        if self._trouble_at is None or now - self._trouble_at > self._probation * SECOND:
            self.waits, self.reason = False, ""

    def _receive(self, pose: ReceivedPose) -> None:
        message = pose.message
        name = message.vehicle
        if pose.measured_at <= self._measured_at.get(name, inf):
            return  # older than the last one, or not from a follower
        self._received_at[name], self._measured_at[name] = pose.received_at, pose.measured_at
        self._troubled.pop(name, None)
        if message.hazard or message.mode in SLOWING:
            self._troubled[name] = message.mode

    def _trouble_of(self, now: int, name: str) -> str | None:
        silence = (now - self._received_at[name]) / SECOND
        if silence > self._allowed[name]:
            return f"{name} silent for {silence:.1f} s"
        return f"{name} in mode {self._troubled[name]}" if name in self._troubled else None


class WaitingProfile(ProfileSpeed):
    """Follows a speed profile, slower while the lead `waits` for a follower.

    While it waits, its time passes more slowly, so the lead is never faster than the profile at the
    same position, for example in a bend. Otherwise it equals `ProfileSpeed`.
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
        self.waits = False

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:  # noqa: ARG002
        self._behind += (1.0 - self._pace) * (now - self._at) / SECOND
        self._at = now
        seconds = (now - self._start_at) / SECOND - self._behind
        speed = self._pace * self._profile.at(seconds)[0]
        after = seconds + self._pace * self._period
        self._change_pace(self._profile.at(seconds)[0])
        next_speed = self._pace * self._profile.at(after)[0]
        wanted = (next_speed - speed) / self._period
        return SpeedCommand(wanted + profile_correction(speed, pose.speed), next_speed)

    def _change_pace(self, speed: float) -> None:
        target = WAITING_SHARE if self.waits else 1.0
        if self._pace == target and not self._change:
            return
        full, braking = max(speed, SLOWEST), self._braking
        left = (target - self._pace) * full
        # The change must be able to end at this jerk when the target is reached.
        fastest = min(braking.deceleration, sqrt(2.0 * braking.jerk * abs(left)))
        change = fastest if left > 0.0 else -fastest
        step = braking.jerk * self._period
        self._change = min(max(change, self._change - step), self._change + step)
        pace = self._pace + self._change * self._period / full
        if abs(left) <= abs(self._change) * self._period or (target - pace) * left <= 0.0:
            pace, self._change = target, 0.0
        self._pace = min(max(pace, WAITING_SHARE), 1.0)


class Leader:
    """Tracks a path from a given station (m) on (Section V-C, Fig. 8).

    It receives the poses of its followers only if it waits for them.
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
        waiting: tuple[ConvoyWatch, WaitingProfile] | None = None,
    ) -> None:
        """`station` (m) is the initial arc length, `limit` that of the steering command.

        `waiting` are the watch over the followers and the speed law to slow down, if configured.
        """
        self._own_state = own_state
        self._controller = controller
        self._speed_law = speed_law
        self._control = control
        self._path = path
        self._near = station
        self._limit = limit or CommandLimit()
        self._load = load or LoadWatch()
        self._waiting = waiting
        self._reason = ""
        self._decision: Decision | None = None

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[ReceivedPose],
    ) -> Decision:
        """Decide at `now` (ns); between control instants hold the last decision.

        Errors of Section III-B against the path, steering of Section III-C.
        """
        self._load.observe(now, motion)
        self._own_state.update(now, fix, motion)
        if self._waiting is not None:
            watch, law = self._waiting
            watch.observe(now, received)
            self._reason, law.waits = watch.reason, watch.waits
        if self._decision is not None and not self._control.due(now):
            return self._decision.held()
        pose = self._own_state.at(now)
        errors = self._track(pose)
        steering = self._limit.limited(self._controller.steer(errors, pose.speed))
        self._load.record_command(steering.steering)
        speed = self._speed_law.command(now, pose, VehiclesAhead())
        self._decision = Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode="path",
            reason=self._reason,
            target_speed=speed.target_speed,
            lateral_deviation=self._own_state.lateral_deviation,
        )
        return self._decision

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
