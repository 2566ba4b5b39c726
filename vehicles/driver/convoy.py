"""The lead's followers: where they are, whether it waits for them, and its distance on a lap.

SI units. Followers drive the lead's path one after the other. On a closed path the last of them is
ahead of the lead on its next lap, so the lead keeps its distance from it like a follower.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, inf
from typing import Final

import numpy as np

from vehicles.car.parameters import VehicleParameters, least_spacing
from vehicles.driver.controller import GapLimits, SourceState, SpacingPolicy, predicted_motion
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import OFF_PATH
from vehicles.driver.speed import bend_acceleration
from vehicles.geometry.sampled_path import WINDOW, SampledPath
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

ON_PATH: Final = 2.0  # Distance (m) from the path up to which a follower drives along it
ALONG: Final = 0.5  # Smallest cosine of the angle between a follower and its path


@dataclass(kw_only=True, eq=False)
class MemberTrack:
    """A follower, the `newest` pose received of it, and its place on the lead's path.

    `period` (s) is that of its messages, `policy` the spacing that it keeps. `station` (m) and
    `speed` (m/s) are those of its newest pose along the path. The station is searched where the
    follower can be since the last pose along the path, so that another leg or lap of it is not
    taken for its own.
    """

    name: str
    car: VehicleParameters
    period: float
    policy: SpacingPolicy
    path: SampledPath
    station: float  # at the start
    received_at: int  # Instant (ns) of the newest pose, or the start
    speed: float = 0.0
    newest: ReceivedPose | None = None

    def __post_init__(self) -> None:
        self._located_at = self.received_at

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
        near, window = self.station + reach, WINDOW + reach
        foot = self.path.project(pose.east, pose.north, near, window)
        if abs(foot.lateral) <= ON_PATH and cos(pose.yaw - foot.yaw) >= ALONG:
            self.station, self.speed, self._located_at = foot.station, pose.speed, pose.measured_at


# ---- Waiting


FAR_BEHIND: Final = 10.0  # A spacing more than this (m) above twice the desired one is too wide
CAUGHT_UP: Final = 0.5  # Share of that limit at which the lead no longer waits


class ConvoyWatch:
    """Decides whether the lead waits for followers that are lost, in trouble or far behind.

    A follower is lost after the silence after which a source is lost, counted from the start. The
    lead waits until no follower has been in trouble for the duration of the probation.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._settings = settings
        self._trouble_at = 0
        self._reason = ""

    def reason(self, now: int, members: Sequence[MemberTrack], station: float) -> str:
        """Return why the lead waits at `now` (ns) and `station` (m), empty if it does not."""
        troubles, share = list[str](), CAUGHT_UP if self._reason else 1.0
        for track in members:
            message = None if track.newest is None else track.newest.message
            silence = (now - track.received_at) / SECOND
            desired = track.policy.desired(track.speed)
            excess = station - track.station - desired  # behind the vehicle directly ahead
            station = track.station
            if silence > self._settings.lost_after_silence(track.period):
                troubles.append(f"{track.name} silent for {silence:.1f} s")
            elif message is not None and (message.hazard or message.mode in OFF_PATH):
                troubles.append(f"{track.name} in mode {message.mode}")
            elif excess > share * (desired + FAR_BEHIND):
                troubles.append(f"{track.name} {excess:.0f} m too far behind")
        if troubles:
            self._trouble_at, self._reason = now, f"waiting: {', '.join(troubles)}"
        elif now - self._trouble_at > self._settings.probation * SECOND:
            self._reason = ""
        return self._reason


# ---- The last member, ahead on a lap


@dataclass(kw_only=True, eq=False)
class ConvoyAhead:
    """Limits the lead's acceleration behind the last member of its convoy on a `lap` (m).

    `policy` gives the gap between bumpers. The last member moves as announced by its newest pose.
    Silent for longer than the time after which a source is lost, it is assumed to stand where firm
    braking would have ended, until it is received again. The lead may wait for good, because
    nothing else shows where that member stands.

    `reason` is that of the last limit, `silent` the state of the member if it is silent.
    """

    lap: float
    car: VehicleParameters
    settings: DegradationSettings
    policy: SpacingPolicy
    limits: GapLimits
    reason: str = ""
    silent: SourceState | None = None

    def acceleration(
        self, now: int, members: Sequence[MemberTrack], station: float, speed: float
    ) -> float:
        """Largest acceleration (m/s²) at `station` (m) and `speed` (m/s), infinite if free.

        `members` are ordered from front to back. The speed of approach is that of constant braking
        up to the desired gap, as before a bend.
        """
        self.reason, self.silent = "", None
        if not members:
            return inf
        last, limits = members[-1], self.limits
        silence = (now - last.received_at) / SECOND
        lost = self.settings.lost_after_silence(last.period)
        driven, its_speed = self._motion(now, last, lost)
        gap = last.station + driven + self.lap - station - least_spacing(last.car, self.car)
        error = gap - self.policy.desired(speed)
        squared = its_speed * its_speed + 2.0 * limits.before_bends * error
        most = bend_acceleration(speed, squared, max(error, 0.0), limits)
        if most >= limits.acceleration:
            return inf
        where, since = last.name, ""
        if silence > lost:
            where, since = f"where {last.name} may stand", f", silent for {silence:.1f} s"
            self.silent = SourceState("lost", silence, silence, known=max(gap, 0.0))
        self.reason = f"keeps distance from {where}, {gap:.1f} m ahead{since}"
        return most

    def _motion(self, now: int, last: MemberTrack, lost: float) -> tuple[float, float]:
        """Distance (m) driven since the newest pose, less its uncertainty, and speed (m/s)."""
        pose = last.newest
        if pose is None:
            return 0.0, 0.0
        age, message, lag = (now - pose.measured_at) / SECOND, pose.message, last.car.drive_lag
        achieved, command = message.achieved_acceleration_mps2, message.acceleration_mps2
        speed, span = max(pose.speed, 0.0), min(age, lost)
        driven, speed, _ = predicted_motion(speed, achieved, command, span, lag)
        if age > lost:
            driven, speed = driven + 0.5 * speed * speed / self.settings.firm_deceleration, 0.0
        return driven - pose.accuracy, speed


# ---- Loops of a path


SIDE_MARGIN: Final = 0.3  # Distance (m) that must be free between two bodies side by side
STEP: Final = 1.0  # Distance (m) between the points of a path that are compared
SHORTEST: Final = 5  # Steps between two points that are not the same place


def shortest_loop(
    path: SampledPath, lead: VehicleParameters, last: VehicleParameters, end: float, most: float
) -> float:
    """Length (m) of the shortest loop of a path up to `end` (m), infinite above `most` (m).

    It leads along the path from one point to another at which the `lead` and the `last` car of its
    convoy would touch, and straight back. On a closed path it is the lap.
    """
    stations = np.arange(float(path.station[0]), end, STEP)
    east = np.interp(stations, path.station, path.east)
    north = np.interp(stations, path.station, path.north)
    width = 0.5 * (lead.width + last.width) + SIDE_MARGIN
    for steps in range(SHORTEST, min(len(stations), int(most / STEP) + 1)):
        apart = np.hypot(east[steps:] - east[:-steps], north[steps:] - north[:-steps])
        if apart.min() <= width:
            return steps * STEP + float(apart.min())
    return inf
