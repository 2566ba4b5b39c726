"""Times of a recorded drive that never run back."""

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scenarios.definition.traces.drive import NO_TIMES, WRONG_TIME, DriveTable, Floats, Mask
from vehicles.geometry.bridges import step_lengths

LARGEST = 1e15
"""Largest time (s); larger ones are unusable."""

LONGEST_PAUSE = 100 * 86_400.0
"""Step in time (s) beyond which the clock was wrong; smaller ones are a drive of several days."""

FAR_OFF = 20.0
"""Distance of a time from the median of its neighbours, in usual intervals, that is a fault."""

WRONG_MAX, LEAPS_MAX, FEW_LEAPS = 0.25, 0.1, 5
"""Shares of records with a wrong time, and with a leap of the clock, above which times are
unusable; up to FEW_LEAPS are always usable."""


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
    drive = _without_duplicates(replace(drive, time_s=times))
    for step in (_without_far_times, _sorted, _with_one_clock, _filled, _spread):
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
    """Return the interval (s) of most records; 1 if no two times differ."""
    steps = np.abs(np.diff(times))
    steps = steps[(steps > 0.0) & (steps <= LONGEST_PAUSE)]
    return float(np.quantile(steps, 0.4)) if steps.size else 1.0


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


def _without_far_times(drive: DriveTable) -> DriveTable:
    """Remove times far off those of three records on either side, if times run back or leap."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times = drive.time_s[timed]
    if timed.size < 7 or not _leaps(times).any():
        return drive
    medians = np.median(sliding_window_view(np.pad(times, 3, mode="reflect"), 7), axis=1)
    wrong = timed[np.abs(times - medians) > FAR_OFF * _usual_interval(times)]
    if wrong.size > WRONG_MAX * drive.count:
        return drive
    for k in wrong.tolist():
        drive.list_fault(k, WRONG_TIME, "its time is wrong and is interpolated")
    column = drive.time_s.copy()
    column[wrong] = np.nan
    return replace(drive, time_s=column)


def _leaps(times: Floats) -> Mask:
    steps = np.diff(times)
    return np.asarray((steps < 0.0) | (steps > LONGEST_PAUSE))


def _sorted(drive: DriveTable) -> DriveTable:
    """Sort records by time if the path becomes no longer and keeps the usual interval.

    Laps on a clock that starts again are shorter, too, but have records at shorter intervals.
    """
    times, points = drive.time_s, drive.plane_m
    timed = np.flatnonzero(np.isfinite(times))
    order = timed[np.argsort(times[timed], kind="stable")]
    if np.array_equal(order, timed):
        return drive
    in_time, in_file = (float(step_lengths(points[:, one]).sum()) for one in (order, timed))
    interval = np.median(np.diff(times[order]))
    if in_time > (1.0 + 1e-9) * in_file or interval < 0.6 * _usual_interval(times[timed]):
        return drive
    everywhere = np.arange(drive.count)
    everywhere[timed] = order
    remark = f"{int((order != timed).sum())} records are out of order and sorted by time"
    return drive.selected(everywhere).with_remarks(remark)


def _with_one_clock(drive: DriveTable) -> DriveTable:
    """Shift the times after leaps of the clock; the longest part keeps its times."""
    timed = np.flatnonzero(np.isfinite(drive.time_s))
    times = drive.time_s[timed]
    leaps = np.flatnonzero(_leaps(times))
    if not leaps.size:
        return drive
    if leaps.size > max(FEW_LEAPS, LEAPS_MAX * times.size):
        return _untimed(drive, f"time runs back at {leaps.size} of {times.size} points")
    steps = np.diff(times)[leaps]
    sizes = np.diff(np.concatenate(([0], leaps + 1, [times.size])))
    offsets = np.concatenate(([0.0], np.cumsum(_usual_interval(times) - steps)))
    column = drive.time_s.copy()
    column[timed] = times + np.repeat(offsets - offsets[np.argmax(sizes)], sizes)
    remarks = [
        f"{drive.unit} {drive.numbers[timed[k + 1]]}: the clock leaps by {step:+.6g} s: "
        "times are shifted"
        for k, step in zip(leaps.tolist(), steps.tolist(), strict=True)
    ]
    return replace(drive, time_s=column).with_remarks(*remarks)


def _filled(drive: DriveTable) -> DriveTable:
    """Interpolate missing times by the number of the record."""
    timed, every = np.flatnonzero(np.isfinite(drive.time_s)), np.arange(drive.count)
    missing = drive.count - timed.size - drive.left_out.counts[WRONG_TIME]
    if missing > 0:
        have = "record has" if missing == 1 else "records have"
        drive = drive.with_remarks(f"{missing} {have} no usable time: it is interpolated")
    beyond = np.minimum(every - timed[0], 0) + np.maximum(every - timed[-1], 0)
    column = np.interp(every, timed, drive.time_s[timed])
    return replace(drive, time_s=column + _usual_interval(drive.time_s[timed]) * beyond)


def _spread(drive: DriveTable) -> DriveTable:
    """Spread points of the same time evenly up to the next time."""
    times = drive.time_s
    starts = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0.0)
    count = times.size - starts.size
    if not count:
        return drive
    sizes, values = np.diff(starts, append=times.size), times[starts]
    usual = float(np.median(np.diff(values))) if values.size > 1 else 1.0
    spans = np.minimum(np.diff(values, append=values[-1] + usual), usual)
    # The first and the last time may have begun or ended in its middle.
    interval = spans / sizes
    interval[[0, -1]] = np.minimum(interval[[0, -1]], usual / float(np.median(sizes)))
    values[0] += max(0.0, spans[0] - interval[0] * sizes[0])
    within = np.arange(times.size) - np.repeat(starts, sizes)
    column = np.maximum.accumulate(np.repeat(values, sizes) + within * np.repeat(interval, sizes))
    have = "point has" if count == 1 else "points have"
    remark = f"{count} {have} the same time as the point before: spread evenly up to the next"
    return replace(drive, time_s=column).with_remarks(remark)
