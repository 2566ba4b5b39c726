"""The lead's path, reconstructed from the positions of the predecessor.

A vehicle that follows the path driven by its predecessor repeats its errors and adds its own, so
errors grow along the convoy although self-estimates are small (Section V-D.1). With composite data
each vehicle passes on half of its error, which doubles errors in the end. Therefore each follower
announces its offset from the lead's path, and the next one moves the predecessor's positions by it.

The offset is measured from the lead's samples (or from corrected samples), not from the curve
fitted to them: a curve that rounds off bends would do so again for each vehicle. It is the offset
of the fix that is sent, so it also corrects the error of that fix. A corrected position lies
between two positions of the lead, so no vehicle passes on an error of its control or receiver, and
the variance of the lead's noise does not grow.
"""

from bisect import bisect_left
from math import cos, hypot, nan, sin
from typing import Final

import numpy as np

from vehicles.car.gnss import Fix
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import LEAD, Fit
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

MAX_OFFSET: Final = 1.75  # Half a lane (m); the error of the fix adds
MAX_FIX_ERROR: Final = 3.0
MAX_ADDED: Final = 3.5  # Largest error of a fix, in its standard deviations as stated, and in m
MAX_OFFSET_SLOPE: Final = 0.2  # Offset per metre driven: a heading error of 11 degrees
DEVIATIONS: Final = 7.0  # Further change, in deviations: 5 of the difference of two fixes
SPACING: Final = 0.2  # Least distance (m) between stored offsets, as between samples
CAPACITY, DROPPED_AT_ONCE = 4096, 1024  # Offsets stored at most, and oldest dropped at once


class IntendedPath:
    """Announced offsets of a source from the lead's path.

    Stored by instant (ns): east and north (m), yaw (rad) and offset (m, left positive).
    """

    def __init__(self) -> None:
        self._instants: list[int] = []
        self._numbers: list[tuple[float, float, float, float]] = []

    def add(self, pose: ReceivedPose, offset: float) -> None:
        """Store the announced `offset` (m, left positive) of a pose from the path.

        An unknown or impossible offset counts as 0. The change from the previous pose is limited to
        what a car can do.
        """
        instants, numbers = self._instants, self._numbers
        index = bisect_left(instants, pose.measured_at)
        if not abs(offset) <= _largest_offset(pose):  # also NaN
            offset = 0.0
        if index < len(instants) and instants[index] == pose.measured_at:
            return
        if index:
            east, north, _, before = numbers[index - 1]
            moved = hypot(pose.east - east, pose.north - north)
            if moved < SPACING:
                return
            most = MAX_OFFSET_SLOPE * moved + DEVIATIONS * abs(pose.accuracy)
            offset = min(max(offset, before - most), before + most)
        instants.insert(index, pose.measured_at)
        numbers.insert(index, (pose.east, pose.north, pose.yaw, offset))
        if len(instants) > CAPACITY:
            del instants[:DROPPED_AT_ONCE], numbers[:DROPPED_AT_ONCE]

    def corrected(self, window: Window, instants: list[int]) -> Window:
        """Move samples (preview data, Section III-A) of these `instants` (ns) to the lead's path.

        Each moves by its offset, interpolated between the announced ones.
        """
        announced = self._instants
        if not announced or not instants:
            return window
        low = max(bisect_left(announced, min(instants)) - 1, 0)
        high = bisect_left(announced, max(instants) + 1) + 1
        since, rows = announced[low], self._numbers[low:high]
        at = [(instant - since) / SECOND for instant in announced[low:high]]
        sampled_at = [(instant - since) / SECOND for instant in instants]
        east = np.interp(sampled_at, at, [offset * sin(yaw) for *_, yaw, offset in rows])
        north = np.interp(sampled_at, at, [-offset * cos(yaw) for *_, yaw, offset in rows])
        return window._replace(east=window.east + east, north=window.north + north)


def _largest_offset(pose: ReceivedPose) -> float:
    return MAX_OFFSET + min(MAX_FIX_ERROR * abs(pose.accuracy), MAX_ADDED)


def is_beside(pose: ReceivedPose) -> bool:
    """Whether a car announces that it is too far from the lead's path to reconstruct it."""
    return abs(pose.message.path_offset_m) > _largest_offset(pose)


def path_offset(fit: Fit, fix: Fix) -> float:
    """Offset (m, left positive) of a fix from the lead's samples, or else the foremost source's.

    e_lat of Section III-B of the fix minus that of the samples, interpolated linearly between the
    sample behind and the one ahead. NaN unless both exist.
    """
    source, project = fit.source.tolist(), fit.spline.project
    chosen = LEAD if LEAD in source else max(source)
    east_of, north_of = fit.east.item, fit.north.item  # few lie behind the fix
    forward, left = cos(fix.yaw), sin(fix.yaw)
    behind: tuple[float, float] | None = None
    for index, sample_source in enumerate(source):
        if sample_source == chosen:
            east, north = east_of(index), north_of(index)
            if (east - fix.east) * forward + (north - fix.north) * left > 0.0:
                ahead = east, north
                break
            behind = east, north
    else:
        return nan
    if behind is None:
        return nan
    own = project(fix.east, fix.north)
    start, end = project(*behind), project(*ahead)
    length = end.station - start.station
    between = min(max((own.station - start.station) / length, 0.0), 1.0) if length > 0.0 else 0.5
    return own.lateral - (start.lateral + between * (end.lateral - start.lateral))
