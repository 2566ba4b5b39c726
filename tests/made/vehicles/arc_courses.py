"""Courses of lines and arcs, and samples of a source that drives them."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import ArcSpline, Piece
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import Fit

Floats = NDArray[np.float64]
Start = tuple[float, float, float]
ORIGIN: Start = (0.0, 0.0, 0.0)


def course(pieces: Sequence[tuple[float, float]], start: Start = ORIGIN) -> ArcSpline:
    """Join (curvature, length) pieces from (east, north, yaw)."""
    east, north, yaw = start
    placed = []
    for curvature, length in pieces:
        piece = Piece(east, north, yaw, curvature, length)
        end = piece.at(length)
        placed.append(piece)
        east, north, yaw = end.east, end.north, end.yaw
    return ArcSpline(placed)


def point_at(path: ArcSpline, station: float, left: float = 0.0) -> tuple[float, float]:
    """The point `left` (m) of a station of the path."""
    place = path.at(station)
    return place.east - left * math.sin(place.yaw), place.north + left * math.cos(place.yaw)


def window(
    path: ArcSpline, stations: Sequence[float] | Floats, ego: float, left: float = 0.0
) -> Window:
    points = [point_at(path, float(station), left) for station in stations]
    return Window(
        np.array([east for east, _ in points]),
        np.array([north for _, north in points]),
        np.array([float(station) - ego for station in stations]),
    )


def with_noise(samples: Window, random: np.random.Generator, noise: float = 0.02) -> Window:
    count = len(samples.east)
    return samples._replace(
        east=samples.east + noise * random.standard_normal(count),
        north=samples.north + noise * random.standard_normal(count),
    )


def fit_errors(fit: Fit, path: ArcSpline, station: float) -> tuple[float, float, float]:
    """Errors of offset (m), heading (rad) and curvature (1/m) of a fit at a station."""
    true = path.at(station)
    foot = fit.spline.project(true.east, true.north)
    return (
        foot.lateral,
        math.remainder(foot.yaw - true.yaw, math.tau),
        foot.curvature - true.curvature,
    )
