"""Positions of a recorded drive that are none: off the earth, without a fix, or far away."""

import numpy as np

from scenarios.definition.traces.drive import (
    METRES_PER_DEGREE,
    NO_FIX,
    DriveTable,
    Floats,
    Mask,
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
    drive = _without_unfixed(_without_absurd(drive))
    pieces = far_pieces(drive.plane_m)
    far = _far_from_longest(drive.plane_m, pieces)
    if 0 < far.sum() <= FAR_SHARE_MAX * drive.count:
        kept = np.flatnonzero(~far)
        after = np.searchsorted(kept, np.arange(drive.count))
        points = drive.plane_m
        near = [points[:, kept[np.clip(after + k, 0, kept.size - 1)]] - points for k in (-1, 0)]
        apart = np.min(np.hypot(*np.moveaxis(np.array(near), 0, 1)), axis=0)
        reason = "{:.1f} km from the points around it"
        drive = drive.without(far, "far away", lambda k: reason.format(apart[k] / 1000.0))
    if not drive.count:
        raise TraceError(", ".join(("no valid point", *drive.left_out.lines(drive.unit)[:1])))
    return drive


def far_pieces(points: Floats) -> list[tuple[int, int]]:
    """Split points (2, n) at steps of at least FAR; return the first and last point of each."""
    last = np.flatnonzero(step_lengths(points) >= FAR).tolist()
    if not points.shape[1]:
        return []
    return list(zip([0, *(k + 1 for k in last)], [*last, points.shape[1] - 1], strict=True))


def _far_from_longest(points: Floats, pieces: list[tuple[int, int]]) -> Mask:
    """Mark the points off the longest piece and those pieces that continue it within FAR."""
    far = np.ones(points.shape[1], dtype=bool)
    longest = max(range(len(pieces)), key=lambda k: pieces[k][1] - pieces[k][0], default=0)
    for way in (pieces[longest:], [piece[::-1] for piece in pieces[longest::-1]]):
        end = way[0][0] if way else 0
        for first, last in way:
            if np.hypot(*(points[:, first] - points[:, end])) < FAR:
                far[min(first, last) : max(first, last) + 1] = False
                end = last
    return far


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
