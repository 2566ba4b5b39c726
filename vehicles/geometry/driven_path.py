"""True cross-track error: how far a vehicle drove beside the path that the lead drove."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, hypot, sin
from typing import NamedTuple

from vehicles.messages import TruePose

MAX_STEP_BACK = 3
"""Segments the foot point may move backwards in one step; it otherwise only moves forwards, so a
path that crosses itself or runs beside itself never attracts it."""

Piece = tuple[float, float, float, float, float]
"""A segment of a path: where it starts, its way east and north, its length (m)."""


@dataclass(frozen=True, slots=True)
class DrivenPath:
    """A driven path as a polyline in the world frame, in order of travel.

    Standstills are left out, and a straight `run_in` (m) is put before the first pose, because
    followers start behind the lead, on the straight that leads to it.
    """

    east: list[float]
    north: list[float]
    station: list[float]

    @classmethod
    def of(
        cls, poses: Sequence[TruePose], run_in: float, road_yaw: float | None = None
    ) -> "DrivenPath":
        """Path through `poses`; at least one is needed.

        The convoy starts on a road in direction `road_yaw` (rad), which is not where a lead faces
        that starts askew. Without it, or with a lead that was on its way when it was first seen,
        the run-in goes in the direction that the first pose faced.
        """
        first = poses[0]
        at_start = first.distance_m == 0.0
        yaw = road_yaw if road_yaw is not None and at_start else first.yaw_rad
        east = [first.east_m - run_in * cos(yaw), first.east_m]
        north = [first.north_m - run_in * sin(yaw), first.north_m]
        station = [-run_in, 0.0]
        for pose in poses[1:]:
            step = hypot(pose.east_m - east[-1], pose.north_m - north[-1])
            if step > 0.01:
                east.append(pose.east_m)
                north.append(pose.north_m)
                station.append(station[-1] + step)
        return cls(east, north, station)

    def pieces(self) -> list[Piece]:
        """The segments in order of travel."""
        corners = pairwise(zip(self.east, self.north, self.station, strict=True))
        return [
            (east, north, next_east - east, next_north - north, next_station - station)
            for (east, north, station), (next_east, next_north, next_station) in corners
        ]


class CrossTrack(NamedTuple):
    """One foot point: its arc length on the lead's path and the distance, left positive (m)."""

    at_ns: int
    station: float
    lateral: float


def cross_track(poses: Sequence[TruePose], path: DrivenPath) -> list[CrossTrack]:
    """Project `poses` one after the other onto `path`, following the order of travel.

    Poses before the path's first point or past its last one are left out: nothing was driven
    there to compare with.
    """
    pieces, stations = path.pieces(), path.station
    start, end = stations[0], stations[-1]
    index = 0
    found: list[CrossTrack] = []
    for pose in poses:
        index, along, lateral = _follow(pieces, index, pose.east_m, pose.north_m)
        station = stations[index] + along
        if start <= station <= end:
            found.append(CrossTrack(pose.true_at_ns, station, lateral))
    return found


def _follow(
    pieces: Sequence[Piece], index: int, east: float, north: float
) -> tuple[int, float, float]:
    """Segment that holds the foot point, and the foot's distance along it and to its left (m).

    It is searched from segment `index` in the order of travel, then back. This runs for every
    pose of a run, so a segment is looked at once only.
    """
    last = len(pieces) - 1
    floor = max(index - MAX_STEP_BACK, 0)
    forwards = True
    while True:
        from_east, from_north, along_east, along_north, length = pieces[index]
        to_east, to_north = east - from_east, north - from_north
        along = (to_east * along_east + to_north * along_north) / length
        if forwards and along > length and index < last:
            index += 1
        elif along < 0.0 and index > floor:
            index -= 1
            forwards = False
        else:
            return index, along, (along_east * to_north - along_north * to_east) / length
