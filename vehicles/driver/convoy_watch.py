"""Whether the lead waits for its followers, and how far they have fallen behind; SI units."""

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Final

from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import OFF_PATH
from vehicles.driver.speed import SpacingPolicy
from vehicles.geometry.sampled_path import WINDOW, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

FAR_BEHIND: Final = 10.0
"""A spacing more than this (m) above twice the desired one counts as fallen behind."""

CAUGHT_UP: Final = 0.5
"""A follower has caught up when its excess is below this share of the limit."""


class _TrailingFollower:
    """Station (m) on the lead's path and speed (m/s) of a follower in its newest pose."""

    def __init__(self, name: str, policy: SpacingPolicy, station: float, at: int) -> None:
        self.name = name
        self.policy = policy
        self.station = station
        self.measured_at = at
        self.speed = 0.0
        self.is_far = False

    def move(self, pose: ReceivedPose, path: SampledPath) -> None:
        """Project a pose near the last station, further away after a silence."""
        driven = max(pose.speed, self.speed) * (pose.measured_at - self.measured_at) / SECOND
        near, window = self.station + 0.5 * driven, WINDOW + 0.5 * driven
        self.station = path.project(pose.east, pose.north, near, window).station
        self.speed, self.measured_at = pose.speed, pose.measured_at


class ConvoyBehind:
    """Finds followers whose spacing has grown far beyond the desired one."""

    def __init__(
        self,
        path: SampledPath,
        followers: Iterable[tuple[str, SpacingPolicy, float]],
        start_at: int,
    ) -> None:
        """`followers` are names, policies and stations (m) at `start_at` (ns), front to back."""
        self._path = path
        self._followers = {
            name: _TrailingFollower(name, policy, station, start_at)
            for name, policy, station in followers
        }

    def observe(self, received: Sequence[ReceivedPose], station: float) -> list[str]:
        """Text about followers that have fallen behind the lead, which is at `station` (m)."""
        for pose in received:
            follower = self._followers.get(pose.message.vehicle)
            if follower is not None and pose.measured_at > follower.measured_at:
                follower.move(pose, self._path)
        fallen: list[str] = []
        for follower in self._followers.values():
            spacing, station = station - follower.station, follower.station
            desired = follower.policy.desired(follower.speed)
            limit = desired + FAR_BEHIND
            follower.is_far = spacing - desired > (CAUGHT_UP if follower.is_far else 1.0) * limit
            if follower.is_far:
                fallen.append(f"{follower.name} {spacing - desired:.0f} m too far behind")
        return fallen


class ConvoyWatch:
    """Decides whether the lead `waits` for followers that are lost, in trouble or far behind.

    A follower is lost after the silence after which a source is lost, counted from the start. The
    lead waits until no follower has been in trouble for the duration of the probation.
    """

    def __init__(
        self,
        settings: DegradationSettings,
        periods: Mapping[str, float],
        start_at: int,
        behind: ConvoyBehind | None = None,
    ) -> None:
        """`periods` (s) between messages are by follower; the run starts at `start_at` (ns).

        `behind` finds followers that have fallen behind, if given.
        """
        self._behind = behind
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

    def observe(self, now: int, received: Sequence[ReceivedPose], station: float = 0.0) -> None:
        """Take the poses received by `now` (ns); the lead is at `station` (m) of its path."""
        for pose in received:
            self._receive(pose)
        troubles = [why for name in self._received_at if (why := self._trouble_of(now, name))]
        if self._behind is not None:
            troubles += self._behind.observe(received, station)
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
        if message.hazard or message.mode in OFF_PATH:
            self._troubled[name] = message.mode

    def _trouble_of(self, now: int, name: str) -> str | None:
        silence = (now - self._received_at[name]) / SECOND
        if silence > self._allowed[name]:
            return f"{name} silent for {silence:.1f} s"
        return f"{name} in mode {self._troubled[name]}" if name in self._troubled else None
