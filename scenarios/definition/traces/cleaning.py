"""What a receiver records and no car drives: jumps, and the wander of a place where it stands."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.bridges import NEARBY, lengths, scatter

FEWEST = 8
"""Fewer points than this are left as they are: they do not tell what is unusual among them."""

LONGEST_JUMP = 10
"""A jump goes away and comes back within so many points."""

LEAST_JUMP = 0.5
"""A point that lies this close (m) to where its neighbours put it has not jumped."""

UNLIKELY = 6.0
"""Noise moves a point by so many of its standard deviations practically never."""

MOST_ACCELERATION = 15.0
"""No car brakes or corners harder than this (m/s²)."""

TIGHTEST = 3.0
"""No car turns tighter than with this radius (m)."""

LONG_STEP = 1.5
"""Points without times jump by more than so many of the steps nearby."""

SLOWEST = 0.5
"""What moves slower than this (m/s) on average may be standing..."""

SLOW_SHARE = 0.25
"""...or, of points without times, by less than this share of how far they usually get."""

USUAL = 20
"""How far points usually get is measured over so many of them."""

LEAST_STAND = 3.0
"""A car stands for at least so long (s), or for this many points without times..."""

DRIFTS = (10.0, 20.0)
"""Times (s) over which a receiver that drifts gets nowhere."""

LEAST_RADIUS = 0.5
"""...within this distance (m) of one place, or within UNLIKELY times the noise."""

STILL = 0.6
"""So large a share of a slow stretch is within that distance if it is a stand: the rest is what the
car drove before it stopped and after it went on."""

SURELY_STILL = 0.9
"""The same for points without times."""

WANDERING = 0.5
"""What gets less far than this share of its way is no crawl, however far it drifts."""

_RAYLEIGH = 1.1774
"""Median distance of plane normal noise, in its standard deviations."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Jump:
    """Points `first` to `last` (from 0), up to `size` m from where the drive is."""

    first: int
    last: int
    size: float


@dataclass(frozen=True, slots=True)
class Stand:
    """A stand: points `first` to `last` belong to it, of which the car stands in `core`.

    `place` is the median of the core's points (m), `wander` their standard deviation (m, per axis).
    """

    first: int
    last: int
    core: tuple[int, int]
    place: tuple[float, float]
    wander: float


@dataclass(slots=True)
class Cleaned:
    """Which points are kept, by number, where they are (m, shape (2, n)), and what was found.

    A stand in the drive is two points at one place, one at its beginning and one at its end. A
    stand before the first movement is one point, as is one after the last. `noise` is the standard
    deviation (m, per axis) of the points: of their white noise, or of their wander in a stand.
    """

    kept: list[int]
    points: Floats
    noise: float = 0.0
    jumps: list[Jump] = field(default_factory=list)
    stands: list[Stand] = field(default_factory=list)


def cleaned(points: Floats, times: Sequence[float]) -> Cleaned:
    """Take jumps and stands out of `points` (2, n) with their `times` (s), () where not known."""
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(list(range(count)), points)
    track = _Track(points, times)
    jumps = track.without_jumps()
    left = np.array(track.kept)
    stands = [
        replace(
            one,
            first=int(left[one.first]),
            last=int(left[one.last]),
            core=(int(left[one.core[0]]), int(left[one.core[1]])),
        )
        for one in _stands(points[:, left], track.at[left], timed=bool(times))
    ]
    noise = max([scatter(points[:, left]), *(stand.wander for stand in stands)])
    found = Cleaned([], points.copy(), noise, jumps, stands)
    begin = 0
    for stand in [*stands, None]:
        end = stand.first if stand else count
        found.kept += [int(k) for k in left if begin <= k < end]
        if stand:
            starts, stops = stand.first == left[0], stand.last == left[-1]
            begun, ended = stand.core
            ends = (ended,) if starts else (begun,) if stops or begun == ended else stand.core
            found.kept += ends
            found.points[:, list(ends)] = np.array(stand.place)[:, None]
            begin = stand.last + 1
    found.points = found.points[:, found.kept]
    return found


class _Track:
    """Points of which those that jump are taken out one after the other."""

    def __init__(self, points: Floats, times: Sequence[float]) -> None:
        self.points = points
        self.timed = bool(times)
        count = points.shape[1]
        self.at = np.asarray(times if self.timed else range(count), dtype=np.float64)
        self.kept = list(range(count))
        self._xy = list(zip(*points.tolist(), strict=True))
        self._t = self.at.tolist()
        self._steps = lengths(points)
        self._least = max(LEAST_JUMP, UNLIKELY * scatter(points))

    def without_jumps(self) -> list[Jump]:
        """Take out what jumps, and say what that was."""
        found: list[Jump] = []
        place = 0
        suspects = set(self._suspects())
        while place < len(self.kept):
            jump = self._jump(place) if self.kept[place] in suspects else None
            if jump is None:
                place += 1
                continue
            found.append(
                Jump(self.kept[place], self.kept[place + jump - 1], self._size(place, jump))
            )
            around = self.kept[max(0, place - 2) : place + jump + 2]
            del self.kept[place : place + jump]
            suspects.update(around)
            place = max(0, place - 2)
        return found

    def _suspects(self) -> list[int]:
        """Points that lie off the line between their neighbours, with those next to them."""
        odd = [k for k in range(1, len(self.kept) - 1) if self._excess(k, k - 1, k + 1) > 0.0]
        if not self.timed:
            odd += [k for k in range(1, len(self.kept) - 1) if not self._is_in_step(k, k + 1)]
        ends = [0, len(self.kept) - 1]
        return [*ends, *(near for k in odd for near in (k - 1, k, k + 1))]

    def _jump(self, place: int) -> int | None:
        """How many points from `place` on jump; None if it does not."""
        last = len(self.kept) - 1
        for count in range(1, LONGEST_JUMP + 1):
            before, after = place - 1, place + count
            if after > last:
                break
            ends = {place, place + count - 1}
            if before < 0:
                off = count == 1 and self._excess(self._k(0), self._k(1), self._k(2)) > 0.0
            else:
                off = all(
                    self._excess(self._k(k), self._k(before), self._k(after)) > 0.0 for k in ends
                )
            if off and self._is_plausible_without(before, after):
                return count
        if place == last and self._excess(*(self._k(last - k) for k in range(3))) > 0.0:
            return 1
        return None

    def _k(self, place: int) -> int:
        return self.kept[min(max(place, 0), len(self.kept) - 1)]

    def _is_plausible_without(self, before: int, after: int) -> bool:
        """Whether the points around a gap fit one another once what is between has gone."""
        row = [k for k in (before - 2, before - 1, before, after, after + 1, after + 2) if k >= 0]
        row = [k for k in row if k < len(self.kept)]
        threes = zip(row, row[1:], row[2:], strict=False)
        return all(self._excess(self._k(b), self._k(a), self._k(c)) <= 0.0 for a, b, c in threes)

    def _offset(self, k: int, a: int, b: int) -> tuple[float, float]:
        """How far (m) point k is from the line from a to b at its time, and how far it may be."""
        (x0, y0), (x1, y1), (x, y) = self._xy[a], self._xy[b], self._xy[k]
        t0, t1, t = self._t[a], self._t[b], self._t[k]
        share = (t - t0) / (t1 - t0) if t1 != t0 else 0.5
        if not self.timed and a < k < b:  # as far along as its distances say, for holes
            way = math.hypot(x - x0, y - y0)
            share = way / max(way + math.hypot(x1 - x, y1 - y), 1e-9)
        beyond = max(1.0, abs(share), abs(1.0 - share))
        off = math.hypot(x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0))
        if self.timed:
            curve = 0.5 * MOST_ACCELERATION * abs((t - t0) * (t - t1))
        else:
            curve = (math.hypot(x1 - x0, y1 - y0) * beyond) ** 2 / (8.0 * TIGHTEST)
        return off, max(self._least * beyond, curve)

    def _excess(self, k: int, a: int, b: int) -> float:
        """By how much (m) point k is further from its neighbours a and b than a car gets."""
        off, allowed = self._offset(k, a, b)
        if off > allowed and not self.timed and self._is_in_step(k, a) and self._is_in_step(k, b):
            return 0.0  # on a loop that is tight for its points
        return off - allowed

    def _is_in_step(self, k: int, other: int) -> bool:
        """Whether a point is as far from another one as points without times usually are."""
        steps = self._steps[max(0, k - NEARBY) : k + NEARBY]
        (x0, y0), (x1, y1) = self._xy[k], self._xy[other]
        usual = LONG_STEP * float(np.median(steps)) * abs(k - other)
        return bool(np.hypot(x1 - x0, y1 - y0) <= usual)

    def _size(self, place: int, count: int) -> float:
        before, after = self._k(place - 1), self._k(place + count)
        if place == 0:
            before, after = self._k(1), self._k(2)
        elif place + count >= len(self.kept):
            before, after = self._k(place - 2), self._k(place - 1)
        return max(self._offset(self._k(k), before, after)[0] for k in range(place, place + count))


def _stands(points: Floats, at: Floats, *, timed: bool) -> list[Stand]:
    """Find the stands among `points` (2, n) at instants or numbers `at`, in their order."""
    noise = scatter(points)
    gone = np.diff(at)
    usual = float(np.median(gone[gone > 0.0])) if (gone > 0.0).any() else 1.0
    slowest = SLOWEST
    if not timed:
        ahead = min(USUAL, at.size - 1)
        got = np.hypot(*(points[:, ahead:] - points[:, :-ahead]))
        slowest = SLOW_SHARE * float(np.median(got)) / ahead
    if slowest <= 0.0:
        return []
    # Half the points of a window against the other half: 4 noise / (span sqrt(points)).
    count = (10.0 * noise / (slowest * usual)) ** (2.0 / 3.0)
    span = max(LEAST_STAND, count * usual) if timed else max(FEWEST, count)
    radius = max(LEAST_RADIUS, UNLIKELY * noise)
    free = np.ones(at.size, dtype=bool)
    found: list[Stand] = []
    # What drifts seems to move over a few seconds, and what stands for a few is lost in many.
    for window in sorted({span, *(DRIFTS if timed else ())}, reverse=True):
        slow = _slow(points, at, max(window, span), slowest) & free
        for run in _joined(points, _runs(slow), radius):
            one = _stand(points, at, run, radius, window if timed else math.inf)
            if one is not None and free[one.first : one.last + 1].all():
                free[one.first : one.last + 1] = False
                found.append(one)
    return _in_one(sorted(found, key=lambda one: one.first), points, at)


def _in_one(stands: list[Stand], points: Floats, at: Floats) -> list[Stand]:
    """Make one of stands that follow one another at once and nearly at one place."""
    found: list[Stand] = []
    for stand in stands:
        before = found[-1] if found else None
        if before is None or not _are_one(before, stand, at):
            found.append(stand)
            continue
        core = before.core[0], stand.core[1]
        x, y = np.median(points[:, core[0] : core[1] + 1], axis=1).tolist()
        wander = max(before.wander, stand.wander)
        found[-1] = Stand(before.first, stand.last, core, (x, y), wander)
    return found


def _are_one(before: Stand, stand: Stand, at: Floats) -> bool:
    apart = math.dist(before.place, stand.place)
    soon = at[stand.core[0]] - at[before.core[1]] <= DRIFTS[0]
    return bool(soon and apart <= LEAST_RADIUS + UNLIKELY * max(before.wander, stand.wander))


def _slow(points: Floats, at: Floats, span: float, slowest: float) -> NDArray[np.bool_]:
    """Which points are part of a window of `span` s in which the car gets nowhere."""
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
    """Runs between which the car stays where it is are one."""
    held: tuple[int, int] | None = None
    for run in runs:
        if held is None:
            held = run
            continue
        between = points[:, held[0] : run[1] + 1]
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
    """The stand that a slow `run` of points is; None for a crawl.

    Where its points drift further than noise, all that lies among them belongs to it. An infinite
    `span` says that without times nobody can tell a drift from a crawl.
    """
    first, last = run
    if last <= first:
        return None
    core = points[:, first : last + 1]
    middle = np.median(core, axis=1)[:, None]
    away = np.hypot(*(core - middle))
    if float(np.quantile(away, SURELY_STILL if math.isinf(span) else STILL)) > radius:
        if math.isinf(span) or not _wanders(core, at[first : last + 1], span):
            return None
        radius = float(np.quantile(away, SURELY_STILL))
    # The windows reach into what was driven before and after.
    still = np.flatnonzero(away <= radius) + first
    first, last = int(still[0]), int(still[-1])
    if at[last] - at[first] < LEAST_STAND - 1e-9:
        return None
    place = np.median(points[:, first : last + 1], axis=1)
    wander = float(np.median(np.hypot(*(points[:, first : last + 1] - place[:, None])))) / _RAYLEIGH
    begin, end = first, last
    while begin > 0 and np.hypot(*(points[:, begin - 1] - place)) <= radius:
        begin -= 1
    while end < at.size - 1 and np.hypot(*(points[:, end + 1] - place)) <= radius:
        end += 1
    return Stand(begin, end, (first, last), (float(place[0]), float(place[1])), wander)


def _wanders(core: Floats, at: Floats, span: float) -> bool:
    """Whether points end up far closer to their beginning than their way, window by window, is."""
    edges = np.searchsorted(at, np.arange(at[0], at[-1] + span, span))
    means = [np.mean(core[:, a:b], axis=1) for a, b in pairwise(edges.tolist()) if b > a]
    if len(means) < 3:
        return False
    way = sum(float(np.hypot(*(after - before))) for before, after in pairwise(means))
    return float(np.hypot(*(means[-1] - means[0]))) < WANDERING * way
