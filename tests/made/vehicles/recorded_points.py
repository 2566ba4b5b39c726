"""Recorded points of known courses."""

import math

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.smoothing import SmoothedPath, smooth_path

Points = NDArray[np.float64]


def circle(radius: float, distance: float, spacing: float, yaw: float = 0.0) -> Points:
    """Points (2, n) on a left turn that starts at the origin in direction `yaw`."""
    angle = np.arange(0.0, distance, spacing) / radius
    along, left = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.stack((along * cos - left * sin, along * sin + left * cos))


def oval(laps: float, spacing: float, straight: float = 30.0, radius: float = 10.0) -> Points:
    lap = 2.0 * (straight + math.pi * radius)
    points = []
    for distance in np.arange(0.0, laps * lap, spacing) % lap:
        half, rest = divmod(distance + straight / 2.0, lap / 2.0)
        turn = max(0.0, rest - straight) / radius
        x = min(rest, straight) - straight / 2.0 + radius * math.sin(turn)
        y = -radius * math.cos(turn)
        sign = 1.0 if half % 2 == 0.0 else -1.0
        points.append((sign * x, sign * y))
    return np.array(points).T


def noisy(points: Points, size: float = 0.02, seed: int = 1) -> Points:
    return points + np.random.default_rng(seed).normal(0.0, size, points.shape)


def smooth(
    points: Points, half_width: float, *, closed: bool = False, laps: int = 1, lead_in: float = 0.0
) -> SmoothedPath:
    east, north = points
    return smooth_path(east, north, half_width, closed=closed, laps=laps, lead_in=lead_in)
