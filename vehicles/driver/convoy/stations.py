"""The station of a follower on the lead's path, from its poses; SI units."""

from math import cos
from typing import Final

from vehicles.geometry.sampled_path import WINDOW, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

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
