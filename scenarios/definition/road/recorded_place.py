"""Places of points in their file, and their times in the recorded drive."""

import numpy as np

from scenarios.definition.schema.path_tables import PointsPath
from vehicles.geometry.sampled_path import FloatArray


def place_of(table: PointsPath, point: int) -> str:
    """Return the place of a point (from 0) in its file, and its time in the recorded drive."""
    number = table.source_numbers[point] if point < len(table.source_numbers) else point + 1
    at = f" ({recorded_times(table)[point]:.1f} s)" if table.time_s else ""
    return f"{table.source_unit} {number}{at}"


def recorded_times(table: PointsPath) -> FloatArray:
    """Return the times (s) of points since the start of the recorded drive, pauses included."""
    times = table.begin_s + np.asarray(table.time_s)
    if table.pauses == "cut":
        lost = np.zeros(times.size)
        lost[np.asarray(table.pause_points, dtype=np.int64) + 1] = table.pause_lost_s
        times += np.cumsum(lost)
    return times
