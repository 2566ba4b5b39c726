"""Records whose times run back: out of order, of a wrong time, or after a leap of the clock."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.recorded_drive import Floats

LEAP = 86_400.0
"""Step in time (s), forward or back, that is no pause of a drive."""

SHORT = 5
"""Largest number of successive records whose times are replaced without a look at their order."""

NEIGHBOURS = 4
"""Number of records on either side of a short run that show whether the clock continues."""

MOST_RANGES = 1000
"""Largest number of ranges that are examined; a drive of more leaps has no usable times."""

Places = NDArray[np.int64]
Mask = NDArray[np.bool_]
Complex = NDArray[np.complex128]


@dataclass(slots=True)
class Disorder:
    """What to do about times that run back.

    Sorting by `key`, then by time, puts records into order. The times at `wrong` are unusable.
    `excursions` are the first and last record of runs on another clock, with their shift (s).
    Every step back that remains is a leap of the clock.
    """

    key: Floats
    wrong: Mask
    excursions: list[tuple[int, int, float]]


@dataclass(slots=True)
class _Runs:
    """Runs of successive records of a range that are off its longest order.

    `kept` are the records in order, `before` the place in `kept` of the one before a run. Of each
    record in `out`, `run` is its run, `slot` the place in `kept` after which its time belongs.
    """

    kept: Places
    first: Places
    last: Places
    before: Places
    out: Places
    run: Places
    slot: Places

    @property
    def length(self) -> Places:
        return self.last - self.first + 1


def longest_order(times: Floats) -> Mask:
    """Mark a longest subsequence that never decreases (patience sorting)."""
    ends: list[float] = []
    ended_by: list[int] = []
    previous: list[int] = []
    for k, time in enumerate(times.tolist()):
        if not ends or time >= ends[-1]:
            previous.append(ended_by[-1] if ended_by else -1)
            ends.append(time)
            ended_by.append(k)
        else:
            pile = bisect_right(ends, time)
            previous.append(ended_by[pile - 1] if pile else -1)
            ends[pile] = time
            ended_by[pile] = k
    marked = np.zeros(len(times), bool)
    k = ended_by[-1] if ended_by else -1
    while k >= 0:
        marked[k] = True
        k = previous[k]
    return marked


def disorder_of(times: Floats, places: Complex, numbers: Places, usual: float) -> Disorder:
    """Judge finite `times` (s) by the `places` (m, as east + i north) of their records.

    Records are out of order if the path in the order of time is the shorter one. Otherwise their
    times are wrong if the clock continues behind them, and the clock leaps if it does not.
    `numbers` count the records of the file; `usual` is the interval (s) between two of them.
    """
    result = Disorder(np.arange(len(times), dtype=float), np.zeros(len(times), bool), [])
    travelled = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(places)))))
    ranges = [(0, len(times))]
    for _ in range(MOST_RANGES):
        if not ranges:
            break
        begin, end = ranges.pop()
        marked = longest_order(times[begin:end])
        if marked.all():
            continue
        runs = _runs(marked, begin, times)
        in_file = _detour_in_file(runs, places, travelled)
        moved = _detour_in_time(runs, times, places) <= in_file + 1e-9
        chosen = moved[runs.run]
        slot = runs.slot[chosen]
        key = np.where(slot < 0, runs.kept[0] - 0.5, runs.kept[slot] + 0.5)
        result.key[runs.out[chosen]] = key
        leaps = ~moved & _leaps(runs, times, numbers, usual)
        _mark_wrong(result, runs, np.flatnonzero(~moved & ~leaps), times, usual)
        leaping = np.flatnonzero(leaps & (runs.length > SHORT)).tolist()
        ranges += [(int(runs.first[k]), int(runs.last[k]) + 1) for k in leaping]
    return result


def _runs(marked: Mask, begin: int, times: Floats) -> _Runs:
    """Return the runs of unmarked records of the range from `begin` on."""
    kept, out = begin + np.flatnonzero(marked), begin + np.flatnonzero(~marked)
    starts = np.concatenate(([True], np.diff(out) > 1))
    first, last = out[starts], out[np.concatenate((starts[1:], [True]))]
    before = np.searchsorted(kept, first) - 1
    slot = np.searchsorted(times[kept], times[out], side="right") - 1
    return _Runs(kept, first, last, before, out, np.cumsum(starts) - 1, slot)


def _detour_in_file(runs: _Runs, places: Complex, travelled: Floats) -> Floats:
    """Return by how much (m) each run lengthens the path in the order of the file."""
    first, last = runs.kept[0], runs.kept[-1]
    before = np.where(runs.first > first, runs.first - 1, runs.first)
    after = np.where(runs.last < last, runs.last + 1, runs.last)
    inside = (runs.first > first) & (runs.last < last)
    direct = np.where(inside, np.abs(places[after] - places[before]), 0.0)
    return np.asarray(travelled[after] - travelled[before] - direct)


def _detour_in_time(runs: _Runs, times: Floats, places: Complex) -> Floats:
    """Return by how much (m) each run lengthens the path if its records are sorted by time."""
    out = runs.out
    order = np.lexsort((out, times[out], runs.slot, runs.run))
    at, slots, run = places[out[order]], runs.slot[order], runs.run[order]
    kept = places[runs.kept]
    follows = (np.diff(slots) == 0) & (np.diff(run) == 0)
    begins, ends = np.concatenate(([True], ~follows)), np.concatenate((~follows, [True]))
    count = len(kept)
    before, after = kept[np.maximum(slots, 0)], kept[np.minimum(slots + 1, count - 1)]
    step = np.concatenate(([0.0], np.abs(np.diff(at)) * follows))
    step += np.where(begins & (slots >= 0), np.abs(at - before), 0.0)
    step += np.where(ends & (slots < count - 1), np.abs(after - at), 0.0)
    step -= np.where(begins & (slots >= 0) & (slots < count - 1), np.abs(after - before), 0.0)
    detour = np.bincount(run, step, len(runs.first)).astype(float)
    bounds = times[runs.kept[[0, -1]]] + (-LEAP, LEAP)
    foreign = (times[out] < bounds[0]) | (times[out] > bounds[1])
    detour[runs.run[foreign]] = np.inf
    return detour


def _leaps(runs: _Runs, times: Floats, numbers: Places, usual: float) -> Mask:
    """Mark runs around which the clock lacks the time that their records take."""
    count, length = len(runs.kept), runs.length
    inside = (runs.before >= 0) & (runs.before < count - 1)
    wider = np.where(length < NEIGHBOURS, NEIGHBOURS, 0)
    low = runs.kept[np.maximum(runs.before - wider, 0)]
    high = runs.kept[np.minimum(runs.before + 1 + wider, count - 1)]
    lacking = (numbers[high] - numbers[low]) * usual - (times[high] - times[low])
    return np.asarray(np.where(inside, lacking > (0.25 + 0.5 * length) * usual, length > SHORT))


def _mark_wrong(result: Disorder, runs: _Runs, wrong: Places, times: Floats, usual: float) -> None:
    for k in wrong.tolist():
        first, last = int(runs.first[k]), int(runs.last[k])
        place = int(runs.before[k])
        if first == last:
            result.wrong[_worse(runs, place, first, times)] = True
            continue
        if last - first + 1 > SHORT and 0 <= place < len(runs.kept) - 1:
            before, after = times[runs.kept[place]], times[runs.kept[place + 1]]
            span = times[last] - times[first]
            fits = span <= after - before and bool((np.diff(times[first : last + 1]) >= 0.0).all())
            if fits:
                margin = min(usual, (after - before - span) / 2.0)
                result.excursions.append((first, last, float(before + margin - times[first])))
                continue
        result.wrong[first : last + 1] = True


def _worse(runs: _Runs, place: int, single: int, times: Floats) -> int:
    """Return `single` or the record after it: the one whose time fits its neighbours less."""
    if not 0 <= place < len(runs.kept) - 2:
        return single
    before, after, beyond = runs.kept[place : place + 3].tolist()
    if not (after == single + 1 and times[before] <= times[single] <= times[beyond]):
        return single
    third = (times[beyond] - times[before]) / 3.0
    off = abs(times[single] - times[before] - third)
    off_after = abs(times[after] - times[before] - 2.0 * third)
    return int(after) if off_after > off else single
