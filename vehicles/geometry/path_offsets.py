"""Offsets of many points from a path at once; edges of a lane, and simplified paths."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vehicles.geometry.sampled_path import WINDOW, FloatArray, SampledPath

_STEP = 50  # Points of a drive that are projected at once, a second of it at 50 Hz


def path_offsets(path: SampledPath, points: FloatArray, near: FloatArray) -> FloatArray:
    """Lateral offset (m, left positive) of `points` (2, n) from a path, near stations (m) (n,).

    Equal to `path.project` up to rounding (Section III-B, by Newton's method).
    """
    return np.asarray(path_feet(path, points, near)[1])


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
    station, lateral, moving = near.copy(), np.zeros(near.size), np.arange(near.size)
    for _ in range(8):  # each step squares the error; two or three are typical
        here = station[moving]
        foot, yaw, curvature = _at(path, here)
        (east, north), (cos, sin) = points[:, moving] - foot, _directions(yaw)
        aside = lateral[moving] = north * cos - east * sin
        along = (east * cos + north * sin) / np.maximum(1.0 - curvature * aside, 0.2)
        target = np.clip(here + along, low[moving], high[moving])
        station[moving] = target
        moving = moving[np.abs(target - here) >= 1e-9]
        if not moving.size:
            break
    return np.stack((station, lateral))


def _directions(yaw: FloatArray) -> FloatArray:
    """Unit vectors (..., 2, n); complex products would depend on the processor."""
    return np.stack((np.cos(yaw), np.sin(yaw)), axis=-2)


def _at(path: SampledPath, station: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East and north (m, shape (2, n)), yaw and curvature at stations (m), as `SampledPath.at`."""
    index = np.searchsorted(path.station, station, side="right") - 1
    index = np.clip(index, 0, path.station.size - 2) + np.array([[0], [1]])
    (start, end), inside = path.station[index], np.clip(station, *path.station[[0, -1]])
    share = (inside - start) / (end - start)
    weight, handle = share * share * (3.0 - 2.0 * share), share * (1.0 - share) * (end - start)
    place, after = np.stack((path.east[index], path.north[index]), axis=1)
    leaving, arriving = _directions(path.yaw[index])
    yaw = np.interp(station, path.station, path.yaw)
    place = place + weight * (after - place)
    place += handle * ((1.0 - share) * leaving - share * arriving)
    place += (station - inside) * _directions(yaw)
    return place, yaw, np.interp(station, path.station, path.curvature, 0.0, 0.0)


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
