"""Whether the lead waits for its followers, and how far they have fallen behind; SI units."""

from collections.abc import Iterable, Mapping, Sequence
from math import cos, inf
from typing import Final

from vehicles.driver.controller import SpacingPolicy
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import OFF_PATH
from vehicles.geometry.sampled_path import WINDOW, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- The station of a follower on the lead's path, from its poses; SI units


ON_PATH: Final = 2.0  # Distance (m) from the path up to which a follower drives along it
MOST_WIDENED: Final = 50.0  # Largest widening (m) of the search for a follower
ALONG: Final = 0.5  # Smallest cosine of the angle between a follower and its path


class MemberTrack:
    """Station (m) and speed (m/s) of a follower in its newest pose along the path.

    It is searched where the follower can be since the last such pose, so that another leg or lap of
    the path is not taken for its own. A pose beside or across the path widens the search.
    """

    def __init__(self, path: SampledPath, station: float, at: int) -> None:
        """Begin at `station` (m) at the instant `at` (ns)."""
        self._path = path
        self.station = station
        self.measured_at = at
        self.speed = 0.0
        self._window = WINDOW

    def move(self, pose: ReceivedPose) -> None:
        if pose.measured_at <= self.measured_at:
            return
        driven = max(pose.speed, self.speed) * (pose.measured_at - self.measured_at) / SECOND
        near, window = self.station + 0.5 * driven, self._window + 0.5 * driven
        foot = self._path.project(pose.east, pose.north, near, window)
        if abs(foot.lateral) <= ON_PATH and cos(pose.yaw - foot.yaw) >= ALONG:
            self.station, self.speed, self.measured_at = foot.station, pose.speed, pose.measured_at
            self._window = WINDOW
        else:
            self._window = min(self._window + WINDOW, MOST_WIDENED)


# ---- Watch


FAR_BEHIND: Final = 10.0  # A spacing more than this (m) above twice the desired one is too wide
CAUGHT_UP: Final = 0.5  # A follower has caught up when its excess is below this share of the limit


class ConvoyBehind:
    """Finds followers whose spacing has grown far beyond the desired one."""

    def __init__(
        self,
        path: SampledPath,
        followers: Iterable[tuple[str, SpacingPolicy, float]],
        start_at: int,
    ) -> None:
        """`followers` are names, policies and stations (m) at `start_at` (ns), front to back."""
        self._followers = {
            name: (policy, MemberTrack(path, station, start_at))
            for name, policy, station in followers
        }
        self._far = set[str]()

    def observe(self, received: Sequence[ReceivedPose], station: float) -> list[str]:
        """Text about followers that have fallen behind the lead, which is at `station` (m)."""
        for pose in received:
            follower = self._followers.get(pose.message.vehicle)
            if follower is not None:
                follower[1].move(pose)
        was_far, self._far = self._far, set()
        fallen: list[str] = []
        for name, (policy, track) in self._followers.items():
            spacing, station = station - track.station, track.station
            desired = policy.desired(track.speed)
            limit = desired + FAR_BEHIND
            if spacing - desired > (CAUGHT_UP if name in was_far else 1.0) * limit:
                self._far.add(name)
                fallen.append(f"{name} {spacing - desired:.0f} m too far behind")
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
