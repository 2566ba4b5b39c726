"""Edges of a lane along a path, and simplified paths, for pictures."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]  # East and north (m), a row per point


def simplified(
    east: ArrayLike, north: ArrayLike, turn: float = 0.05, spacing: float = 20.0
) -> Points:
    """Drop points of a path (m) between which it turns by less than `turn` (rad).

    Remaining points are at most `spacing` (m) and one step of the original ones apart.
    """
    points = np.column_stack([east, north]).astype(np.float64)
    dx, dy = np.diff(points, axis=0).T
    cells = np.cumsum(np.hypot(dx, dy)) // spacing, np.round(np.unwrap(np.arctan2(dy, dx)) / turn)
    kept = np.flatnonzero(np.any(np.diff(cells) != 0.0, axis=0)) + 1
    return points[[0, *kept.tolist(), -1]]


def lane_edges(points: Points, width: float) -> tuple[Points, Points]:
    """Left and right edge of a lane of `width` (m) centred on a path."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    left = 0.5 * width * np.column_stack([-along[:, 1], along[:, 0]])
    return points + left, points - left
