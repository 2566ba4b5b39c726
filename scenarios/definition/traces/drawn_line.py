"""Drawn lines: points without times, far apart, that are vertices and not noisy positions."""

import numpy as np

from scenarios.definition.traces.drive import Floats, Ints
from vehicles.geometry.bridges import step_lengths

FAR_APART = 20.0
"""Median distance (m) of points without times from which they are the vertices of a drawn line."""

SPACING = 2.0
"""Distance (m) of the points between vertices."""

FEWEST_VERTICES = 3


def are_vertices(points: Floats) -> bool:
    """Whether `points` (2, n) without times are those of a drawn line."""
    if points.shape[1] < FEWEST_VERTICES:
        return False
    return float(np.median(step_lengths(points))) >= FAR_APART


def between_vertices(points: Floats) -> tuple[Floats, Ints]:
    """Return points (2, m) on a smooth line through `points` (2, n), and the vertex before each.

    Cubics (Hermite) join the vertices; the tangent at each is that of the parabola through it and
    its neighbours by chord length (Catmull and Rom, 1974). On a circle of radius R with vertices d
    apart they are off by d⁴ / (384 R³).
    """
    steps = np.maximum(step_lengths(points), 1e-9)
    slopes = np.diff(points) / steps
    inner = (slopes[:, :-1] * steps[1:] + slopes[:, 1:] * steps[:-1]) / (steps[:-1] + steps[1:])
    first, last = 2.0 * slopes[:, :1] - inner[:, :1], 2.0 * slopes[:, -1:] - inner[:, -1:]
    tangents = np.concatenate((first, inner, last), axis=1)
    counts = np.maximum(np.ceil(steps / SPACING), 1.0).astype(np.int64)
    before = np.repeat(np.arange(steps.size), counts)
    u = (np.arange(before.size) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[before]
    left, right, length, rest = points[:, before], points[:, before + 1], steps[before], 1.0 - u
    line = left + u * u * (3.0 - 2.0 * u) * (right - left)
    line += length * u * rest * (rest * tangents[:, before] - u * tangents[:, before + 1])
    return np.concatenate((line, points[:, -1:]), axis=1), np.append(before, steps.size)
