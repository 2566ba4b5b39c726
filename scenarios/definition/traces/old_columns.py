"""Recorded speeds."""

import numpy as np

from scenarios.definition.traces.recorded_drive import Floats


def usable_speeds(
    speed_mps: Floats, time_s: Floats, points: Floats
) -> tuple[Floats | None, tuple[str, ...]]:
    known = np.flatnonzero(np.isfinite(speed_mps))
    if 2 * known.size <= points.shape[1]:
        return None, ()
    last = np.maximum(np.searchsorted(known, np.arange(points.shape[1]), side="right") - 1, 0)
    speeds = np.abs(speed_mps[known[last]])
    if speeds.any():
        return speeds, ()
    instead = "speeds follow from the times" if time_s.size else "speeds are ignored"
    return None, (f"every recorded speed is 0 while the position changes: {instead}",)
