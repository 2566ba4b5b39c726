"""Edges of a lane along a path, and simplified paths, for pictures."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]  # East and north (m), a row per point


def simplified(
    east: ArrayLike, north: ArrayLike, turn: float = 0.05, spacing: float = 20.0
) -> Points:
    """Drop points of a path (m) between which it turns by less than `turn` (rad).

    Remaining points are at most `spacing` (m) apart, unless the original ones are further apart.
    """
    points = np.column_stack([east, north]).astype(np.float64)
    if len(points) < 3:
        return points
    steps = np.diff(points, axis=0)
    yaw = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])).tolist()
    length = np.hypot(steps[:, 0], steps[:, 1]).tolist()
    kept, distance = [0], 0.0
    for k in range(1, len(points) - 1):
        distance += length[k - 1]
        if distance + length[k] > spacing or abs(yaw[k] - yaw[kept[-1]]) > turn:
            kept.append(k)
            distance = 0.0
    return points[[*kept, len(points) - 1]]


def lane_edges(points: Points, width: float) -> tuple[Points, Points]:
    """Left and right edge of a lane of `width` (m) centred on a path."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    left = 0.5 * width * np.column_stack([-along[:, 1], along[:, 0]])
    return points + left, points - left
