"""Places of points in their file, and their times in the recorded drive."""

import numpy as np
from numpy.typing import ArrayLike

from scenarios.definition.schema.path_tables import PointsPath
from vehicles.geometry.sampled_path import FloatArray


def place_of(table: PointsPath, point: int) -> str:
    """Return the place of a point (from 0) in its file, and its time in the recorded drive."""
    number = table.source_numbers[point] if point < len(table.source_numbers) else point + 1
    at = f" ({_recorded_time(table, point):.1f} s)" if table.time_s else ""
    return f"{table.source_unit} {number}{at}"


def _recorded_time(table: PointsPath, point: int) -> float:
    time = table.begin_s + table.time_s[point]
    if table.pauses == "cut":
        time += float(time_lost([point], table.pause_points, table.pause_lost_s)[0])
    return time


def recorded_times(table: PointsPath) -> FloatArray:
    """Return the times (s) of points since the start of the recorded drive, pauses included."""
    times = table.begin_s + np.asarray(table.time_s)
    if table.pauses == "cut":
        times += time_lost(np.arange(times.size), table.pause_points, table.pause_lost_s)
    return times


def time_lost(points: ArrayLike, pause_points: ArrayLike, lost_s: ArrayLike) -> FloatArray:
    """Return the time (s) lost in pauses before each of `points`, given by their indices.

    A pause follows the point of the same place in `pause_points`, which increase.
    """
    lost = np.concatenate((np.zeros(1), np.cumsum(lost_s)))
    return np.asarray(lost[np.searchsorted(pause_points, points)])
