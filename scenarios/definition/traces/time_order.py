"""Times of a recorded drive that never run back."""

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scenarios.definition.traces.recorded_drive import (
    METRES_PER_DEGREE,
    NO_TIMES,
    WRONG_TIME,
    Floats,
    Mask,
    RecordedDrive,
)

LARGEST = 1e15
"""Largest time (s); larger ones are unusable."""

DAY = 86_400.0

LONGEST_PAUSE = 100 * DAY
"""Step in time (s) beyond which the clock was wrong; smaller ones are a drive of several days."""

COARSE = 1.5
"""Mean number of moving points of the same time from which on times are coarse."""

SHORT = 5
"""Largest number of successive records whose times are wrong; more of them follow a leap."""

FAR_OFF = 20.0
"""Distance of a time from the median of its neighbours, in usual intervals, that is a fault."""

MOST_WRONG = 0.25
"""Share of records of a wrong time above which times are unusable."""

MOST_LEAPS = 0.1
"""Share of records with a leap of the clock above which times are unusable."""

SOURCES = 3
"""Largest number of sources that alternate in a file."""


def in_time_order(drive: RecordedDrive) -> RecordedDrive:
    """Return the drive with times that never decrease along its points, or without times.

    Records are sorted by time where that shortens the path. Wrong and missing times are
    interpolated, times after a leap of the clock are shifted.
    """
    times = np.where(np.abs(drive.time_s) <= LARGEST, drive.time_s, np.nan)
    reason = _unusable(times)
    if reason is not None:
        if bool(np.isnan(drive.time_s).all()):
            return drive
        return _untimed(drive, reason)
    steps = np.diff(times)
    if bool(((steps > 0.0) & (steps <= LONGEST_PAUSE)).all()):  # False for NaN, too
        return drive
    missing = int(np.isnan(times).sum())
    if missing:
        have = "record has" if missing == 1 else "records have"
        drive = drive.with_remarks(f"{missing} {have} no usable time: it is interpolated")
    drive = _without_duplicates(replace(drive, time_s=times))
    for find_wrong in (_far_off, _off_the_order):
        timed = np.flatnonzero(np.isfinite(drive.time_s))
        steps = np.diff(drive.time_s[timed])
        if bool(((steps < 0.0) | (steps > DAY)).any()):
            drive = _without_wrong(drive, timed[find_wrong(drive.time_s[timed])])
            drive = _sorted(drive)
    if np.isfinite(drive.time_s).any():
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


def _plane(drive: RecordedDrive) -> NDArray[np.complex128]:
    """Return positions (m) as east + i north, exact enough to compare distances."""
    first, second = drive.position
    if not drive.geodetic:
        return np.asarray(first + 1j * second)
    east = (second - second[0] + 180.0) % 360.0 - 180.0
    east *= np.cos(np.radians(np.median(first)))
    return np.asarray((east + 1j * first) * METRES_PER_DEGREE)


def _untimed(drive: RecordedDrive, reason: str) -> RecordedDrive:
    untimed = replace(drive, time_s=np.full(drive.count, np.nan), clock=None, zero_s=0.0)
    return untimed.with_remarks(f"{reason}: {NO_TIMES}") if reason else untimed


def _usual_interval(times: Floats) -> float:
    """Return the interval (s) of most records, of one of up to SOURCES that alternate; or 1."""
    intervals = []
    for apart in range(1, SOURCES + 1):
        steps = np.abs(times[apart:] - times[:-apart])
        steps = steps[(steps > 0.0) & (steps <= LONGEST_PAUSE)]
        if steps.size:
            intervals.append(float(np.quantile(steps, 0.4)))
    return min(intervals, default=1.0)


def _without_duplicates(drive: RecordedDrive) -> RecordedDrive:
    """Ignore records of the same time and position as an earlier one, or without time as it."""
    first, second = drive.position
    order = np.lexsort((second, first, drive.time_s))
    columns = np.vstack((np.nan_to_num(drive.time_s, nan=np.inf), drive.position))[:, order]
    repeated = np.zeros(drive.count, bool)
    repeated[order[1:][(columns[:, 1:] == columns[:, :-1]).all(axis=0)]] = True
    count = int(repeated.sum())
    if not count:
        return drive
    repeat = "record repeats" if count == 1 else "records repeat"
    remark = f"{count} {repeat} the time and position of an earlier one: ignored"
    return drive.selected(~repeated).with_remarks(remark)


def _sorted(drive: RecordedDrive) -> RecordedDrive:
    """Sort records by time if the path becomes no longer and keeps the usual interval.

    Laps on a clock that starts again are shorter, too, but have records at shorter intervals.
    """
    times, places = drive.time_s, _plane(drive)
    timed = np.flatnonzero(np.isfinite(times))
    order = timed[np.argsort(times[timed], kind="stable")]
    if order.size < 2 or np.array_equal(order, timed):
        return drive
    if np.median(np.diff(times[order])) < 0.6 * _usual_interval(times[timed]):
        return drive
    in_time, in_file = (float(np.abs(np.diff(places[one])).sum()) for one in (order, timed))
    if in_time > (1.0 + 1e-9) * in_file:
        return drive
    everywhere = np.arange(drive.count)
    everywhere[timed] = order
    remark = f"{int((order != timed).sum())} records are out of order and sorted by time"
    return drive.selected(everywhere).with_remarks(remark)


def _far_off(times: Floats) -> Mask:
    """Mark times far off those of three records on either side."""
    if times.size < 7:
        return np.zeros(times.size, bool)
    medians = np.median(sliding_window_view(np.pad(times, 3, mode="reflect"), 7), axis=1)
    return np.asarray(np.abs(times - medians) > FAR_OFF * _usual_interval(times))


def _off_the_order(times: Floats) -> Mask:
    """Mark the short runs of times off a longest sequence that never decreases."""
    off = ~_longest_order(times)
    edges = np.flatnonzero(np.diff(off, prepend=False, append=False))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        off[begin:end] = end - begin <= SHORT
    return off


def _longest_order(times: Floats) -> Mask:
    """Mark a longest subsequence that never decreases (patience sorting)."""
    ends: list[float] = []
    ended_by: list[int] = []
    previous: list[int] = []
    for k, time in enumerate(times.tolist()):
        pile = bisect_right(ends, time)
        previous.append(ended_by[pile - 1] if pile else -1)
        ends[pile : pile + 1] = [time]
        ended_by[pile : pile + 1] = [k]
    marked = np.zeros(times.size, bool)
    k = ended_by[-1]
    while k >= 0:
        marked[k] = True
        k = previous[k]
    return marked


def _without_wrong(drive: RecordedDrive, wrong: NDArray[np.int64]) -> RecordedDrive:
    if wrong.size > MOST_WRONG * drive.count:
        return _untimed(drive, f"time runs back at {wrong.size} of {drive.count} points")
    for k in wrong.tolist():
        drive.list_fault(k, WRONG_TIME, "its time is wrong and is interpolated")
    times = drive.time_s.copy()
    times[wrong] = np.nan
    return replace(drive, time_s=times)


def _with_one_clock(drive: RecordedDrive) -> RecordedDrive:
    """Shift the times after leaps of the clock; the longest part keeps its times."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times = drive.time_s[timed]
    steps = np.diff(times)
    leaps = np.flatnonzero((steps < 0.0) | (steps > LONGEST_PAUSE))
    if not leaps.size:
        return drive
    if leaps.size > max(SHORT, MOST_LEAPS * times.size):
        return _untimed(drive, f"time runs back at {leaps.size} of {times.size} points")
    bounds = np.concatenate(([0], leaps + 1, [times.size]))
    offsets = np.concatenate(([0.0], np.cumsum(_usual_interval(times) - steps[leaps])))
    offsets -= offsets[np.argmax(np.diff(bounds))]
    column = drive.time_s.copy()
    column[timed] = times + np.repeat(offsets, np.diff(bounds))
    remarks = [
        f"{drive.unit} {drive.numbers[timed[k + 1]]}: the clock leaps by {steps[k]:+.6g} s: "
        "times are shifted"
        for k in leaps.tolist()
    ]
    return replace(drive, time_s=column).with_remarks(*remarks)


def _filled(drive: RecordedDrive) -> RecordedDrive:
    """Interpolate missing times: by number if the records keep the usual rate, or by distance."""
    known = np.isfinite(drive.time_s)
    missing = np.flatnonzero(~known)
    if not missing.size:
        return drive
    timed = np.flatnonzero(known)
    times = drive.time_s[timed]
    usual = _usual_interval(times)
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
