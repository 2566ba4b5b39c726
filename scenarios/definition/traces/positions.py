"""Positions of a recorded drive that are none: off the earth, without a fix, or far away."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.recorded_drive import (
    METRES_PER_DEGREE,
    NO_FIX,
    Floats,
    RecordedDrive,
    TraceError,
)
from vehicles.geometry.bridges import step_lengths

# ---- Drawn lines: points without times, far apart, that are vertices and not noisy positions


FAR_APART = 20.0
"""Median distance (m) of points without times from which they are the vertices of a drawn line."""

SPACING = 2.0
"""Distance (m) of the points between vertices."""

FEWEST_VERTICES = 3


def are_vertices(points: Floats) -> bool:
    """Whether `points` (2, n) without times are those of a drawn line."""
    if points.shape[1] < FEWEST_VERTICES:
        return False
    return float(np.median(step_lengths(points))) >= FAR_APART


def between_vertices(points: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return points (2, m) on a smooth line through `points` (2, n), and the vertex before each.

    Cubics (Hermite) join the vertices; the tangent at each is that of the parabola through it and
    its neighbours by chord length (Catmull and Rom, 1974). On a circle of radius R with vertices d
    apart they are off by d⁴ / (384 R³).
    """
    steps = np.maximum(step_lengths(points), 1e-9)
    slopes = np.diff(points) / steps
    inner = (slopes[:, :-1] * steps[1:] + slopes[:, 1:] * steps[:-1]) / (steps[:-1] + steps[1:])
    first, last = 2.0 * slopes[:, :1] - inner[:, :1], 2.0 * slopes[:, -1:] - inner[:, -1:]
    tangents = np.concatenate((first, inner, last), axis=1)
    counts = np.maximum(np.ceil(steps / SPACING), 1.0).astype(np.int64)
    before = np.repeat(np.arange(steps.size), counts)
    u = (np.arange(before.size) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[before]
    left, right = points[:, before], points[:, before + 1]
    rest, length = 1.0 - u, steps[before]
    towards = u * u * (3.0 - 2.0 * u)
    leaving, joining = length * u * rest * rest, -length * u * u * rest
    line = left + towards * (right - left)
    line = line + leaving * tangents[:, before] + joining * tangents[:, before + 1]
    return np.concatenate((line, points[:, -1:]), axis=1), np.append(before, steps.size)


# ---- Positions


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


# ---- Positions that a recorder repeats because it polls faster than the receiver measures


LONGEST_HOLD = 1.5
"""Longest time (s) for which a recorder repeats a position; a longer one is a standstill."""

LEAST_REPEATED = 1.5
"""Mean number of records of one position from which on a drive consists of repeats."""

FEWEST_RUNS = 4
"""Number of distinct positions from which on a pattern shows."""

STANDSTILL_HOLDS = 3
"""Number of usual holds above which a position is a standstill, with a start and an end."""

SHORTEST_STANDSTILL = 1.0
"""Shortest standstill (s)."""

MOST_SINGLE_QUANTA = 0.8
"""Share of changes by the resolution of the file above which its numbers are rounded motion."""


def without_repeats(drive: RecordedDrive) -> tuple[RecordedDrive, float]:
    """Return the distinct points of a drive whose recorder repeats positions.

    Each keeps the time at which it appeared, a standstill also that of its last record. The second
    value is the uncertainty (s) of these times: the interval of the records, 0 for a drive without
    repeats, which is returned as it is.
    """
    steps = np.diff(drive.position)
    changes = np.concatenate(([True], (steps != 0.0).any(axis=0)))
    starts = np.flatnonzero(changes)
    lengths = np.diff(np.concatenate((starts, [drive.count])))
    if len(starts) < FEWEST_RUNS or len(starts) == drive.count:
        return drive, 0.0
    timed = bool(np.isfinite(drive.time_s).all())
    lasts = starts + lengths - 1
    held = drive.time_s[lasts] - drive.time_s[starts] if timed else np.zeros(len(starts))
    short = lengths[held <= LONGEST_HOLD]
    if not _repeats(short) or _is_rounded(steps):
        return drive, 0.0
    interval = float(np.median(np.diff(drive.time_s))) if timed else 0.0
    usual = float(np.median(short))
    stands = lengths > STANDSTILL_HOLDS * usual
    if timed:
        stands &= held >= SHORTEST_STANDSTILL
    kept = np.sort(np.concatenate((starts, lasts[stands])))
    count = drive.count - len(kept)
    remark = f"every position is recorded {usual:.3g} times: {count} repeats are ignored"
    if interval > 0.0:
        rate = 1.0 / interval
        remark = (
            f"positions repeat: {rate / float(short.mean()):.2g} Hz in records of {rate:.3g} Hz, "
            f"{count} repeats are ignored"
        )
    return drive.selected(kept).with_remarks(remark), interval


def _repeats(lengths: NDArray[np.int64]) -> bool:
    """Whether most positions are repeated, and not a few of them at length."""
    if len(lengths) < FEWEST_RUNS:
        return False
    limited = np.minimum(lengths, 2.0 * float(np.median(lengths)) + 1.0)
    return bool(limited.mean() >= LEAST_REPEATED)


def _is_rounded(steps: Floats) -> bool:
    """Whether almost every change is one unit of the last digit: slow motion in coarse numbers.

    Such motion changes one axis at a time. Steady motion also has changes of one size, on both axes
    together or along one of them.
    """
    sizes = np.abs(steps)
    present = sizes > 0.0
    together = present.all(axis=0).sum() > MOST_SINGLE_QUANTA * present.any(axis=0).sum()
    if together or not present.any(axis=1).all():
        return False
    units = [
        float(row[some].min()) if some.any() else np.inf
        for row, some in zip(sizes, present, strict=True)
    ]
    largest = (sizes / np.array(units)[:, None]).max(axis=0)
    changed = largest[largest > 0.0]
    return float((changed < 1.5).mean()) > MOST_SINGLE_QUANTA


# ---- Pauses of a recorded drive: standstills, and gaps in the recording that take no distance


PAUSE = 10.0
"""Shortest time (s) lost in a pause, beyond what its distance takes at the usual speed."""

PauseRule = Literal["keep", "cut"]
"""Whether the lead waits where the recorded car did not move on."""


@dataclass(frozen=True, slots=True)
class Pause:
    """A pause after point `point` of a drive, which `lost_s` are lost in.

    The step to the next point takes `lasts_s` in the record; the rest is its distance at the usual
    speed of the drive.
    """

    point: int
    lasts_s: float
    lost_s: float


def pauses_in(points: Floats, time_s: Floats) -> tuple[Pause, ...]:
    """Return the pauses between `points` (2, n) at `time_s` (n,), nondecreasing."""
    if time_s.size < 2:
        return ()
    gone, steps = np.diff(time_s), step_lengths(points)
    moving = (gone > 0.0) & (steps > 0.0)
    if not moving.any():
        return ()
    speed = float(np.median(steps[moving] / gone[moving]))
    usual = float(np.median(gone[moving]))
    lost = gone - np.maximum(steps / speed, usual)
    return tuple(
        Pause(k, float(gone[k]), float(lost[k])) for k in np.flatnonzero(lost >= PAUSE).tolist()
    )


def without_pauses(time_s: Floats, pauses: tuple[Pause, ...]) -> Floats:
    """Return the times (s) of a drive whose pauses lose no time."""
    lost = np.zeros(time_s.size)
    for pause in pauses:
        lost[pause.point + 1] = pause.lost_s
    return np.asarray(time_s - np.cumsum(lost))
