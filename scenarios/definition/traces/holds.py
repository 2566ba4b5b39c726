"""Positions that a recorder repeats because it polls faster than the receiver measures."""

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.recorded_drive import Floats, RecordedDrive

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

MOST_SINGLE_QUANTA = 0.8
"""Share of changes by the resolution of the file above which its numbers are rounded motion."""


def without_repeats(drive: RecordedDrive) -> tuple[RecordedDrive, float]:
    """Return the distinct points of a drive whose recorder repeats positions.

    Each keeps the time at which it appeared, a standstill also that of its last record. The second
    value is the uncertainty (s) of these times: the interval of the records, 0 for a drive without
    repeats, which is returned as it is.
    """
    steps = np.diff(drive.position)
    changes = np.concatenate(([True], (steps != 0.0).any(axis=0)))
    starts = np.flatnonzero(changes)
    lengths = np.diff(np.concatenate((starts, [drive.count])))
    if len(starts) < FEWEST_RUNS or len(starts) == drive.count:
        return drive, 0.0
    timed = bool(np.isfinite(drive.time_s).all())
    lasts = starts + lengths - 1
    held = drive.time_s[lasts] - drive.time_s[starts] if timed else np.zeros(len(starts))
    short = lengths[held <= LONGEST_HOLD]
    if not _repeats(short) or _is_rounded(steps):
        return drive, 0.0
    interval = float(np.median(np.diff(drive.time_s))) if timed else 0.0
    usual = float(np.median(short))
    stands = lengths > STANDSTILL_HOLDS * usual
    if timed:
        stands &= held >= SHORTEST_STANDSTILL
    kept = np.sort(np.concatenate((starts, lasts[stands])))
    count = drive.count - len(kept)
    remark = f"every position is recorded {usual:.3g} times: {count} repeats are ignored"
    if interval > 0.0:
        rate = 1.0 / interval
        remark = (
            f"positions repeat: {rate / float(short.mean()):.2g} Hz in records of {rate:.3g} Hz, "
            f"{count} repeats are ignored"
        )
    return drive.selected(kept).with_remarks(remark), interval


def _repeats(lengths: NDArray[np.int64]) -> bool:
    """Whether most positions are repeated, and not a few of them at length."""
    if len(lengths) < FEWEST_RUNS:
        return False
    limited = np.minimum(lengths, 2.0 * float(np.median(lengths)) + 1.0)
    return bool(limited.mean() >= LEAST_REPEATED)


def _is_rounded(steps: Floats) -> bool:
    """Whether almost every change is one unit of the last digit: slow motion in coarse numbers.

    Such motion changes one axis at a time. Steady motion also has changes of one size, on both axes
    together or along one of them.
    """
    sizes = np.abs(steps)
    present = sizes > 0.0
    together = present.all(axis=0).sum() > MOST_SINGLE_QUANTA * present.any(axis=0).sum()
    if together or not present.any(axis=1).all():
        return False
    units = [
        float(row[some].min()) if some.any() else np.inf
        for row, some in zip(sizes, present, strict=True)
    ]
    largest = (sizes / np.array(units)[:, None]).max(axis=0)
    changed = largest[largest > 0.0]
    return float((changed < 1.5).mean()) > MOST_SINGLE_QUANTA
