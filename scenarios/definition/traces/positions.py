"""Positions of a recorded drive that are none: off the earth, without a fix, or far away."""

import numpy as np

from scenarios.definition.traces.drive import (
    METRES_PER_DEGREE,
    NO_FIX,
    DriveTable,
    TraceError,
)
from vehicles.geometry.bridges import step_lengths

FAR = 1000.0
"""Distance (m) between two points from which on they belong to different pieces."""

LARGEST_ZERO = 1e-6
"""Largest latitude and longitude (deg) of a receiver without a fix."""

ABSURD = 1e8
"""Coordinates (m) beyond those of any grid on the earth."""

FAR_SHARE_MAX = 0.25
"""Largest share of points that is left out as far away; with more the drive has several parts."""


def usable_positions(drive: DriveTable) -> DriveTable:
    """Leave out positions off the earth, without a fix, and far from the others, and list them.

    Raises TraceError if none remains.
    """
    drive = _without_far(_without_unfixed(_without_absurd(drive)))
    if not drive.count:
        raise TraceError(", ".join(("no valid point", *drive.left_out.lines(drive.unit)[:1])))
    return drive


def _without_absurd(drive: DriveTable) -> DriveTable:
    first, second = drive.position
    limits = (90.0, 360.0) if drive.geodetic else (ABSURD, ABSURD)
    beyond = np.any(limits < np.abs(drive.position).T, axis=1)
    kind = "off the earth" if drive.geodetic else "absurd position"
    return drive.without(beyond, kind, lambda k: f"{kind}: {first[k]:.9g}, {second[k]:.9g}")


def _without_unfixed(drive: DriveTable) -> DriveTable:
    """Leave out positions of zeros, unless the drive passes there."""
    zero = np.all(np.abs(drive.position) <= (LARGEST_ZERO if drive.geodetic else 0.0), axis=0)
    near = FAR / METRES_PER_DEGREE if drive.geodetic else FAR
    passes = bool((np.hypot(*drive.position[:, ~zero]) < near).any())
    if passes or not zero.any() or (zero.all() and not drive.geodetic):
        return drive
    unit = "°" if drive.geodetic else " m"
    return drive.without(zero, NO_FIX, lambda _: f"{NO_FIX}: 0{unit}/0{unit}")


def _without_far(drive: DriveTable) -> DriveTable:
    """Leave out pieces, split at steps of at least FAR, off the longest and what continues it."""
    points = drive.plane_m
    last = np.flatnonzero(step_lengths(points) >= FAR)
    if not last.size:
        return drive
    pieces = np.split(np.arange(drive.count), last + 1)
    longest = max(range(len(pieces)), key=lambda k: pieces[k].size)
    far, apart = np.ones(drive.count, dtype=bool), np.zeros(drive.count)
    for way, side in ((pieces[longest:], 0), (pieces[longest::-1], -1)):
        end = way[0][side]
        for piece in way:
            near = np.hypot(*(points[:, piece[side]] - points[:, end]))
            apart[piece] = near
            if near < FAR:
                far[piece] = False
                end = piece[-1 - side]
    if far.sum() > FAR_SHARE_MAX * drive.count:
        return drive
    reason = "{:.1f} km from the points around it"
    return drive.without(far, "far away", lambda k: reason.format(apart[k] / 1000.0))
