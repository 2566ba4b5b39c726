"""Offsets of many points from a path: at once, by arrays, or one after the other along it."""


import numpy as np
from numpy.typing import ArrayLike, NDArray

from vehicles.geometry.sampled_path import WINDOW, FloatArray, SampledPath

_CHUNK = 8192  # points projected at once, to limit memory
_STEP = 50  # Points of a drive that are projected at once, a second of it at 50 Hz


def path_offsets(path: SampledPath, points: FloatArray, near: FloatArray) -> FloatArray:
    """Lateral offset (m, left positive) of `points` (2, n) from a path, near stations (m) (n,).

    Equal to `path.project` up to rounding (Section III-B, by Newton's method).
    """
    chunks = [slice(k, k + _CHUNK) for k in range(0, near.size, _CHUNK)]
    parts = [path_feet(path, points[:, chunk], near[chunk])[1] for chunk in chunks]
    return np.concatenate(parts) if parts else np.zeros(0)


def driven_feet(
    path: SampledPath, points: FloatArray, distance: FloatArray, start: float
) -> FloatArray:
    """Station and lateral offset (m), shape (2, n), of the points of a drive along a path.

    `points` (m, shape (2, n)) follow each other after `distance` (m, shape (n,)) driven; the first
    is near station `start` (m). Each foot point is searched near the one before, and so is on its
    branch of a path that crosses or repeats itself.
    """
    feet = np.zeros((2, distance.size))
    before, driven = start, distance[0] if distance.size else 0.0
    for first in range(0, distance.size, _STEP):
        here = slice(first, first + _STEP)
        feet[:, here] = path_feet(path, points[:, here], before + distance[here] - driven)
        before, driven = float(feet[0, here][-1]), distance[here][-1]
    return feet


def path_feet(path: SampledPath, points: FloatArray, near: FloatArray) -> FloatArray:
    """Station and lateral offset (m), shape (2, n), of points near stations, see `path_offsets`."""
    low, high = near - WINDOW, near + WINDOW
    station = np.clip(_nearest_samples(path, points, low, high), low, high)
    lateral, moving = np.zeros(near.size), np.arange(near.size)
    for _ in range(8):  # each step squares the error; two or three are typical
        here = station[moving]
        east, north, yaw, curvature = _at(path, here)
        dx, dy = points[0, moving] - east, points[1, moving] - north
        cos, sin = np.cos(yaw), np.sin(yaw)
        left = dy * cos - dx * sin
        along = (dx * cos + dy * sin) / np.maximum(1.0 - curvature * left, 0.2)
        lateral[moving] = left
        target = np.clip(here + along, low[moving], high[moving])
        station[moving] = target
        moving = moving[np.abs(target - here) >= 1e-9]
        if not moving.size:
            break
    return np.stack((station, lateral))


def _nearest_samples(
    path: SampledPath, points: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Station (m) of the sample nearest to each point, between `low` and `high` (m)."""
    size = path.station.size
    first = np.maximum(np.searchsorted(path.station, low) - 1, 0)
    last = np.minimum(np.searchsorted(path.station, high, side="right") + 1, size)
    index = first[:, None] + np.arange(max(int(np.max(last - first)), 1))
    outside = index >= last[:, None]
    index = np.minimum(index, size - 1)
    dx, dy = path.east[index] - points[0][:, None], path.north[index] - points[1][:, None]
    away = np.where(outside, np.inf, dx * dx + dy * dy)
    nearest = path.station[np.minimum(first + np.argmin(away, axis=1), size - 1)]
    # A window beyond an end has no samples.
    return np.where(first < last, nearest, np.where(first > 0, low, high))


def _at(
    path: SampledPath, station: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """East, north, yaw and curvature at stations (m), as `SampledPath.at`."""
    last = path.station.size - 1
    index = np.clip(np.searchsorted(path.station, station, side="right") - 1, 0, last - 1)
    after = index + 1
    step = path.station[after] - path.station[index]
    inside = np.clip(station, path.station[0], path.station[-1])
    beyond = station - inside
    share = (inside - path.station[index]) / step
    rest = 1.0 - share
    weight = share * share * (3.0 - 2.0 * share)
    leaving, arriving = share * rest * rest * step, -share * share * rest * step
    yaw0, yaw1 = path.yaw[index], path.yaw[after]
    yaw = yaw0 + share * (yaw1 - yaw0)
    bend0, bend1 = path.curvature[index], path.curvature[after]
    curvature = np.where(beyond == 0.0, bend0 + share * (bend1 - bend0), 0.0)

    def coordinate(values: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
        begin, end = values[index], values[after]
        return begin + weight * (end - begin) + leaving * first + arriving * second

    east = coordinate(path.east, np.cos(yaw0), np.cos(yaw1)) + beyond * np.cos(yaw)
    north = coordinate(path.north, np.sin(yaw0), np.sin(yaw1)) + beyond * np.sin(yaw)
    return east, north, yaw, curvature


# ---- Edges of a lane along a path, and simplified paths, for pictures


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
