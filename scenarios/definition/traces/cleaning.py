"""Removal of jumps and standstills from a recorded drive."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.jumps import UNLIKELY, Jump, find_jumps
from vehicles.geometry.bridges import noise_deviation, step_lengths

# ---- Standstills of a car with a drifting receiver


FEWEST = 8
"""Smallest number of points that is searched; fewer points give no statistics."""

SLOWEST = 0.5
"""Mean speed (m/s) below which a car may be standing."""

SLOW_SHARE = 0.25
"""The same for points without times, as a share of their usual progress."""

USUAL = 20
"""Number of points over which usual progress is measured."""

LEAST_STAND = 3.0
"""Shortest standstill (s); without times, the number of points."""

DRIFTS = (10.0, 20.0)
"""Times (s) over which the drift of a receiver averages out."""

LEAST_RADIUS = 0.5
"""Radius (m) of a standstill, or UNLIKELY times the noise if that is more."""

STILL = 0.6
"""Smallest share of a slow stretch within the radius; the rest is driven before and after."""

SURELY_STILL = 0.9
"""The same for points without times."""

WANDERING = 0.5
"""Progress over distance below which a stretch is no slow drive, however far it drifts."""

SAMPLE = 5000
"""Number of points that represent a long stretch, and that are taken at a time."""

_RAYLEIGH = 1.1774
"""Median distance of plane normal noise, in its standard deviations."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stand:
    """A standstill of points `first` to `last`, of which the car stands in `core`.

    `place` is the median of the core (m), `wander` its standard deviation (m, per axis).
    """

    first: int
    last: int
    core: tuple[int, int]
    place: tuple[float, float]
    wander: float


def stands_in(points: Floats, at: Floats, *, timed: bool) -> list[Stand]:
    """Return the standstills in `points` (2, n) at times or numbers `at`, in order."""
    noise = noise_deviation(points)
    gone = np.diff(at)
    usual = float(np.median(gone[gone > 0.0])) if (gone > 0.0).any() else 1.0
    slowest = SLOWEST
    if not timed:
        ahead = min(USUAL, at.size - 1)
        got = np.hypot(*(points[:, ahead:] - points[:, :-ahead]))
        slowest = SLOW_SHARE * float(np.median(got)) / ahead
    if slowest <= 0.0:
        return []
    # Noise of one half of a window against the other: 4 noise / (span sqrt(points)).
    count = (10.0 * noise / (slowest * usual)) ** (2.0 / 3.0)
    span = max(LEAST_STAND, count * usual) if timed else max(FEWEST, count)
    radius = max(LEAST_RADIUS, UNLIKELY * noise)
    free = np.ones(at.size, dtype=bool)
    result: list[Stand] = []
    # Drift looks like motion in short windows; short standstills vanish in long ones.
    for window in sorted({span, *(DRIFTS if timed else ())}, reverse=True):
        slow = _slow(points, at, max(window, span), slowest) & free
        for run in _joined(points, _runs(slow), radius):
            stand = _stand(points, at, run, radius, window if timed else math.inf)
            if stand is not None and free[stand.first : stand.last + 1].all():
                free[stand.first : stand.last + 1] = False
                result.append(stand)
    return _in_one(sorted(result, key=lambda stand: stand.first), points, at)


def _in_one(stands: list[Stand], points: Floats, at: Floats) -> list[Stand]:
    """Merge standstills that follow each other at nearly the same place."""
    result: list[Stand] = []
    for stand in stands:
        before = result[-1] if result else None
        if before is None or not _are_one(before, stand, at):
            result.append(stand)
            continue
        core = before.core[0], stand.core[1]
        x, y = np.median(points[:, core[0] : core[1] + 1], axis=1).tolist()
        wander = max(before.wander, stand.wander)
        result[-1] = Stand(before.first, stand.last, core, (x, y), wander)
    return result


def _are_one(before: Stand, stand: Stand, at: Floats) -> bool:
    apart = math.dist(before.place, stand.place)
    soon = at[stand.core[0]] - at[before.core[1]] <= DRIFTS[0]
    return bool(soon and apart <= LEAST_RADIUS + UNLIKELY * max(before.wander, stand.wander))


def _slow(points: Floats, at: Floats, span: float, slowest: float) -> NDArray[np.bool_]:
    """Mark points in a window of `span` s without progress."""
    first = np.arange(at.size)
    last = np.searchsorted(at, at + span * (1.0 - 1e-9))
    whole = last < at.size
    first, last = first[whole], last[whole]
    middle = (first + last + 1) // 2
    sums = np.concatenate((np.zeros((2, 1)), np.cumsum(points, axis=1)), axis=1)
    early = (sums[:, middle] - sums[:, first]) / np.maximum(middle - first, 1)
    late = (sums[:, last + 1] - sums[:, middle]) / np.maximum(last + 1 - middle, 1)
    moved = np.hypot(*(late - early))
    quiet = moved < slowest * 0.5 * span
    marks = np.zeros(at.size + 1, dtype=np.int64)
    np.add.at(marks, first[quiet], 1)
    np.add.at(marks, last[quiet] + 1, -1)
    return np.asarray(np.cumsum(marks)[:-1] > 0)


def _runs(slow: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], slow, [False]))))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _joined(
    points: Floats, runs: list[tuple[int, int]], radius: float
) -> Iterator[tuple[int, int]]:
    held: tuple[int, int] | None = None
    for run in runs:
        if held is None:
            held = run
            continue
        between = points[:, held[0] : run[1] + 1 : 1 + (run[1] - held[0]) // SAMPLE]
        middle = np.median(between, axis=1)[:, None]
        if float(np.max(np.hypot(*(between - middle)))) <= 2.0 * radius:
            held = held[0], run[1]
        else:
            yield held
            held = run
    if held is not None:
        yield held


def _stand(
    points: Floats, at: Floats, run: tuple[int, int], radius: float, span: float
) -> Stand | None:
    """Return the standstill in a slow `run` of points; None for a slow drive.

    If its points drift further than noise, it includes all points among them. `span` is infinite
    without times, where drift and slow driving look alike.
    """
    first, last = run
    if last < first + 2:  # a pause of the recording: it does not show the noise
        return None
    core = points[:, first : last + 1]
    middle = np.median(core, axis=1)[:, None]
    away = np.hypot(*(core - middle))
    if float(np.quantile(away, SURELY_STILL if math.isinf(span) else STILL)) > radius:
        if math.isinf(span) or not _wanders(core, at[first : last + 1], span):
            return None
        radius = float(np.quantile(away, SURELY_STILL))
    # The windows include driven points before and after.
    still = np.flatnonzero(away <= radius) + first
    first, last = int(still[0]), int(still[-1])
    if at[last] - at[first] < LEAST_STAND - 1e-9:
        return None
    place = np.median(points[:, first : last + 1], axis=1)
    wander = float(np.median(np.hypot(*(points[:, first : last + 1] - place[:, None])))) / _RAYLEIGH
    begin = first - _near_count(points[:, :first][:, ::-1], place, radius)
    end = last + _near_count(points[:, last + 1 :], place, radius)
    return Stand(begin, end, (first, last), (float(place[0]), float(place[1])), wander)


def _near_count(points: Floats, place: Floats, radius: float) -> int:
    """Return the number of first points that lie within the radius (m) of a place."""
    for begin in range(0, points.shape[1], SAMPLE):
        away = np.hypot(*(points[:, begin : begin + SAMPLE] - place[:, None]))
        beyond = np.flatnonzero(away > radius)
        if beyond.size:
            return begin + int(beyond[0])
    return int(points.shape[1])


def _wanders(core: Floats, at: Floats, span: float) -> bool:
    """Whether points end far closer to their start than the distance they cover, by windows."""
    windows = np.floor((at - at[0]) / span)  # only those with points: a clock may leap by years
    edges = [0, *(np.flatnonzero(np.diff(windows)) + 1).tolist(), at.size]
    means = [np.mean(core[:, a:b], axis=1) for a, b in pairwise(edges)]
    if len(means) < 3:
        return False
    covered = sum(float(np.hypot(*(after - before))) for before, after in pairwise(means))
    return float(np.hypot(*(means[-1] - means[0]))) < WANDERING * covered


# ---- Cleaning


CRAWL, MOVING_SHARE = 0.1, 0.99
"""Times of a car that moves have more than 1 % of the steps faster than this (m/s)."""


@dataclass(slots=True)
class Cleaned:
    """Numbers of the kept points, their positions (m, shape (2, n)), jumps and standstills.

    A standstill becomes two points at one place; one point before the first movement or after the
    last. `noise` is the standard deviation (m, per axis) of white noise, or of drift at standstill.
    """

    kept: NDArray[np.int64]
    points: Floats
    noise: float = 0.0
    jumps: list[Jump] = field(default_factory=list)
    stands: list[Stand] = field(default_factory=list)


def cleaned(points: Floats, times: Sequence[float] | Floats, time_error_s: float = 0.0) -> Cleaned:
    """Remove jumps and standstills from `points` (2, n) with `times` (s), empty if unknown.

    Times are late by 0 to `time_error_s`.
    """
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(np.arange(count), points)
    if _never_moves(points, np.asarray(times)):
        times = ()
    jumps, remaining = find_jumps(points, times, time_error_s)
    timed = len(times) > 0
    at = np.asarray(times)[remaining] if timed else remaining.astype(np.float64)
    stands = [
        replace(
            stand,
            first=int(remaining[stand.first]),
            last=int(remaining[stand.last]),
            core=(int(remaining[stand.core[0]]), int(remaining[stand.core[1]])),
        )
        for stand in stands_in(points[:, remaining], at, timed=timed)
    ]
    noise = max([noise_deviation(points[:, remaining]), *(stand.wander for stand in stands)])
    places = points.copy()
    is_kept = np.zeros(count, dtype=bool)
    is_kept[remaining] = True
    for stand in stands:
        starts, stops = stand.first == remaining[0], stand.last == remaining[-1]
        begun, ended = stand.core
        ends = [ended] if starts else [begun] if stops or begun == ended else [begun, ended]
        is_kept[stand.first : stand.last + 1] = False
        is_kept[ends] = True
        places[:, ends] = np.array(stand.place)[:, None]
    kept = np.flatnonzero(is_kept)
    return Cleaned(kept, places[:, kept], noise, jumps, stands)


def _never_moves(points: Floats, times: Floats) -> bool:
    """Whether times, such as those in a wrong unit, have the car stand during the whole drive."""
    steps, gone = step_lengths(points), np.diff(times)
    if not gone.size or not (gone > 0.0).any():
        return False
    speeds = steps[gone > 0.0] / gone[gone > 0.0]
    return float(np.quantile(speeds, MOVING_SHARE)) < CRAWL
