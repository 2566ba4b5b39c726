"""Followers as the lead receives them, and whether it waits for them; SI units."""

from collections.abc import Sequence
from math import cos
from typing import Final, NamedTuple

from vehicles.car.parameters import VehicleParameters
from vehicles.driver.controller import SpacingPolicy
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import OFF_PATH
from vehicles.geometry.sampled_path import WINDOW, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

ON_PATH: Final = 2.0  # Distance (m) from the path up to which a follower drives along it
MOST_WIDENED: Final = 50.0  # Largest widening (m) of the search for a follower
ALONG: Final = 0.5  # Smallest cosine of the angle between a follower and its path


class ConvoyMember(NamedTuple):
    """A follower: its name and car, the period (s) of its messages, first station (m), spacing."""

    name: str
    car: VehicleParameters
    period: float
    station: float
    policy: SpacingPolicy


class MemberTrack:
    """The `newest` pose of a follower, its station (m) along the lead's path and speed (m/s) there.

    The station is searched where the follower can be since the last such pose, so that another leg
    or lap of the path is not taken for its own. A pose beside or across the path widens the search.
    """

    def __init__(self, member: ConvoyMember, path: SampledPath, start_at: int) -> None:
        """`member` is at its first station at `start_at` (ns)."""
        self.member, self.station, self.speed = member, member.station, 0.0
        self.newest: ReceivedPose | None = None
        self.received_at = self._located_at = start_at
        self._path, self._window = path, WINDOW

    @property
    def has_left(self) -> bool:
        return self.newest is not None and self.newest.message.leaving

    def receive(self, pose: ReceivedPose) -> None:
        """Take a pose unless it is older than the newest one."""
        if self.newest is not None and pose.measured_at <= self.newest.measured_at:
            return
        self.newest, self.received_at = pose, pose.received_at
        span = (pose.measured_at - self._located_at) / SECOND
        if span <= 0.0:
            return
        reach = 0.5 * max(pose.speed, self.speed) * span
        near, window = self.station + reach, self._window + reach
        foot = self._path.project(pose.east, pose.north, near, window)
        if abs(foot.lateral) <= ON_PATH and cos(pose.yaw - foot.yaw) >= ALONG:
            self.station, self.speed, self._located_at = foot.station, pose.speed, pose.measured_at
            self._window = WINDOW
        else:
            self._window = min(self._window + WINDOW, MOST_WIDENED)


FAR_BEHIND: Final = 10.0  # A spacing more than this (m) above twice the desired one is too wide
CAUGHT_UP: Final = 0.5  # A follower has caught up when its excess is below this share of the limit


class ConvoyWatch:
    """Decides whether the lead `waits` for followers that are lost, in trouble or far behind.

    A follower is lost after the silence after which a source is lost, counted from the start. The
    lead waits until no follower has been in trouble for the duration of the probation.
    """

    def __init__(
        self,
        settings: DegradationSettings,
        path: SampledPath,
        members: Sequence[ConvoyMember],
        start_at: int,
    ) -> None:
        """`members` are ordered from front to back at `start_at` (ns)."""
        self._settings = settings
        self._tracks = {one.name: MemberTrack(one, path, start_at) for one in members}
        self._far = set[str]()
        self._trouble_at = 0
        self.waits = False
        self.reason = ""

    def observe(self, now: int, received: Sequence[ReceivedPose], station: float = 0.0) -> None:
        """Take the poses received by `now` (ns); the lead is at `station` (m) of its path."""
        for pose in received:
            if pose.message.vehicle in self._tracks:
                self._tracks[pose.message.vehicle].receive(pose)
        present = [track for track in self._tracks.values() if not track.has_left]
        troubles = [why for track in present if (why := self._trouble_of(now, track))]
        troubles += self._fallen_behind(present, station)
        if troubles:
            self._trouble_at, self.waits = now, True
            self.reason = f"waiting: {', '.join(troubles)}"
        elif self.waits and now - self._trouble_at > self._settings.probation * SECOND:
            self.waits, self.reason = False, ""

    def _trouble_of(self, now: int, track: MemberTrack) -> str | None:
        name, silence = track.member.name, (now - track.received_at) / SECOND
        if silence > self._settings.lost_after_silence(track.member.period):
            return f"{name} silent for {silence:.1f} s"
        message = None if track.newest is None else track.newest.message
        if message is not None and (message.hazard or message.mode in OFF_PATH):
            return f"{name} in mode {message.mode}"
        return None

    def _fallen_behind(self, tracks: Sequence[MemberTrack], station: float) -> list[str]:
        """Text about followers far behind the car ahead, the first one of which is at `station`."""
        was_far, self._far = self._far, set()
        fallen: list[str] = []
        for track in tracks:
            excess = station - track.station - track.member.policy.desired(track.speed)
            limit = track.member.policy.desired(track.speed) + FAR_BEHIND
            station, name = track.station, track.member.name
            if excess > (CAUGHT_UP if name in was_far else 1.0) * limit:
                self._far.add(name)
                fallen.append(f"{name} {excess:.0f} m too far behind")
        return fallen
