"""The lead's path, for a follower that receives the vehicle ahead alone.

A vehicle that follows the path driven by its predecessor repeats its errors and adds its own: the
error grows along the convoy, although each self-estimate is small (Section V-D.1). So each follower
announces the offset of its place from the lead's path, and a follower that receives it alone moves
that place back to the path.

The announced offset is measured from the samples of the lead themselves, or from corrected samples,
not from the curve fitted to them: a curve that rounds off bends would do so again for each vehicle.
And it is that of the fix that is sent, so that the fix's own error is corrected, too. A corrected
place lies on the line between two of the lead's path, so no vehicle passes on an error, neither of
its law nor of its receiver, and the noise of the lead's places does not grow: between two of
variance s², it is at most s².
"""

from array import array
from bisect import bisect_left
from math import cos, hypot, nan, sin
from typing import Final

import numpy as np

from vehicles.car.gnss import Fix
from vehicles.messages import Mode
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import LEAD, PREDECESSOR, Fit
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

MAX_OFFSET: Final = 1.75
"""Offsets beyond this (m), half of a lane, count as none."""
MAX_OFFSET_SLOPE: Final = 0.2
"""Change of an offset (m) for each metre driven, at most: a car askew by 11 degrees."""
DEVIATIONS: Final = 7.0
"""Further change, in standard deviations of a fix: 5 of the difference of two."""
SPACING: Final = 0.2
"""A source that has moved less than this (m) adds nothing, as to its trace."""
CAPACITY: Final = 4096
DROPPED_AT_ONCE: Final = 1024
"""Number of offsets that are kept at most, and that are forgotten at once."""


class IntendedPath:
    """Offsets from the lead's path of the places of a source.

    Held by instant (ns): east and north (m), yaw (rad) and offset (m, left positive).
    """

    def __init__(self) -> None:
        self._instants = array("q")
        self._numbers = array("d")

    def add(self, pose: ReceivedPose, offset: float) -> None:
        """Note the announced `offset` (m, left positive) of a pose from the path.

        An unknown or impossible offset counts as 0. From one pose to the next it changes no faster
        than a car can move sideways.
        """
        instants, numbers = self._instants, self._numbers
        place = bisect_left(instants, pose.measured_at)
        if not abs(offset) <= MAX_OFFSET:  # NaN neither
            offset = 0.0
        if place < len(instants) and instants[place] == pose.measured_at:
            return
        if place:
            east, north, _, before = numbers[4 * place - 4 : 4 * place]
            moved = hypot(pose.east - east, pose.north - north)
            if moved < SPACING:
                return
            most = MAX_OFFSET_SLOPE * moved + DEVIATIONS * abs(pose.accuracy)
            offset = min(max(offset, before - most), before + most)
        instants.insert(place, pose.measured_at)
        numbers[4 * place : 4 * place] = array("d", (pose.east, pose.north, pose.yaw, offset))
        if len(instants) > CAPACITY:
            del instants[:DROPPED_AT_ONCE]
            del numbers[: 4 * DROPPED_AT_ONCE]

    def corrected(self, window: Window, instants: list[int], share: float) -> Window:
        """Samples (preview data, Section III-A) of these `instants` (ns), moved to the path.

        By the `share` of their offsets, which are interpolated between the announced ones.
        """
        announced = self._instants
        if not announced or not instants:
            return window
        low = max(bisect_left(announced, min(instants)) - 1, 0)
        high = bisect_left(announced, max(instants) + 1) + 1
        since = announced[low]
        at = [(instant - since) / SECOND for instant in announced[low:high]]
        wanted = [(instant - since) / SECOND for instant in instants]
        yaws = self._numbers[4 * low + 2 : 4 * high : 4]
        offsets = self._numbers[4 * low + 3 : 4 * high : 4]
        beside = list(zip(offsets, yaws, strict=True))
        east = np.interp(wanted, at, [offset * sin(yaw) for offset, yaw in beside])
        north = np.interp(wanted, at, [-offset * cos(yaw) for offset, yaw in beside])
        return window._replace(east=window.east + share * east, north=window.north + share * north)


class IntendedShare:
    """Share of the offsets that counts (0 to 1): all once the predecessor alone is followed.

    It changes over `span` (s), so that the path does not jump when the mode changes, and stays 0
    unless it is `wanted`.
    """

    def __init__(self, span: float, *, wanted: bool) -> None:
        self.value = 0.0
        self._span = span
        self._wanted = wanted

    def advance(self, mode: Mode, span: float) -> None:
        """Steer along `mode` for `span` (s); while no source is followed the share stays."""
        if mode == "predecessor" and self._wanted:
            self.value = min(self.value + span / self._span, 1.0)
        elif self.value and mode in ("composite", "lead"):
            self.value = max(self.value - span / self._span, 0.0)


def path_offset(fit: Fit, fix: Fix) -> float:
    """Offset (m, left positive) of a fix from the lead's samples, or else from the predecessor's.

    Its e_lat of Section III-B against the trajectory, less that of the samples beside it, linearly
    between the sample behind and the one ahead. NaN without both.
    """
    source, project = fit.source.tolist(), fit.spline.project
    chosen = LEAD if LEAD in source else PREDECESSOR
    east_of, north_of = fit.east.item, fit.north.item  # few lie behind the fix
    forward, left = cos(fix.yaw), sin(fix.yaw)
    behind: tuple[float, float] | None = None
    for place, sample_source in enumerate(source):
        if sample_source == chosen:
            east, north = east_of(place), north_of(place)
            if (east - fix.east) * forward + (north - fix.north) * left > 0.0:
                ahead = east, north
                break
            behind = east, north
    else:
        return nan
    if behind is None:
        return nan
    own = project(fix.east, fix.north)
    one, other = project(*behind), project(*ahead)
    length = other.station - one.station
    between = min(max((own.station - one.station) / length, 0.0), 1.0) if length > 0.0 else 0.5
    return own.lateral - (one.lateral + between * (other.lateral - one.lateral))
