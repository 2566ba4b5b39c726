"""Silences of a record: what the lead does where a recorded drive has no points for a while."""

import math
from collections.abc import Sequence

import numpy as np

from vehicles.geometry.sampled_path import FloatArray

RECORDED_STEP = 0.2
"""Time step (s) between the knots of a recorded speed."""

SILENCE, SILENT_INTERVALS = 2.0, 4.0
"""A silence in a record is longer than this (s) and than this number of usual intervals."""

LONG_SILENCE = 60.0
"""Interval (s) of points above which its middle has no knots."""

SILENT_BRAKING, SILENT_ACCELERATION = 2.5, 1.5
"""Assumed braking and acceleration (m/s²) of a car that was slower during a silence."""

CRAWLING = 1.0
"""Speed (m/s) below which a car is assumed to stand for a part of a silence."""

LONG_STOP, UNSTOPPED = 10.0, 3.0
"""Shortest silence (s) that is a stop if the car hardly moved in it, and the speed (m/s) next to it
above which its braking and acceleration were not recorded."""

FARTHEST = 500.0
"""Distance (m) within which the car brakes or accelerates."""


def with_silences(
    t: FloatArray, distance: FloatArray, silent: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Insert instants into silences in which the car slowed down, each given by its first point.

    Around a silence at speed in which the car hardly moved it brakes before and accelerates after.
    """
    t = t.copy()

    def speed(begin: float, end: float) -> float:
        here, there = np.interp((begin, end), t, distance).tolist()
        return (there - here) / (end - begin) if end > begin else 0.0

    times, places = [t], [distance]
    for k in silent:
        begin, end = t[k : k + 2].tolist()
        first = speed(max(begin - SILENCE, float(t[0])), begin)
        last = speed(end, min(end + SILENCE, float(t[-1])))
        driven = float(distance[k + 1] - distance[k])
        if (
            end - begin >= LONG_STOP
            and max(first, last) > UNSTOPPED
            and driven < UNSTOPPED * SILENCE
        ):
            _stop(t, distance, k)
            continue
        since, covered = _slowed_down(end - begin, driven, first, last)
        times.append(begin + since)
        places.append(distance[k] + covered)
    at = np.concatenate(times)
    order = np.argsort(at, kind="stable")
    return at[order], np.concatenate(places)[order]


def _stop(t: FloatArray, distance: FloatArray, k: int) -> None:
    """Let the car brake to the point before silence k and accelerate from the one after.

    A recording that was paused at speed has no braking. The time it takes is that of the silence:
    nothing changes if that is too short.
    """
    before = slice(max(0, int(np.searchsorted(distance, distance[k] - FARTHEST))), k + 1)
    after = slice(k + 1, int(np.searchsorted(distance, distance[k + 1] + FARTHEST, "right")))
    braking = np.sqrt(2.0 / SILENT_BRAKING * (distance[k] - distance[before]))
    speeding = np.sqrt(2.0 / SILENT_ACCELERATION * (distance[after] - distance[k + 1]))
    stopped, started = t[before] + braking, t[after] - speeding
    last, first = int(np.argmax(stopped)), int(np.argmin(started))
    if stopped[last] >= started[first]:
        return
    t[before][last:] = stopped[last] - braking[last:]
    t[after][: first + 1] = started[first] + speeding[: first + 1]


def _slowed_down(
    span: float, driven: float, first: float, last: float
) -> tuple[FloatArray, FloatArray]:
    """Return instants (s) in a `span`, and the distance (m) of `driven` covered by then.

    The car brakes from `first` (m/s) to a speed that it holds, and accelerates to `last`. Instead
    of CRAWLING it brakes later and stands. Empty if it was not slower, or braked harder.
    """
    # With a held speed h: driven = h * spare + h² * change + ramps.
    spare = span - first / SILENT_BRAKING - last / SILENT_ACCELERATION
    change = 0.5 / SILENT_BRAKING + 0.5 / SILENT_ACCELERATION
    ramps = 0.5 * first**2 / SILENT_BRAKING + 0.5 * last**2 / SILENT_ACCELERATION
    if spare <= 0.0 or ramps > driven:
        return np.zeros(0), np.zeros(0)
    level = driven - ramps
    held = 2.0 * level / (spare + math.sqrt(spare**2 + 4.0 * change * level))
    on = 0.0
    if held >= min(first, last):
        return np.zeros(0), np.zeros(0)
    if 0.0 < held < CRAWLING and level <= first * spare:
        held, on = 0.0, level / first
    braking, speeding = (first - held) / SILENT_BRAKING, (last - held) / SILENT_ACCELERATION
    since = np.arange(RECORDED_STEP, span, RECORDED_STEP)
    if span > LONG_SILENCE:  # without the middle, where it holds its speed
        since = since[(since < on + braking + 1.0) | (since > span - speeding - 1.0)]
    slowing = np.maximum(on + braking - np.maximum(since, on), 0.0)
    before = first * np.minimum(since, on) + 0.5 * SILENT_BRAKING * (braking**2 - slowing**2)
    after = 0.5 * SILENT_ACCELERATION * np.maximum(since - (span - speeding), 0.0) ** 2
    return since, before + held * np.maximum(since - on, 0.0) + after
