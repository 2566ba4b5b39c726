"""True cross-track error: how far a vehicle drove beside the path that the lead drove."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, sin

from vehicles.messages import TruePose

MAX_STEP_BACK = 3
"""Segments the foot point may move backwards in one step; it otherwise only moves forwards, so a
path that crosses itself or runs beside itself never attracts it."""


@dataclass(frozen=True, slots=True)
class DrivenPath:
    """A driven path as a polyline in the world frame, in order of travel.

    Standstills are left out, and a straight `run_in` (m) is put before the first pose in the
    direction it faced, because followers start behind the lead, on its straight lead-in.
    """

    east: list[float]
    north: list[float]
    station: list[float]

    @classmethod
    def of(cls, poses: Sequence[TruePose], run_in: float) -> "DrivenPath":
        """Path through `poses`; at least one is needed."""
        first = poses[0]
        east = [first.east_m - run_in * cos(first.yaw_rad), first.east_m]
        north = [first.north_m - run_in * sin(first.yaw_rad), first.north_m]
        station = [-run_in, 0.0]
        for pose in poses[1:]:
            step = hypot(pose.east_m - east[-1], pose.north_m - north[-1])
            if step > 0.01:
                east.append(pose.east_m)
                north.append(pose.north_m)
                station.append(station[-1] + step)
        return cls(east, north, station)


@dataclass(frozen=True, slots=True)
class CrossTrack:
    """One foot point: its arc length on the lead's path and the distance, left positive (m)."""

    at_ns: int
    station: float
    lateral: float


def cross_track(poses: Sequence[TruePose], path: DrivenPath) -> list[CrossTrack]:
    """Project `poses` one after the other onto `path`, following the order of travel.

    Poses before the path's first point or past its last one are left out: nothing was driven
    there to compare with.
    """
    index = 0
    found: list[CrossTrack] = []
    for pose in poses:
        index = _follow(path, index, pose.east_m, pose.north_m)
        along, lateral = _foot(path, index, pose.east_m, pose.north_m)
        station = path.station[index] + along
        if path.station[0] <= station <= path.station[-1]:
            found.append(CrossTrack(pose.true_at_ns, station, lateral))
    return found


def _follow(path: DrivenPath, index: int, east: float, north: float) -> int:
    """Segment that holds the foot point, searched from segment `index` in the order of travel."""
    last = len(path.station) - 2
    floor = max(index - MAX_STEP_BACK, 0)
    while index < last and _foot(path, index, east, north)[0] > _length(path, index):
        index += 1
    while index > floor and _foot(path, index, east, north)[0] < 0.0:
        index -= 1
    return index


def _length(path: DrivenPath, index: int) -> float:
    return path.station[index + 1] - path.station[index]


def _foot(path: DrivenPath, index: int, east: float, north: float) -> tuple[float, float]:
    """Distance along segment `index` and to the left of it, m."""
    along_east = path.east[index + 1] - path.east[index]
    along_north = path.north[index + 1] - path.north[index]
    to_east, to_north = east - path.east[index], north - path.north[index]
    length = _length(path, index)
    along = (to_east * along_east + to_north * along_north) / length
    return along, (along_east * to_north - along_north * to_east) / length
