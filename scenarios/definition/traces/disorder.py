"""Records whose times run back: out of order, of a wrong time, or after a leap of the clock."""

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.recorded_drive import Floats, Mask

LEAP = 86_400.0
"""Step in time (s), forward or back, that is no pause of a drive."""

SHORT = 5
"""Largest number of successive records whose times are replaced without a look at their order."""

NEIGHBOURS = 4
"""Number of records on either side of a short run that show whether the clock continues."""

SOURCES = 3
"""Largest number of sources that alternate in a file."""

SURE = 20.0
"""Ratio of two paths from which on positions overrule what the times show."""

RARE = 0.05
"""Share of records of the time before below which such a time is a fault."""

MOST_ADVANCING = 0.7
"""Share of records of a later time than the one before up to which times are coarse."""

MOST_LEAPS = 0.1
"""Share of records with a leap of the clock above which times are unusable."""

MOST_RANGES = 10_000
"""Largest number of ranges that are examined; a drive of more leaps has no usable times."""

SHUFFLED = 0.5
"""Ratio of the paths in the order of time and of the file below which the file is shuffled."""

FAR_STEP = 0.15
"""Share of the extent of a drive from which on a step is far."""

Places = NDArray[np.int64]
Complex = NDArray[np.complex128]


@dataclass(slots=True)
class Disorder:
    """What to do about times that run back.

    Sorting by `key`, then by time, puts records into order. The times at `wrong` are unusable.
    `runs` are the first and last records of long runs on another clock. Every step back that
    remains is a leap of the clock.
    """

    key: Floats
    wrong: Mask
    runs: list[tuple[int, int]]


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


def usual_interval(times: Floats) -> float:
    """Return the interval (s) of most records, of one of up to SOURCES that alternate; or 1."""
    intervals = []
    for apart in range(1, SOURCES + 1):
        steps = np.abs(times[apart:] - times[:-apart])
        steps = steps[(steps > 0.0) & (steps <= LEAP)]
        if steps.size:
            intervals.append(float(np.quantile(steps, 0.4)))
    return min(intervals, default=1.0)


def is_shuffled(times: Floats, places: Complex) -> bool:
    """Whether times run back at far steps, and the path in the order of time is much shorter.

    Laps on a clock that starts again are shorter, too, but have no far steps.
    """
    steps = np.abs(np.diff(places))
    in_time = np.abs(np.diff(places[np.argsort(times, kind="stable")]))
    extent = abs(complex(np.ptp(places.real), np.ptp(places.imag)))
    back = steps[np.diff(times) < 0.0]
    is_far = back.size > 0 and float(np.median(back)) > FAR_STEP * extent
    return is_far and float(in_time.sum()) < SHUFFLED * float(steps.sum())


def excursions_of(
    times: Floats, places: Complex, numbers: Places, usual: float
) -> list[tuple[int, int]]:
    """Return the first and last records of runs after which the clock continues as before them.

    Such a run begins with a step forward and ends with one back, or the reverse, and both together
    take the time that their records take, or both are far beyond the time of a drive. `numbers`
    count the records of the file.
    """
    steps, records = np.diff(times), np.diff(numbers)
    far = np.flatnonzero(np.abs(steps) > LEAP)
    opens, closes = steps[far[:-1]], steps[far[1:]]
    returns = (opens * closes < 0.0) & (np.abs(opens + closes) < LEAP)
    returns &= 2 * (far[1:] - far[:-1]) < len(times)
    bounds = list(zip(far[:-1][returns].tolist(), far[1:][returns].tolist(), strict=True))
    bounds += _matching_steps(steps, records, places, usual)
    if len(bounds) > max(SHORT, MOST_LEAPS * len(times)):
        return []
    result: list[tuple[int, int]] = []
    for before, last in sorted(bounds):
        if not result or before > result[-1][1]:
            result.append((before + 1, last))
    return result


def _matching_steps(
    steps: Floats, records: Places, places: Complex, usual: float
) -> list[tuple[int, int]]:
    """Return the places of two steps that together take the time that their records take."""
    odd = np.flatnonzero((steps < 0.0) | (steps > 2.5 * records * usual))
    if odd.size < 2:
        return []
    opens, closes = steps[odd[:-1]], steps[odd[1:]]
    advancing = float((steps > 0.0).mean())
    coarse = advancing < MOST_ADVANCING
    interval, tolerance = (usual * advancing, 2.0 * usual) if coarse else (usual, 0.5 * usual)
    expected = (records[odd[:-1]] + records[odd[1:]]) * interval
    matches = (opens * closes < 0.0) & (np.abs(opens + closes - expected) < tolerance)
    if coarse:  # a late record looks alike, but lies elsewhere
        distances = np.abs(np.diff(places))
        continues = distances <= 10.0 * float(np.median(distances))
        matches &= continues[odd[:-1]] & continues[odd[1:]]
    matches &= np.minimum(np.abs(opens), np.abs(closes)) > 2.5 * usual
    matches &= 2 * (odd[1:] - odd[:-1]) <= len(steps)
    return list(zip(odd[:-1][matches].tolist(), odd[1:][matches].tolist(), strict=True))


def longest_order(times: Floats, bisect: Callable[[list[float], float], int]) -> Mask:
    """Mark a longest subsequence in order (patience sorting).

    It increases with `bisect_left`, and never decreases with `bisect_right`.
    """
    ends: list[float] = []
    ended_by: list[int] = []
    previous: list[int] = []
    for k, time in enumerate(times.tolist()):
        pile = bisect(ends, time) if ends and time <= ends[-1] else len(ends)
        if pile == len(ends):
            previous.append(ended_by[-1] if ended_by else -1)
            ends.append(time)
            ended_by.append(k)
        else:
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
    step = float(np.median(np.diff(travelled))) if len(times) > 1 else 0.0
    repeated = float((np.diff(times) == 0.0).mean()) if len(times) > 1 else 0.0
    bisect = bisect_left if repeated < RARE else bisect_right
    ranges = [(0, len(times))]
    for _ in range(MOST_RANGES):
        if not ranges:
            break
        begin, end = ranges.pop()
        if bool((np.diff(times[begin:end]) >= 0.0).all()):
            continue
        marked = longest_order(times[begin:end], bisect)
        if marked.all():
            continue
        runs = _runs(marked, begin, times)
        in_file = _detour_in_file(runs, places, travelled)
        in_time = _detour_in_time(runs, times, places)
        lacking = _lacks_time(runs, times, numbers, usual)
        ratio = _most_detour(_fills_holes(runs, times, usual), lacking)
        floor = np.where(ratio > 1.0, runs.length * step, np.where(ratio < 1.0, -1e-9, 1e-9))
        moved = in_time <= ratio * in_file + floor
        chosen = moved[runs.run]
        slot = runs.slot[chosen]
        key = np.where(slot < 0, runs.kept[0] - 0.5, runs.kept[slot] + 0.5)
        result.key[runs.out[chosen]] = key
        leaps = ~moved & lacking
        _mark_wrong(result, runs, np.flatnonzero(~moved & ~leaps), times)
        for k in np.flatnonzero(leaps & (runs.length > 1)).tolist():
            ranges += _parts(times, int(runs.first[k]), int(runs.last[k]) + 1)
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


def _fills_holes(runs: _Runs, times: Floats, usual: float) -> Mask:
    """Mark runs most records of which fill holes of the others in the order of time."""
    count = len(runs.kept)
    in_slot = np.bincount(runs.slot + 1, minlength=count + 1)
    bounds = times[runs.kept]
    gaps = np.concatenate(([np.inf], np.diff(bounds), [np.inf]))
    fills = (gaps / (in_slot + 1) > 0.6 * usual)[runs.slot + 1]
    margin = usual * (1 + in_slot[[0, -1]])
    out = times[runs.out]
    fills &= (out >= bounds[0] - margin[0]) & (out <= bounds[-1] + margin[1])
    # At the ends, a block after a leap of the clock leaves a hole.
    early, late = runs.slot < 0, runs.slot == count - 1
    if bounds[0] - np.max(out[early], initial=-np.inf) > NEIGHBOURS * usual:
        fills &= ~early
    if np.min(out[late], initial=np.inf) - bounds[-1] > NEIGHBOURS * usual:
        fills &= ~late
    return np.asarray(np.bincount(runs.run, fills) > 0.8 * runs.length)


def _most_detour(fills: Mask, lacking: Mask) -> Floats:
    """Return up to how many times the detour in the file sorted records may take.

    Where times show on their own what happened, noise of the positions must not decide.
    """
    return np.where(fills, SURE, np.where(lacking, 1.0, 1.0 / SURE))


def _lacks_time(runs: _Runs, times: Floats, numbers: Places, usual: float) -> Mask:
    """Mark runs around which the clock lacks the time that their records take."""
    count, length = len(runs.kept), runs.length
    inside = (runs.before >= 0) & (runs.before < count - 1)
    wider = np.where(length < NEIGHBOURS, NEIGHBOURS, 0)
    low = runs.kept[np.maximum(runs.before - wider, 0)]
    high = runs.kept[np.minimum(runs.before + 1 + wider, count - 1)]
    lacking = (numbers[high] - numbers[low]) * usual - (times[high] - times[low])
    return np.asarray(np.where(inside, lacking > (0.25 + 0.5 * length) * usual, length > SHORT))


def _parts(times: Floats, begin: int, end: int) -> list[tuple[int, int]]:
    """Return the ranges between the largest steps back in a range, none if it has no such step."""
    steps = np.diff(times[begin:end])
    largest = float(steps.min())
    if largest >= 0.0:
        return []
    edges = (begin + 1 + np.flatnonzero(steps <= largest / 2.0)).tolist()
    if len(edges) > max(1.0, MOST_LEAPS * (end - begin)):
        return []
    return [(a, b) for a, b in pairwise([begin, *edges, end]) if b - a > 1]


def _mark_wrong(result: Disorder, runs: _Runs, wrong: Places, times: Floats) -> None:
    for k in wrong.tolist():
        first, last, place = int(runs.first[k]), int(runs.last[k]), int(runs.before[k])
        if first == last:
            result.wrong[_worse(runs, place, first, times)] = True
        elif last - first >= SHORT and 0 <= place < len(runs.kept) - 1:
            result.runs.append((first, last))
        else:
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
