"""Repeats, jumps, standstills and pauses of a recorded drive."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from scenarios.definition.traces.drive import DriveTable, Floats, Ints, Mask, runs_of
from vehicles.geometry.bridges import noise_deviation, step_lengths

# ---- Positions that a recorder repeats because it polls faster than the receiver measures


LONGEST_HOLD = 1.5
"""Longest time (s) for which a recorder repeats a position; a longer one is a standstill."""

LEAST_REPEATED, REPEATED_MAX = 1.5, 4
"""Mean number of records of one position from which on a drive consists of repeats, and the
number of records of one position beyond which more do not count."""

FEWEST_RUNS = 4
"""Number of distinct positions from which on a pattern shows."""


def without_repeats(drive: DriveTable) -> DriveTable:
    """Return the distinct points of a drive whose recorder repeats positions.

    Each keeps the time at which it appeared, a standstill also that of its last record.
    """
    starts = np.flatnonzero(np.append(True, np.diff(drive.position).any(axis=0)))
    lengths = np.diff(starts, append=drive.count)
    timed, lasts = bool(drive.times.size), starts + lengths - 1
    held = drive.time_s[lasts] - drive.time_s[starts] if timed else np.zeros(starts.size)
    short = lengths[held <= LONGEST_HOLD]
    if short.size < FEWEST_RUNS or np.minimum(short, REPEATED_MAX).mean() < LEAST_REPEATED:
        return drive
    kept = np.union1d(starts, lasts[held > LONGEST_HOLD])
    remark = f"every position is recorded {np.median(short):.3g} times"
    interval = float(np.median(np.diff(drive.time_s))) if timed else 0.0
    if interval > 0.0:
        rate = 1.0 / interval
        remark = f"positions repeat: {rate / short.mean():.2g} Hz in records of {rate:.3g} Hz"
    ignored = f"{remark}: {drive.count - kept.size} repeats are ignored"
    return drive.selected(kept).with_remarks(ignored)


# ---- Jumps of a receiver: points that no car can reach and leave in their time


LONGEST_JUMP = 10
"""Largest number of points of a jump."""

LEAST_JUMP = 0.5
"""Smallest distance (m) of a jump from the line between its neighbours."""

UNLIKELY = 6.0
"""Standard deviations of noise that a point practically never exceeds."""

ACCELERATION_MAX = 15.0
"""Largest acceleration (m/s²) of a car."""

TIGHTEST = 3.0
"""Smallest radius (m) that a car can turn."""

LONG_STEP = 1.5
"""Usual steps that a jump of points without times exceeds."""

ROUNDS_MAX = 20
"""Number of times that the remaining points are searched."""


class Jump(NamedTuple):
    """Points `first` to `last` (from 0), up to `size` m off the drive."""

    first: int
    last: int
    size: float


def find_jumps(points: Floats, times: Floats) -> tuple[list[Jump], Ints]:
    """Return in order the jumps of points (2, n) with times (s), and the numbers of other points.

    `times` are empty if unknown. Jumps of few points are removed first, and the others are
    searched again.
    """
    left, jumps = np.arange(points.shape[1]), list[Jump]()
    least = max(LEAST_JUMP, UNLIKELY * noise_deviation(points))
    for _ in range(ROUNDS_MAX):
        found = _jumps_in(points[:, left], times[left] if times.size else times, least)
        removed = np.zeros(left.size, dtype=bool)
        for first, last, size in found:
            removed[first : last + 1] = True
            jumps.append(Jump(int(left[first]), int(left[last]), size))
        left = left[~removed]
        if not found:
            break
    return sorted(jumps), left


def _jumps_in(points: Floats, times: Floats, least: float) -> list[Jump]:
    """Return jumps of at least `least` m that do not touch each other, those of few points first.

    Both ends of a jump are off the line between the points around it, which follow their own
    neighbours.
    """
    x, y = points
    steps = step_lengths(points)
    usual = float(np.median(steps)) if steps.size else 0.0

    def off_line(k: Ints, a: Ints, b: Ints) -> tuple[Floats, Mask]:
        """Return the distance (m) of points k from the lines a to b, and whether it is too far."""
        before = np.hypot(x[k] - x[a], y[k] - y[a])
        after = np.hypot(x[b] - x[k], y[b] - y[k])
        share = before / np.maximum(before + after, 1e-9)
        if times.size:
            lasts, since = times[b] - times[a], times[k] - times[a]
            share = np.where(lasts != 0.0, since / np.where(lasts != 0.0, lasts, 1.0), share)
        off = np.hypot(x[a] + share * (x[b] - x[a]) - x[k], y[a] + share * (y[b] - y[a]) - y[k])
        if times.size:
            beyond = np.maximum(1.0, np.maximum(share, 1.0 - share))
            bend = 0.5 * ACCELERATION_MAX * np.abs(since * (lasts - since))
            return off, np.asarray(off > np.maximum(least * beyond, bend))
        bend = np.hypot(x[b] - x[a], y[b] - y[a]) ** 2 / (8.0 * TIGHTEST)
        stepped = np.maximum(before, after) > LONG_STEP * usual
        return off, np.asarray((off > np.maximum(least, bend)) & stepped)

    inner = np.arange(1, x.size - 1)
    odd = inner[off_line(inner, inner - 1, inner + 1)[1]]
    suspects = np.unique(np.concatenate((odd - 1, odd, odd + 1)))
    taken, result = np.zeros(x.size, dtype=bool), list[Jump]()
    for end, inwards in ((0, 1), (x.size - 1, -1)) if times.size > LONGEST_JUMP else ():
        k, a, b, c = (np.array([end + inwards * apart]) for apart in range(4))
        off, is_off = off_line(k, a, b)
        if is_off[0] and not off_line(b, a, c)[1][0]:
            taken[end] = True
            result.append(Jump(end, end, float(off[0])))
    for length in range(1, LONGEST_JUMP + 1):
        k = suspects[(suspects >= 2) & (suspects + length < x.size - 1)]
        k = k[off_line(k, k - 1, k + length)[1]]
        k = k[off_line(k + length - 1, k - 1, k + length)[1]]
        k = k[~off_line(k - 1, k - 2, k + length)[1]]
        k = k[~off_line(k + length, k - 1, k + length + 1)[1]]
        for first in k.tolist():
            around = slice(first - 1, first + length + 1)
            if not taken[around].any():
                taken[around] = True
                inside, ends = np.arange(first, first + length), np.array([first - 1])
                size = float(off_line(inside, ends, ends + length + 1)[0].max())
                result.append(Jump(first, first + length - 1, size))
    return result


# ---- Standstills of a car with a drifting receiver


FEWEST = 8
"""Smallest number of points that is searched; fewer points give no statistics."""

SLOWEST = 0.5
"""Mean speed (m/s) below which a car may be standing."""

LEAST_STAND = 3.0
"""Shortest standstill (s)."""

DRIFTS = (10.0, 20.0)
"""Times (s) over which the drift of a receiver averages out."""

LEAST_RADIUS = 0.5
"""Radius (m) of a standstill, or UNLIKELY times the noise if that is more."""

STILL, DRIFTED = 0.6, 0.9
"""Smallest share of a slow stretch within the radius, as the rest is driven before and after, and
share of a drift that sets the radius."""

WANDERING = 0.5
"""Progress over distance below which a stretch is no slow drive, however far it drifts."""

_RAYLEIGH = 1.1774
"""Median distance of plane normal noise, in its standard deviations."""

CRAWL, MOVING_SHARE = 0.1, 0.99
"""Times of a car that moves have more than 1 % of the steps faster than this (m/s)."""


class Stand(NamedTuple):
    """A standstill of points `first` to `last`.

    `place` is their median (m), `wander` their standard deviation (m, per axis).
    """

    first: int
    last: int
    place: tuple[float, float]
    wander: float


def stands_in(points: Floats, at: Floats) -> list[Stand]:
    """Return the standstills in `points` (2, n) at times `at` (s), in order."""
    noise, gone = noise_deviation(points), np.diff(at)
    usual = float(np.median(gone[gone > 0.0])) if (gone > 0.0).any() else 1.0
    # Noise of one half of a window against the other: 4 noise / (span sqrt(points)).
    span = max(LEAST_STAND, usual * (10.0 * noise / (SLOWEST * usual)) ** (2.0 / 3.0))
    radius = max(LEAST_RADIUS, UNLIKELY * noise)
    free, stands = np.ones(at.size, dtype=bool), list[Stand]()
    # Drift looks like motion in short windows; short standstills vanish in long ones.
    for window in sorted({span, *DRIFTS}, reverse=True):
        slow = _slow(points, at, max(window, span)) & free
        for first, last in runs_of(slow):
            stand = _stand(points, at, first, last, radius, window)
            if stand is not None:
                free[stand.first : stand.last + 1] = False
                stands.append(stand)
    result: list[Stand] = []
    for stand in sorted(stands):
        before = result[-1] if result else stand
        wander = max(before.wander, stand.wander)
        near = math.dist(before.place, stand.place) <= LEAST_RADIUS + UNLIKELY * wander
        if result and near and at[stand.first] - at[before.last] <= DRIFTS[0]:  # is the same
            x, y = np.median(points[:, before.first : stand.last + 1], axis=1).tolist()
            result[-1] = Stand(before.first, stand.last, (x, y), wander)
        else:
            result.append(stand)
    return result


def _slow(points: Floats, at: Floats, span: float) -> Mask:
    """Mark points in a window of `span` s without progress."""
    last = np.searchsorted(at, at + span * (1.0 - 1e-9))
    first = np.flatnonzero(last < at.size)
    last = last[first]
    middle = (first + last + 1) // 2
    sums = np.concatenate((np.zeros((2, 1)), np.cumsum(points, axis=1)), axis=1)
    early = (sums[:, middle] - sums[:, first]) / np.maximum(middle - first, 1)
    late = (sums[:, last + 1] - sums[:, middle]) / np.maximum(last + 1 - middle, 1)
    quiet = np.hypot(*(late - early)) < SLOWEST * 0.5 * span
    marks = np.zeros(at.size + 1, dtype=np.int64)
    np.add.at(marks, first[quiet], 1)
    np.add.at(marks, last[quiet] + 1, -1)
    return np.asarray(np.cumsum(marks)[:-1] > 0)


def _stand(  # noqa: PLR0917 - a run and its limits
    points: Floats, at: Floats, first: int, last: int, radius: float, span: float
) -> Stand | None:
    """Return the standstill in a slow run of points; None for a slow drive.

    If its points drift further than noise in windows of `span` s, it includes all of them.
    """
    core = points[:, first : last + 1]
    away = np.hypot(*(core - np.median(core, axis=1)[:, None]))
    if float(np.quantile(away, STILL)) > radius:
        times = at[first : last + 1]
        ends = core[:, np.searchsorted(times, np.arange(times[0], times[-1], span))]
        progress = math.dist(ends[:, 0], ends[:, -1])
        if progress >= WANDERING * float(step_lengths(ends).sum()):
            return None
        radius = float(np.quantile(away, DRIFTED))
    # The windows include driven points before and after.
    still = np.flatnonzero(away <= radius) + first
    first, last = int(still[0]), int(still[-1])
    if last < first + 2 or at[last] - at[first] < LEAST_STAND - 1e-9:
        return None  # or a pause of the recording, which does not show the noise
    core = points[:, first : last + 1]
    x, y = np.median(core, axis=1).tolist()
    wander = float(np.median(np.hypot(core[0] - x, core[1] - y))) / _RAYLEIGH
    return Stand(first, last, (x, y), wander)


@dataclass(slots=True)
class Cleaned:
    """Numbers of the kept points, their positions (m, shape (2, n)), jumps and standstills.

    A standstill becomes two points at one place; one point before the first movement or after the
    last. `noise` is the standard deviation (m, per axis) of white noise, or of drift at standstill.
    """

    kept: Ints
    points: Floats
    noise: float = 0.0
    jumps: list[Jump] = field(default_factory=list)
    stands: list[Stand] = field(default_factory=list)


def cleaned(points: Floats, times: Floats) -> Cleaned:
    """Remove jumps and standstills from `points` (2, n) with `times` (s), empty if unknown.

    Times in which a car hardly ever moves do not count.
    """
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(np.arange(count), points)
    gone = np.diff(times)
    speeds = step_lengths(points)[gone > 0.0] / gone[gone > 0.0] if gone.size else gone
    if speeds.size and float(np.quantile(speeds, MOVING_SHARE)) < CRAWL:
        times = np.zeros(0)
    jumps, left = find_jumps(points, times)
    places, kept = points.copy(), np.zeros(count, dtype=bool)
    kept[left] = True
    stands = []
    for stand in stands_in(points[:, left], times[left]) if times.size else ():
        first, last = left[[stand.first, stand.last]].tolist()
        starts, stops = stand.first == 0, stand.last == left.size - 1
        ends = [last] if starts else [first] if stops else [first, last]
        kept[first : last + 1] = False
        kept[ends] = True
        places[:, ends] = np.array(stand.place)[:, None]
        stands.append(stand._replace(first=first, last=last))
    noise = max([noise_deviation(points[:, left]), *(stand.wander for stand in stands)])
    return Cleaned(np.flatnonzero(kept), places[:, kept], noise, jumps, stands)


# ---- Pauses: standstills, and gaps in the recording that take no distance


PAUSE = 10.0
"""Shortest time (s) lost in a pause, beyond what its distance takes at the usual speed."""


class Pause(NamedTuple):
    """A pause after point `point` of a drive, which `lost_s` are lost in.

    The step to the next point takes `lasts_s` in the record; the rest is its distance at the usual
    speed of the drive.
    """

    point: int
    lasts_s: float
    lost_s: float


def pauses_in(points: Floats, time_s: Floats) -> tuple[Pause, ...]:
    """Return the pauses between `points` (2, n) at `time_s` (n,), nondecreasing."""
    gone, steps = np.diff(time_s), step_lengths(points)
    moving = (gone > 0.0) & (steps > 0.0) if gone.size else np.zeros(0, bool)
    if not moving.any():
        return ()
    speed = float(np.median(steps[moving] / gone[moving]))
    lost = gone - np.maximum(steps / speed, float(np.median(gone[moving])))
    return tuple(
        Pause(k, float(gone[k]), float(lost[k])) for k in np.flatnonzero(lost >= PAUSE).tolist()
    )
