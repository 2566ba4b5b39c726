"""Times of a recorded drive that never run back."""

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.disorder import (
    LEAP,
    MOST_LEAPS,
    SHORT,
    Complex,
    disorder_of,
    excursions_of,
    is_shuffled,
    longest_order,
    usual_interval,
)
from scenarios.definition.traces.recorded_drive import (
    METRES_PER_DEGREE,
    NO_TIMES,
    WRONG_TIME,
    Floats,
    Mask,
    RecordedDrive,
)

HOUR, DAY = 3600.0, 86_400.0

LARGEST = 1e15
"""Largest time (s); larger ones are unusable."""

MOST_LEAPING = 0.25
"""Largest share of points before or after the drive that are left out for their time."""

LONGEST_PAUSE = 100 * DAY
"""Step in time (s) beyond which the clock was wrong; smaller ones are a drive of several days."""

COARSE = 1.5
"""Mean number of moving points of the same time from which on times are coarse."""

MOST_REMARKED = 5
"""Number of leaps of the clock that are stated in full."""

SLOWEST = 0.5
"""Speed (m/s) below which a distance does not show how long a step takes."""

MOST_DAYS_IN_SECONDS = 3.0
"""Number of days above which messages state times in days."""


def in_time_order(drive: RecordedDrive) -> RecordedDrive:
    """Return the drive with times that never decrease along its points, or without times.

    Positions decide: records out of order are sorted, wrong and missing times are interpolated,
    times after a leap of the clock are shifted. Only records on another clock before or after the
    drive are left out.
    """
    times = np.where(np.abs(drive.time_s) <= LARGEST, drive.time_s, np.nan)
    reason = _unusable(times)
    if reason is not None:
        if bool(np.isnan(drive.time_s).all()):
            return drive
        return _untimed(drive, reason)
    steps = np.diff(times)
    if bool(((steps > 0.0) & (steps <= LEAP)).all()):  # False for NaN, too
        return drive
    missing = int(np.isnan(times).sum())
    if missing:
        have = "record has" if missing == 1 else "records have"
        drive = drive.with_remarks(f"{missing} {have} no usable time: it is interpolated")
    drive = _without_other_clocks(replace(drive, time_s=times))
    drive = _sorted(_without_duplicates(drive))
    drive = _with_one_clock(drive)
    if not np.isfinite(drive.time_s).any():
        return drive
    return _spread(_filled(drive))


def _unusable(times: Floats) -> str | None:
    """Return why a drive with these times has none, "" if it never had, None if it has."""
    timed = int(np.isfinite(times).sum())
    if timed == 0:
        return ""
    if 2 * timed < len(times):
        return f"only {timed} of {len(times)} points have a time"
    if timed == 1:
        return "" if len(times) == 1 else "only 1 point has a time"
    first, last = np.nanmin(times), np.nanmax(times)
    if first == last:
        return f"all {timed} points have the same time"
    between = (times > first) & (times < last)
    if timed > 2 * 5 and not between.any():
        return f"{timed} points have only 2 different times"
    return None


def _plane(drive: RecordedDrive) -> Complex:
    """Return positions (m) as east + i north, exact enough to compare distances."""
    first, second = drive.position
    if not drive.geodetic:
        return np.asarray(first + 1j * second)
    east = (second - second[0] + 180.0) % 360.0 - 180.0
    east *= np.cos(np.radians(np.median(first)))
    return np.asarray((east + 1j * first) * METRES_PER_DEGREE)


def _where(drive: RecordedDrive, k: int) -> str:
    return f"{drive.unit} {drive.numbers[k]}"


def _span(seconds: float) -> str:
    days = seconds / DAY
    return f"{seconds:.6g} s" if days < MOST_DAYS_IN_SECONDS else f"{days:.6g} days"


def _signed(seconds: float) -> str:
    return ("+" if seconds > 0.0 else "-") + _span(abs(seconds))


def _untimed(drive: RecordedDrive, reason: str) -> RecordedDrive:
    untimed = replace(drive, time_s=np.full(drive.count, np.nan), clock=None, zero_s=0.0)
    return untimed.with_remarks(f"{reason}: {NO_TIMES}") if reason else untimed


# ---- Records that are left out or moved


def _without_other_clocks(drive: RecordedDrive) -> RecordedDrive:
    """Leave out the few records before or after the drive that are more than LEAP off."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times = drive.time_s[timed]
    edges = np.flatnonzero(np.abs(np.diff(times)) > LEAP / 2.0) + 1
    if not edges.size:
        return drive
    starts = np.concatenate(([0], edges))
    ends = np.concatenate((edges, [len(times)]))
    longest = int(np.argmax(ends - starts))
    first, last = int(starts[longest]), int(ends[longest]) - 1
    for most_back in (LEAP / 2.0, LEAP):  # a part a day back may be an excursion or a leap
        for start, end in zip(starts[::-1].tolist(), ends[::-1].tolist(), strict=True):
            if end <= first and -most_back <= times[first] - times[end - 1] <= LEAP:
                first = start
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            if start > last and -most_back <= times[start] - times[last] <= LEAP:
                last = end - 1
    marked = np.zeros(drive.count, bool)
    marked[timed[:first]] = True
    marked[timed[last + 1 :]] = True
    if marked.sum() > MOST_LEAPING * drive.count:
        return drive

    def reason(k: int) -> str:
        at = float(drive.time_s[k])
        nearest = min((times[first], times[last]), key=lambda other: abs(other - at))
        side = "after the last" if at > nearest else "before the first"
        return f"its time is {_span(abs(at - nearest))} {side} of the drive"

    return drive.without(marked, "wrong time", reason)


def _without_duplicates(drive: RecordedDrive) -> RecordedDrive:
    """Ignore records of the same time and position as an earlier one, or without time as it."""
    first, second = drive.position
    times = drive.time_s
    if bool((np.diff(times) >= 0.0).all()):
        repeated = np.zeros(drive.count, bool)
        repeated[1:] = (np.diff(times) == 0.0) & ~np.diff(drive.position).any(axis=0)
    else:
        order = np.lexsort((second, first, times))
        columns = np.vstack((np.nan_to_num(times, nan=np.inf), drive.position))[:, order]
        same = (columns[:, 1:] == columns[:, :-1]).all(axis=0)
        repeated = np.zeros(drive.count, bool)
        repeated[order[1:][same]] = True
    count = int(repeated.sum())
    if not count:
        return drive
    repeat = "record repeats" if count == 1 else "records repeat"
    remark = f"{count} {repeat} the time and position of an earlier one: ignored"
    return drive.selected(~repeated).with_remarks(remark)


def _sorted(drive: RecordedDrive) -> RecordedDrive:
    """Remove wrong times, and sort records that are out of order."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    if bool((np.diff(drive.time_s[timed]) >= 0.0).all()):
        return drive
    if timed.size == drive.count and is_shuffled(drive.time_s, _plane(drive)):
        count = drive.count - int(longest_order(drive.time_s, bisect_right).sum())
        remark = f"{count} records are out of order and sorted by time"
        return drive.selected(np.argsort(drive.time_s, kind="stable")).with_remarks(remark)
    usual = usual_interval(drive.time_s[timed])
    right = drive.time_s.copy()
    excursions = excursions_of(right[timed], _plane(drive)[timed], timed, usual)
    remarks = _without_excursions(drive, right, timed, excursions)
    timed = np.flatnonzero(np.isfinite(right))
    disorder = disorder_of(right[timed], _plane(drive)[timed], timed, usual)
    right[timed[disorder.wrong]] = np.nan
    remarks += _without_excursions(drive, right, timed, disorder.runs)
    remarks = _limited(remarks)
    _list_wrong(drive, right)
    key = np.arange(drive.count, dtype=float)
    moved = disorder.key % 1.0 != 0.0
    key[timed[moved]] = timed[np.floor(disorder.key[moved]).astype(int)] + 0.5
    key[timed[disorder.key < 0.0]] = -0.5
    order = np.lexsort((right, key))
    count = int((moved & (disorder.key != np.arange(len(timed)) - 0.5)).sum())
    if count:
        verb = "record is" if count == 1 else "records are"
        remarks.append(f"{count} {verb} out of order and sorted by time")
    drive = replace(drive, time_s=right).with_remarks(*remarks)
    return drive.selected(order) if count else drive


def _without_excursions(
    drive: RecordedDrive, right: Floats, timed: NDArray[np.int64], runs: list[tuple[int, int]]
) -> list[str]:
    """Shift long runs of `right` times between their neighbours, and remove short ones."""
    remarks = []
    for first, last in runs:
        run = timed[first : last + 1]
        times = right[run]
        before, after = right[timed[[first - 1, last + 1]]].tolist()
        spare = after - before - float(times[-1] - times[0])
        if run.size <= SHORT or not (spare >= 0.0 and bool((np.diff(times) >= 0.0).all())):
            right[run] = np.nan
            continue
        shift = before + spare / 2.0 - float(times[0])
        right[run] += shift
        remarks.append(
            f"{_where(drive, int(run[0]))}: the clock is {_signed(-shift)} off for {run.size} "
            "records: their times are shifted"
        )
    return remarks


def _list_wrong(drive: RecordedDrive, right: Floats) -> None:
    wrong = np.flatnonzero(np.isfinite(drive.time_s) & np.isnan(right))
    usable = np.flatnonzero(np.isfinite(right))
    expected = np.interp(wrong, usable, right[usable])
    filled = right.copy()
    filled[wrong] = expected
    corrected = replace(drive, time_s=filled)
    for k, off in zip(wrong.tolist(), (drive.time_s[wrong] - expected).tolist(), strict=True):
        reason = f"its time is {_signed(off)} off and is interpolated"
        corrected.list_fault(k, WRONG_TIME, reason)


# ---- Leaps of the clock


def _with_one_clock(drive: RecordedDrive) -> RecordedDrive:
    """Shift the times after leaps of the clock; the longest part keeps its times."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times, places = drive.time_s[timed], _plane(drive)[timed]
    usual = usual_interval(times)
    steps, distances = np.diff(times), np.abs(np.diff(places))
    leaps = np.flatnonzero((steps < 0.0) | (steps > LONGEST_PAUSE) | _stops(steps, distances))
    if not leaps.size:
        return drive
    if leaps.size > max(MOST_REMARKED, MOST_LEAPS * len(times)):
        return _untimed(drive, f"time runs back at {leaps.size} of {len(times)} points")
    steady = np.abs(steps) <= 10.0 * usual
    steady[leaps] = False
    shifts = np.array([_shift(k, steady, steps, distances, usual) for k in leaps.tolist()])
    bounds = np.concatenate(([0], leaps + 1, [len(times)]))
    main = int(np.argmax(np.diff(bounds)))
    offsets = np.concatenate(([0.0], np.cumsum(shifts)))
    offsets -= offsets[main]
    column = drive.time_s.copy()
    column[timed] = times + np.repeat(offsets, np.diff(bounds))
    remarks = [
        f"{_where(drive, int(timed[k + 1]))}: the clock leaps by {_signed(-shift)}: times "
        f"{'before' if part < main else 'after'} it are shifted"
        for part, (k, shift) in enumerate(zip(leaps.tolist(), shifts.tolist(), strict=True))
    ]
    return replace(drive, time_s=column).with_remarks(*_limited(remarks))


def _stops(steps: Floats, distances: Floats) -> Mask:
    """Mark the one or two usual steps of a drive that take no time although their neighbours do."""
    marked = (steps == 0.0) & (distances > 0.0)
    if not 0 < int(marked.sum()) <= 2:
        return np.zeros(len(steps), bool)
    positive = steps[steps > 0.0]
    usual = float(np.median(positive)) if positive.size else 1.0
    following = np.concatenate((steps[1:], [usual]))
    pace = float(np.median(distances[steps > 0.0])) if positive.size else 0.0
    is_usual = (distances > 0.5 * pace) & (distances < 3.0 * pace)  # further: a wrong position
    return np.asarray(marked & (following < 1.5 * usual) & is_usual)


def _shift(k: int, steady: Mask, steps: Floats, distances: Floats, usual: float) -> float:
    """Return what to add to the times after leap `k`, in whole hours if these fit."""
    near = np.arange(max(0, k - 5), min(len(steps), k + 6))
    near = near[steady[near]]
    span = float(steps[near].sum())
    speed = float(distances[near].sum()) / span if span > 0.0 else 0.0
    expected = max(usual, float(distances[k]) / speed) if speed > SLOWEST else usual
    shift = expected - float(steps[k])
    hours = HOUR * round(shift / HOUR)
    if hours and 0.5 * usual <= steps[k] + hours <= 2.0 * expected:
        return float(hours)
    return shift


def _limited(remarks: list[str]) -> list[str]:
    more = len(remarks) - MOST_REMARKED
    last = [f"the clock leaps at {more} more places"] if more > 0 else []
    return [*remarks[:MOST_REMARKED], *last]


# ---- Missing and coarse times


def _filled(drive: RecordedDrive) -> RecordedDrive:
    """Interpolate missing times: by number if the records keep the usual rate, or by distance."""
    known = np.isfinite(drive.time_s)
    missing = np.flatnonzero(~known)
    if not missing.size:
        return drive
    timed = np.flatnonzero(known)
    times = drive.time_s[timed]
    usual = usual_interval(times)
    column = drive.time_s.copy()
    place = np.searchsorted(timed, missing)
    early, late = missing[place == 0], missing[place == len(timed)]
    column[early] = times[0] - (timed[0] - early) * usual
    column[late] = times[-1] + (late - timed[-1]) * usual
    inside = (place > 0) & (place < len(timed))
    k, after = missing[inside], place[inside]
    low, high = timed[after - 1], timed[after]
    span = drive.time_s[high] - drive.time_s[low]
    travelled = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(_plane(drive))))))
    path = travelled[high] - travelled[low]
    steady = (np.abs((high - low) * usual - span) <= 0.2 * span) | (path <= 0.0)
    by_distance = (travelled[k] - travelled[low]) / np.where(path > 0.0, path, 1.0)
    ratio = np.where(steady, (k - low) / (high - low), by_distance)
    column[k] = drive.time_s[low] + ratio * span
    return replace(drive, time_s=column)


def _spread(drive: RecordedDrive) -> RecordedDrive:
    """Spread points of the same time evenly up to the next time."""
    times = drive.time_s
    starts = np.flatnonzero(np.concatenate(([True], np.diff(times) > 0.0)))
    sizes = np.diff(np.concatenate((starts, [len(times)])))
    if len(starts) == len(times):
        return drive
    moves = np.abs(np.diff(_plane(drive)[starts], append=np.nan)) != 0.0
    mean = float(sizes[moves].mean())
    values = times[starts]
    usual = float(np.median(np.diff(values))) if len(values) > 1 else 1.0
    spans = np.minimum(np.diff(values, append=values[-1] + usual), usual)
    interval = spans / sizes
    if mean >= COARSE:  # the first and the last time may have begun or ended in its middle
        typical = usual / float(np.median(sizes[moves]))
        interval[[0, -1]] = np.minimum(interval[[0, -1]], typical)
        values = values.copy()
        values[0] += max(0.0, spans[0] - interval[0] * sizes[0])
    within = np.arange(len(times)) - np.repeat(starts, sizes)
    column = np.repeat(values, sizes) + within * np.repeat(interval, sizes)
    column = np.maximum.accumulate(column)
    count = len(times) - len(starts)
    have = "point has" if count == 1 else "points have"
    remark = f"{count} {have} the time of the point before: spread evenly up to the next"
    if mean >= COARSE:
        remark = f"{mean:.3g} points have the same time on average: spread evenly over {usual:g} s"
    return replace(drive, time_s=column).with_remarks(remark)
