"""Times of a recorded drive that never run back."""

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scenarios.definition.traces.drive import (
    NO_TIMES,
    WRONG_TIME,
    DriveTable,
    Floats,
    Ints,
    Mask,
    runs_of,
)
from vehicles.geometry.bridges import step_lengths

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

WRONG_MAX, LEAPS_MAX = 0.25, 0.1
"""Shares of records with a wrong time, and with a leap of the clock, above which times are
unusable."""

SOURCES = 3
"""Largest number of sources that alternate in a file."""


def in_time_order(drive: DriveTable) -> DriveTable:
    """Return the drive with times that never decrease along its points, or without times.

    Records are sorted by time where that shortens the path. Wrong and missing times are
    interpolated, times after a leap of the clock are shifted.
    """
    times = np.where(np.abs(drive.time_s) <= LARGEST, drive.time_s, np.nan)
    if reason := _unusable(times):
        return drive if bool(np.isnan(drive.time_s).all()) else _untimed(drive, reason)
    steps = np.diff(times)
    if bool(((steps > 0.0) & (steps <= LONGEST_PAUSE)).all()):  # False for NaN, too
        return drive
    if missing := int(np.isnan(times).sum()):
        have = "record has" if missing == 1 else "records have"
        drive = drive.with_remarks(f"{missing} {have} no usable time: it is interpolated")
    drive = _without_duplicates(replace(drive, time_s=times))
    for find_wrong in (_far_off, _off_the_order):
        timed = np.flatnonzero(np.isfinite(drive.time_s))
        steps = np.diff(drive.time_s[timed])
        if bool(((steps < 0.0) | (steps > DAY)).any()):
            drive = _without_wrong(drive, timed[find_wrong(drive.time_s[timed])])
            drive = _sorted(drive)
    for step in (_with_one_clock, _filled, _spread):
        if np.isfinite(drive.time_s).any():
            drive = step(drive)
    return drive


def _unusable(times: Floats) -> str:
    """Return why a drive with these times has none, "" if it has."""
    known = times[np.isfinite(times)]
    count = known.size
    if 2 * count < times.size or count < 2:
        return f"only {count} of {times.size} points {'has' if count == 1 else 'have'} a time"
    if not np.ptp(known):
        return f"all {count} points have the same time"
    if count > 10 and not ((known > known.min()) & (known < known.max())).any():
        return f"{count} points have only 2 different times"
    return ""


def _untimed(drive: DriveTable, reason: str) -> DriveTable:
    untimed = replace(drive, time_s=np.full(drive.count, np.nan), clock=None, zero_s=0.0)
    return untimed.with_remarks(f"{reason}: {NO_TIMES}")


def _usual_interval(times: Floats) -> float:
    """Return the interval (s) of most records, of one of up to SOURCES that alternate; or 1."""
    intervals = []
    for apart in range(1, SOURCES + 1):
        steps = np.abs(times[apart:] - times[:-apart])
        steps = steps[(steps > 0.0) & (steps <= LONGEST_PAUSE)]
        intervals += [float(np.quantile(steps, 0.4))] if steps.size else []
    return min(intervals, default=1.0)


def _without_duplicates(drive: DriveTable) -> DriveTable:
    """Ignore records of the same time and position as an earlier one, or without time as it."""
    columns = np.vstack((np.nan_to_num(drive.time_s, nan=np.inf), drive.position))
    order = np.lexsort(columns[::-1])
    repeated = np.zeros(drive.count, bool)
    repeated[order[1:][(columns[:, order[1:]] == columns[:, order[:-1]]).all(axis=0)]] = True
    count = int(repeated.sum())
    if not count:
        return drive
    repeat = "record repeats" if count == 1 else "records repeat"
    remark = f"{count} {repeat} the time and position of an earlier one: ignored"
    return drive.selected(~repeated).with_remarks(remark)


def _sorted(drive: DriveTable) -> DriveTable:
    """Sort records by time if the path becomes no longer and keeps the usual interval.

    Laps on a clock that starts again are shorter, too, but have records at shorter intervals.
    """
    times, points = drive.time_s, drive.plane_m
    timed = np.flatnonzero(np.isfinite(times))
    order = timed[np.argsort(times[timed], kind="stable")]
    if order.size < 2 or np.array_equal(order, timed):
        return drive
    if np.median(np.diff(times[order])) < 0.6 * _usual_interval(times[timed]):
        return drive
    in_time, in_file = (float(step_lengths(points[:, one]).sum()) for one in (order, timed))
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
    """Mark the short runs of times off a longest sequence that never decreases (by patience)."""
    ends: list[float] = []
    ended_by: list[int] = []
    previous: list[int] = []
    for k, time in enumerate(times.tolist()):
        pile = bisect_right(ends, time)
        previous.append(ended_by[pile - 1] if pile else -1)
        ends[pile : pile + 1] = [time]
        ended_by[pile : pile + 1] = [k]
    off = np.ones(times.size, bool)
    k = ended_by[-1]
    while k >= 0:
        off[k] = False
        k = previous[k]
    for begin, end in runs_of(off):
        off[begin : end + 1] = end - begin < SHORT
    return off


def _without_wrong(drive: DriveTable, wrong: Ints) -> DriveTable:
    if wrong.size > WRONG_MAX * drive.count:
        return _untimed(drive, f"time runs back at {wrong.size} of {drive.count} points")
    for k in wrong.tolist():
        drive.list_fault(k, WRONG_TIME, "its time is wrong and is interpolated")
    times = drive.time_s.copy()
    times[wrong] = np.nan
    return replace(drive, time_s=times)


def _with_one_clock(drive: DriveTable) -> DriveTable:
    """Shift the times after leaps of the clock; the longest part keeps its times."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times = drive.time_s[timed]
    steps = np.diff(times)
    leaps = np.flatnonzero((steps < 0.0) | (steps > LONGEST_PAUSE))
    if not leaps.size:
        return drive
    if leaps.size > max(SHORT, LEAPS_MAX * times.size):
        return _untimed(drive, f"time runs back at {leaps.size} of {times.size} points")
    sizes = np.diff(np.concatenate(([0], leaps + 1, [times.size])))
    offsets = np.concatenate(([0.0], np.cumsum(_usual_interval(times) - steps[leaps])))
    offsets -= offsets[np.argmax(sizes)]
    column = drive.time_s.copy()
    column[timed] = times + np.repeat(offsets, sizes)
    remarks = [
        f"{drive.unit} {drive.numbers[timed[k + 1]]}: the clock leaps by {steps[k]:+.6g} s: "
        "times are shifted"
        for k in leaps.tolist()
    ]
    return replace(drive, time_s=column).with_remarks(*remarks)


def _filled(drive: DriveTable) -> DriveTable:
    """Interpolate missing times: by number if the records keep the usual rate, or by distance."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times, every = drive.time_s[timed], np.arange(drive.count)
    usual = _usual_interval(times)
    along = np.concatenate(([0.0], np.cumsum(step_lengths(drive.plane_m))))
    low = timed[np.clip(np.searchsorted(timed, every, side="right") - 1, 0, timed.size - 1)]
    high = timed[np.clip(np.searchsorted(timed, every), 0, timed.size - 1)]
    span = drive.time_s[high] - drive.time_s[low]
    steady = (np.abs((high - low) * usual - span) <= 0.2 * span) | (along[high] <= along[low])
    by_number = np.interp(every, timed, times)
    column = np.where(steady, by_number, np.interp(along, along[timed], times))
    column += usual * (np.minimum(every - timed[0], 0) + np.maximum(every - timed[-1], 0))
    return replace(drive, time_s=np.where(np.isfinite(drive.time_s), drive.time_s, column))


def _spread(drive: DriveTable) -> DriveTable:
    """Spread points of the same time evenly up to the next time."""
    times = drive.time_s
    starts = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0.0)
    sizes = np.diff(starts, append=times.size)
    if starts.size == times.size:
        return drive
    moves = np.append(np.diff(drive.plane_m[:, starts]).any(axis=0), True)
    mean, values = float(sizes[moves].mean()), times[starts]
    usual = float(np.median(np.diff(values))) if values.size > 1 else 1.0
    spans = np.minimum(np.diff(values, append=values[-1] + usual), usual)
    interval = spans / sizes
    if mean >= COARSE:  # the first and the last time may have begun or ended in its middle
        typical = usual / float(np.median(sizes[moves]))
        interval[[0, -1]] = np.minimum(interval[[0, -1]], typical)
        values[0] += max(0.0, spans[0] - interval[0] * sizes[0])
    within = np.arange(times.size) - np.repeat(starts, sizes)
    column = np.maximum.accumulate(np.repeat(values, sizes) + within * np.repeat(interval, sizes))
    count = times.size - starts.size
    have = "point has" if count == 1 else "points have"
    remark = f"{count} {have} the time of the point before: spread evenly up to the next"
    if mean >= COARSE:
        remark = f"{mean:.3g} points have the same time on average: spread evenly over {usual:g} s"
    return replace(drive, time_s=column).with_remarks(remark)
