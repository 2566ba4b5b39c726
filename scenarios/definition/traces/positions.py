"""Positions of a recorded drive that are none: off the earth, without a fix, or far away."""

import math

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.recorded_drive import (
    METRES_PER_DEGREE,
    NO_FIX,
    Floats,
    RecordedDrive,
    TraceError,
)

FAR = 1000.0
"""Distance (m) between two points from which on they belong to different pieces."""

LARGEST_ZERO = 1e-6
"""Largest latitude and longitude (deg) of a receiver without a fix."""

ABSURD = 1e8
"""Coordinates (m) beyond those of any grid on the earth."""

MOST_FAR = 0.25
"""Largest share of points that is left out as far away; with more the drive has several parts."""

MOST_OPEN = 8
"""Number of tracks that later pieces may continue."""


def usable_positions(drive: RecordedDrive) -> RecordedDrive:
    """Leave out positions off the earth, without a fix, and far from the others, and list them.

    Raises TraceError if none remains.
    """
    usable = _without_far(_without_unfixed(_without_absurd(drive)))
    if not usable.count:
        raise TraceError(", ".join(("no valid point", *usable.left_out.lines(usable.unit)[:1])))
    return usable


def far_pieces(points: Floats, *, geodetic: bool = False) -> list[tuple[int, int]]:
    """Split points (2, n) at steps of at least FAR; return the first and last point of each."""
    if points.shape[1] == 0:
        return []
    steps = _distances(points[:, :-1], points[:, 1:], geodetic=geodetic)
    last = np.flatnonzero(steps >= FAR)
    first = np.concatenate(([0], last + 1))
    return list(zip(first.tolist(), [*last.tolist(), points.shape[1] - 1], strict=True))


def _distances(a: Floats, b: Floats, *, geodetic: bool) -> Floats:
    """Return the distances (m) from points a to b, on a sphere by a local plane at each."""
    first, second = b - a
    if geodetic:
        shrunk = np.cos(np.radians(0.5 * (a[0] + b[0])))
        second = ((second + 180.0) % 360.0 - 180.0) * shrunk
        first, second = METRES_PER_DEGREE * first, METRES_PER_DEGREE * second
    return np.asarray(np.hypot(first, second))


def _without_absurd(drive: RecordedDrive) -> RecordedDrive:
    first, second = drive.position
    if drive.geodetic:
        beyond = (np.abs(first) > 90.0) | (np.abs(second) > 360.0)
        return drive.without(
            beyond,
            "off the earth",
            lambda k: f"off the earth: latitude {first[k]:.9g}, longitude {second[k]:.9g}",
        )
    beyond = np.maximum(np.abs(first), np.abs(second)) > ABSURD
    return drive.without(
        beyond,
        "absurd position",
        lambda k: f"absurd position ({first[k]:.6g} m, {second[k]:.6g} m)",
    )


def _without_unfixed(drive: RecordedDrive) -> RecordedDrive:
    """Leave out whole pieces with a coordinate of 0, far from pieces without.

    A drive across the equator or along an axis of its plane is no such piece, even if wrong
    positions break it into pieces.
    """
    first, second = drive.position
    size = np.abs(drive.position)
    both = np.all(size <= (LARGEST_ZERO if drive.geodetic else 0.0), axis=0)
    zero = both | np.any(size == 0.0, axis=0)
    if zero.sum() > MOST_FAR * drive.count:  # the drive itself runs along an axis
        zero = both
    near_zero = not drive.geodetic and bool((np.hypot(first, second)[~both] < FAR).any())
    if near_zero or not zero.any():  # what is far from the drive is left out later
        return drive
    if both.all() and drive.geodetic:
        unfixed = both
    else:
        unfixed = np.zeros(drive.count, dtype=bool)
        for begin, end in far_pieces(drive.position, geodetic=drive.geodetic):
            piece = slice(begin, end + 1)
            few = end + 1 - begin <= MOST_FAR * drive.count
            unfixed[piece] = both[piece].all() or (few and zero[piece].all())
        if unfixed.all():
            return drive
    unit = "°" if drive.geodetic else " m"

    def reason(k: int) -> str:
        x, y = ("0" if both[k] else f"{value:.9g}" for value in (first[k], second[k]))
        return f"{NO_FIX}: {x}{unit}/{y}{unit}"

    return drive.without(unfixed, NO_FIX, reason)


def _without_far(drive: RecordedDrive) -> RecordedDrive:
    """Leave out tracks with few points that are far from the others, smallest first."""
    pieces = far_pieces(drive.position, geodetic=drive.geodetic)
    if len(pieces) == 1 or drive.count < 3 or 2 * len(pieces) > drive.count + 2:
        return drive
    tracks = _tracks(drive, pieces)
    sizes = np.bincount(tracks, weights=[end + 1 - begin for begin, end in pieces])
    order = np.argsort(sizes, kind="stable")[:-1]
    removed = np.cumsum(sizes[order]) <= max(1.0, MOST_FAR * drive.count)
    lengths = [end + 1 - begin for begin, end in pieces]
    far = np.repeat(np.isin(tracks, order[removed]), lengths)
    kept = np.flatnonzero(~far)
    after = np.searchsorted(kept, np.arange(drive.count))
    around = [kept[np.clip(after + side, 0, kept.size - 1)] for side in (-1, 0)]
    apart = np.min(
        [
            _distances(drive.position[:, near], drive.position, geodetic=drive.geodetic)
            for near in around
        ],
        axis=0,
    )
    return drive.without(
        far, "far away", lambda k: f"{apart[k] / 1000.0:.1f} km from the points around it"
    )


def _tracks(drive: RecordedDrive, pieces: list[tuple[int, int]]) -> NDArray[np.int64]:
    """Return a track number per piece: a piece continues the latest track that ends near it."""
    first, second = drive.position.tolist()

    def is_near(a: int, b: int) -> bool:
        x, y = first[b] - first[a], second[b] - second[a]
        if drive.geodetic:
            x *= METRES_PER_DEGREE
            y = (y + 180.0) % 360.0 - 180.0
            y *= METRES_PER_DEGREE * math.cos(math.radians(0.5 * (first[a] + first[b])))
        return math.hypot(x, y) < FAR

    result: list[int] = []
    open_ends: list[tuple[int, int, int]] = []  # track, its last point, its number of points
    for begin, end in pieces:
        near = (k for k in reversed(range(len(open_ends))) if is_near(open_ends[k][1], begin))
        place = next(near, None)
        track, _, count = (len(result), 0, 0) if place is None else open_ends.pop(place)
        result.append(track)
        open_ends.append((track, end, count + end + 1 - begin))
        if len(open_ends) > MOST_OPEN:
            open_ends.remove(min(open_ends[:-1], key=lambda track: track[2]))
    return np.array(result)
