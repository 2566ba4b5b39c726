"""Repeats, jumps, standstills and pauses of a recorded drive."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scenarios.definition.traces.drive import DriveTable, Floats, Ints, Mask
from scenarios.definition.traces.time_order import runs_of
from vehicles.geometry.bridges import NEARBY, noise_deviation, step_lengths

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


def without_repeats(drive: DriveTable) -> tuple[DriveTable, float]:
    """Return the distinct points of a drive whose recorder repeats positions.

    Each keeps the time at which it appeared, a standstill also that of its last record. The second
    value is the uncertainty (s) of these times: the interval of the records, 0 for a drive without
    repeats, which is returned as it is.
    """
    steps = np.diff(drive.position)
    starts = np.flatnonzero(np.append(True, steps.any(axis=0)))
    lengths = np.diff(starts, append=drive.count)
    if starts.size < FEWEST_RUNS or starts.size == drive.count:
        return drive, 0.0
    timed, lasts = bool(drive.times.size), starts + lengths - 1
    held = drive.time_s[lasts] - drive.time_s[starts] if timed else np.zeros(starts.size)
    short = lengths[held <= LONGEST_HOLD]
    usual = float(np.median(short)) if short.size else 0.0
    limited = np.minimum(short, 2.0 * usual + 1.0)
    if short.size < FEWEST_RUNS or limited.mean() < LEAST_REPEATED:
        return drive, 0.0
    stands = (lengths > STANDSTILL_HOLDS * usual) & (not timed or held >= SHORTEST_STANDSTILL)
    kept = np.union1d(starts, lasts[stands])
    count = drive.count - kept.size
    interval = float(np.median(np.diff(drive.time_s))) if timed else 0.0
    remark = f"every position is recorded {usual:.3g} times"
    if interval > 0.0:
        rate = 1.0 / interval
        remark = f"positions repeat: {rate / short.mean():.2g} Hz in records of {rate:.3g} Hz"
    return drive.selected(kept).with_remarks(f"{remark}: {count} repeats are ignored"), interval


# ---- Jumps of a receiver: points that no car can reach and leave in their time


LONGEST_JUMP = 10
"""Largest number of points of a jump."""

LEAST_JUMP = 0.5
"""Smallest distance (m) of a jump from its interpolated position."""

UNLIKELY = 6.0
"""Standard deviations of noise that a point practically never exceeds."""

ACCELERATION_MAX = 15.0
"""Largest acceleration (m/s²) of a car."""

TIGHTEST = 3.0
"""Smallest radius (m) that a car can turn."""

LONG_STEP = 1.5
"""Steps nearby that a jump of points without times exceeds."""

SUSPECTS_MAX = 0.35
"""Largest share of points next to a jump; with more they are noise, and the limit rises."""

ROUNDS_MAX = 20
"""Number of times that the remaining points are searched."""


class Jump(NamedTuple):
    """Points `first` to `last` (from 0), up to `size` m off the drive."""

    first: int
    last: int
    size: float


def find_jumps(points: Floats, times: Floats, time_error_s: float = 0.0) -> tuple[list[Jump], Ints]:
    """Return in order the jumps of points (2, n) with times (s), and the numbers of other points.

    `times` are empty if unknown, and late by 0 to `time_error_s`. Jumps of few points are removed
    first, and the others are searched again.
    """
    at = times if times.size else np.arange(points.shape[1], dtype=np.float64)
    left, jumps = np.arange(points.shape[1]), list[Jump]()
    for _ in range(ROUNDS_MAX):
        track = _Track(points[:, left], at[left], time_error_s, timed=times.size > 0)
        found = track.jumps()
        removed = np.zeros(left.size, dtype=bool)
        for first, last, size in found:
            removed[first : last + 1] = True
            jumps.append(Jump(int(left[first]), int(left[last]), size))
        left = left[~removed]
        if not found:
            break
    return sorted(jumps), left


class _Track:
    """Points (2, n) at times (s), or numbers, and the limits of their distances from each other.

    Times are late by 0 to `time_error_s`. `usual` is the median step (m) near each point without
    times.
    """

    def __init__(self, points: Floats, at: Floats, time_error_s: float, *, timed: bool) -> None:
        self.count, self.timed, self.at = at.size, timed, at
        self.x, self.y = points
        self.late = time_error_s if timed else 0.0
        self.least = max(LEAST_JUMP, UNLIKELY * noise_deviation(points))
        steps = np.zeros(0) if timed else np.pad(step_lengths(points), NEARBY, constant_values=nan)
        windows = sliding_window_view(steps, 2 * NEARBY) if not timed else np.zeros((0, 1))
        blocks = [windows[k : k + 50_000] for k in range(0, len(windows), 50_000)]
        self.usual = np.concatenate([np.zeros(0), *(np.nanmedian(b, axis=1) for b in blocks)])

    def jumps(self) -> list[Jump]:
        """Return jumps that do not touch each other, those of few points first."""
        taken = np.zeros(self.count, dtype=bool)
        suspects = self._suspects()
        result = self._jumps_at_ends() if self.count > LONGEST_JUMP else []
        taken[[jump.first for jump in result]] = True
        for length in range(1, LONGEST_JUMP + 1):
            k = suspects[(suspects >= 2) & (suspects + length < self.count - 1)]
            k = k[self._excess(k, k - 1, k + length) > 0.0]
            k = k[self._excess(k + length - 1, k - 1, k + length) > 0.0]
            k = k[self._excess(k - 1, k - 2, k + length) <= 0.0]
            k = k[self._excess(k + length, k - 1, k + length + 1) <= 0.0]
            for first in k.tolist():
                around = slice(first - 1, first + length + 1)
                if not taken[around].any():
                    taken[around] = True
                    inside, ends = np.arange(first, first + length), np.array([first - 1])
                    size = self._offset(inside, ends, ends + length + 1)[0]
                    result.append(Jump(first, first + length - 1, float(size.max())))
        return result

    def _suspects(self) -> Ints:
        """Return the points off the line between their neighbours, and those next to such points.

        Many suspects are noise and raise the limit.
        """
        k = np.arange(1, self.count - 1)
        while True:
            odd = self._excess(k, k - 1, k + 1) > 0.0
            if not self.timed:
                odd |= ~self._is_in_step(k, k + 1)
            if not self.timed or np.count_nonzero(odd) <= SUSPECTS_MAX * self.count:
                break
            self.least *= 2.0
        near = np.zeros(self.count, dtype=bool)
        for shift in range(3):
            near[shift : self.count - 2 + shift] |= odd
        return np.flatnonzero(near)

    def _jumps_at_ends(self) -> list[Jump]:
        """Return the first and the last point if they are off the next three."""
        result = []
        for end, sign in ((0, 1), (self.count - 1, -1)):
            row = np.array([end + sign * k for k in range(4)])[:, None]
            is_off = self._excess(row[0], row[1], row[2])[0] > 0.0
            if is_off and self._excess(row[2], row[1], row[3])[0] <= 0.0:
                result.append(Jump(end, end, float(self._offset(row[0], row[1], row[2])[0][0])))
        return result

    def _offset(self, k: Ints, a: Ints, b: Ints) -> tuple[Floats, Floats]:
        """Return the distance (m) of point k from the line a to b at its time, and the limit."""
        x0, y0, t0, t = self.x[a], self.y[a], self.at[a], self.at[k]
        dx, dy, dt = self.x[b] - x0, self.y[b] - y0, self.at[b] - t0
        x, y = self.x[k] - x0, self.y[k] - y0
        share = np.where(dt != 0.0, (t - t0) / np.where(dt != 0.0, dt, 1.0), 0.5)
        if not self.timed:  # by distance, because of holes
            before = np.hypot(x, y)
            along = before / np.maximum(before + np.hypot(dx - x, dy - y), 1e-9)
            share = np.where((a < k) & (k < b), along, share)
        beyond = np.maximum(1.0, np.maximum(np.abs(share), np.abs(1.0 - share)))
        x, y = x - share * dx, y - share * dy
        length = np.maximum(np.hypot(dx, dy), 1e-9)
        if self.late:  # along the line, times do not tell
            late = self.late * length / np.maximum(np.abs(dt), 1e-9)
            along, across = (x * dx + y * dy) / length, (y * dx - x * dy) / length
            x, y = np.maximum(np.abs(along) - late * beyond, 0.0), across
        curve = (length * beyond) ** 2 / (8.0 * TIGHTEST)
        if self.timed:
            curve = 0.5 * ACCELERATION_MAX * np.abs((t - t0) * (t - t0 - dt))
        return np.hypot(x, y), np.maximum(self.least * beyond, curve)

    def _excess(self, k: Ints, a: Ints, b: Ints) -> Floats:
        """Return by how much (m) point k exceeds the limit between its neighbours a and b."""
        off, allowed = self._offset(k, a, b)
        if self.timed:
            return off - allowed
        # A loop may be tight for its points.
        return np.where(self._is_in_step(k, a) & self._is_in_step(k, b), 0.0, off - allowed)

    def _is_in_step(self, k: Ints, other: Ints) -> Mask:
        """Whether two points without times are a usual step apart."""
        apart = np.hypot(self.x[other] - self.x[k], self.y[other] - self.y[k])
        return np.asarray(apart <= LONG_STEP * self.usual[k] * np.abs(k - other))


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

SAMPLE = 5000
"""Number of points that represent a long stretch, and that are taken at a time."""

_RAYLEIGH = 1.1774
"""Median distance of plane normal noise, in its standard deviations."""

CRAWL, MOVING_SHARE = 0.1, 0.99
"""Times of a car that moves have more than 1 % of the steps faster than this (m/s)."""


class Stand(NamedTuple):
    """A standstill of points `first` to `last`, of which the car stands in `core`.

    `place` is the median of the core (m), `wander` its standard deviation (m, per axis).
    """

    first: int
    last: int
    core: tuple[int, int]
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
        for run in _joined(points, slow, radius):
            stand = _stand(points, at, run, radius, window)
            if stand is not None and free[stand.first : stand.last + 1].all():
                free[stand.first : stand.last + 1] = False
                stands.append(stand)
    result: list[Stand] = []
    for stand in sorted(stands):
        before = result[-1] if result else stand
        near = LEAST_RADIUS + UNLIKELY * max(before.wander, stand.wander)
        soon = at[stand.core[0]] - at[before.core[1]] <= DRIFTS[0]
        if result and soon and math.dist(before.place, stand.place) <= near:  # is the same
            core = before.core[0], stand.core[1]
            x, y = np.median(points[:, core[0] : core[1] + 1], axis=1).tolist()
            wander = max(before.wander, stand.wander)
            result[-1] = Stand(before.first, stand.last, core, (x, y), wander)
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


def _joined(points: Floats, slow: Mask, radius: float) -> Iterator[tuple[int, int]]:
    """Yield the slow runs of points, as one if all points between them are near."""
    held: tuple[int, int] | None = None
    for run in runs_of(slow):
        if held is not None:
            between = points[:, held[0] : run[1] + 1 : 1 + (run[1] - held[0]) // SAMPLE]
            away = np.hypot(*(between - np.median(between, axis=1)[:, None]))
            if float(np.max(away)) <= 2.0 * radius:
                run = held[0], run[1]  # noqa: PLW2901
            else:
                yield held
        held = run
    if held is not None:
        yield held


def _stand(
    points: Floats, at: Floats, run: tuple[int, int], radius: float, span: float
) -> Stand | None:
    """Return the standstill in a slow `run` of points; None for a slow drive.

    If its points drift further than noise in windows of `span` s, it includes all points among
    them.
    """
    first, last = run
    if last < first + 2:  # a pause of the recording: it does not show the noise
        return None
    core = points[:, first : last + 1]
    away = np.hypot(*(core - np.median(core, axis=1)[:, None]))
    if float(np.quantile(away, STILL)) > radius:
        if not _wanders(core, at[first : last + 1], span):
            return None
        radius = float(np.quantile(away, DRIFTED))
    # The windows include driven points before and after.
    still = np.flatnonzero(away <= radius) + first
    first, last = int(still[0]), int(still[-1])
    if at[last] - at[first] < LEAST_STAND - 1e-9:
        return None
    x, y = np.median(points[:, first : last + 1], axis=1).tolist()
    place = np.array(((x,), (y,)))
    wander = float(np.median(np.hypot(*(points[:, first : last + 1] - place)))) / _RAYLEIGH
    begin = first - _near_count(points[:, :first][:, ::-1], place, radius)
    end = last + _near_count(points[:, last + 1 :], place, radius)
    return Stand(begin, end, (first, last), (x, y), wander)


def _near_count(points: Floats, place: Floats, radius: float) -> int:
    """Return the number of first points that lie within the radius (m) of a place."""
    for begin in range(0, points.shape[1], SAMPLE):
        beyond = np.hypot(*(points[:, begin : begin + SAMPLE] - place)) > radius
        if beyond.any():
            return begin + int(beyond.argmax())
    return int(points.shape[1])


def _wanders(core: Floats, at: Floats, span: float) -> bool:
    """Whether points end far closer to their start than the distance they cover, by windows."""
    windows = np.floor((at - at[0]) / span)  # only those with points: a clock may leap by years
    edges = [0, *(np.flatnonzero(np.diff(windows)) + 1).tolist(), at.size]
    means = np.array([np.mean(core[:, a:b], axis=1) for a, b in pairwise(edges)]).T
    ends = float(np.hypot(*(means[:, -1] - means[:, 0])))
    return means.shape[1] > 2 and ends < WANDERING * float(step_lengths(means).sum())


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


def cleaned(points: Floats, times: Floats, time_error_s: float = 0.0) -> Cleaned:
    """Remove jumps and standstills from `points` (2, n) with `times` (s), empty if unknown.

    Times are late by 0 to `time_error_s`. Times in which a car hardly ever moves do not count.
    """
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(np.arange(count), points)
    gone = np.diff(times)
    speeds = step_lengths(points)[gone > 0.0] / gone[gone > 0.0] if gone.size else gone
    if speeds.size and float(np.quantile(speeds, MOVING_SHARE)) < CRAWL:
        times = np.zeros(0)
    jumps, left = find_jumps(points, times, time_error_s)
    places, kept = points.copy(), np.zeros(count, dtype=bool)
    kept[left] = True
    stands = []
    for stand in stands_in(points[:, left], times[left]) if times.size else ():
        first, last, begun, ended = left[[stand.first, stand.last, *stand.core]].tolist()
        starts, stops = stand.first == 0, stand.last == left.size - 1
        ends = [ended] if starts else [begun] if stops or begun == ended else [begun, ended]
        kept[first : last + 1] = False
        kept[ends] = True
        places[:, ends] = np.array(stand.place)[:, None]
        stands.append(Stand(first, last, (begun, ended), stand.place, stand.wander))
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
