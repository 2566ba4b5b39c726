"""A lead that listens to its followers, and slows down while one of them is lost; SI units."""

from collections.abc import Mapping, Sequence
from math import inf, sqrt
from typing import Final

from vehicles.driver.degradation.settings import Braking, DegradationSettings
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.speed import (
    ProfileSpeed,
    SpeedCommand,
    SpeedProfile,
    VehiclesAhead,
    profile_correction,
)
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND

WAITING_SHARE: Final = 0.5
"""Share of its set speed at which a lead waits: slow enough to be caught up with on any road where
the convoy drives on, and no standstill that nobody needs."""

SLOWEST: Final = 1.0
"""Below this speed (m/s) the pace changes no faster than it would here."""


class ConvoyWatch:
    """Which followers are lost, or say that they degrade.

    One that is silent for longer than a source may be is lost, counted from the start on; it is
    found again when nothing was wrong for the probation.
    """

    def __init__(
        self, settings: DegradationSettings, periods: Mapping[str, float], start_at: int
    ) -> None:
        """`periods` (s) between the messages of each follower; the run starts at `start_at`."""
        self._allowed = {
            name: settings.lost_after_silence(period) for name, period in periods.items()
        }
        self._probation = settings.probation
        self._heard_at = dict.fromkeys(periods, start_at)
        self._measured_at = dict.fromkeys(periods, -1)
        self._announced = dict.fromkeys(periods, "")
        self._wrong_at: int | None = None
        self._why = ""

    def observe(self, now: int, received: Sequence[GpsPose]) -> str:
        """Take what was heard by `now` (ns); says for whom to wait and why, or nothing."""
        for message in received:
            self._hear(now, message)
        wrong = [why for name in self._heard_at if (why := self._wrong(now, name))]
        if wrong:
            self._wrong_at, self._why = now, f"waits for {', '.join(wrong)}"
        if self._wrong_at is None or now - self._wrong_at > self._probation * SECOND:
            self._why = ""
        return self._why

    def _hear(self, now: int, message: GpsPose) -> None:
        name = message.vehicle
        if message.measured_at_ns <= self._measured_at.get(name, inf):
            return  # an older one that was overtaken, or somebody else's
        self._heard_at[name], self._measured_at[name] = now, message.measured_at_ns
        degrades = message.hazard or message.mode in ("coast", "stop")
        self._announced[name] = message.mode if degrades else ""

    def _wrong(self, now: int, name: str) -> str:
        silence = (now - self._heard_at[name]) / SECOND
        if silence > self._allowed[name]:
            return f"{name}, unheard for {silence:.1f} s"
        return f"{name}, in {self._announced[name]}" if self._announced[name] else ""


class WaitingProfile(ProfileSpeed):
    """Drives a speed profile, slower while there is somebody to wait for.

    Its time then passes more slowly, so the lead is everywhere at most as fast as the profile is
    there, in bends too. As long as nobody is waited for it is `ProfileSpeed` to the bit.
    """

    def __init__(
        self, profile: SpeedProfile, start_at: int, period: float, braking: Braking
    ) -> None:
        """Hold each command for `period` (s); slow down and speed up as `braking` brakes."""
        super().__init__(profile, start_at, period)
        self._braking = braking
        self._pace = 1.0
        self._change = 0.0
        self._behind = 0.0
        self._at = start_at
        self.waits = False

    def command(self, now: int, pose: Pose, ahead: VehiclesAhead) -> SpeedCommand:  # noqa: ARG002
        """Mean acceleration over the coming period, plus a mild correction, as Section V-C.3."""
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
        """Move the pace on by a period: towards its aim at the deceleration and jerk asked for."""
        aim = WAITING_SHARE if self.waits else 1.0
        if self._pace == aim and not self._change:
            return
        full, braking = max(speed, SLOWEST), self._braking
        left = (aim - self._pace) * full
        # No faster than can be ended at this jerk when the aim is reached.
        fastest = min(braking.deceleration, sqrt(2.0 * braking.jerk * abs(left)))
        wanted = fastest if left > 0.0 else -fastest
        step = braking.jerk * self._period
        self._change = min(max(wanted, self._change - step), self._change + step)
        pace = self._pace + self._change * self._period / full
        if abs(left) <= abs(self._change) * self._period or (aim - pace) * left <= 0.0:
            pace, self._change = aim, 0.0
        self._pace = min(max(pace, WAITING_SHARE), 1.0)
