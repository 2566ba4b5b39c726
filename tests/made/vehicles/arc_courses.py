"""Courses of lines and arcs, and the samples that a source driving them would have sent."""

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
    """Lay (curvature, length) pieces one behind the other from (east, north, yaw)."""
    east, north, yaw = start
    laid = []
    for curvature, length in pieces:
        piece = Piece(east, north, yaw, curvature, length)
        end = piece.at(length)
        laid.append(piece)
        east, north, yaw = end.east, end.north, end.yaw
    return ArcSpline(laid)


def beside(path: ArcSpline, station: float, left: float = 0.0) -> tuple[float, float]:
    """The point `left` metres to the left of a place on the path."""
    place = path.at(station)
    return place.east - left * math.sin(place.yaw), place.north + left * math.cos(place.yaw)


def window(
    path: ArcSpline, stations: Sequence[float] | Floats, ego: float, left: float = 0.0
) -> Window:
    """Samples at stations of a path, seen by an ego at station `ego`."""
    points = [beside(path, float(station), left) for station in stations]
    return Window(
        np.array([east for east, _ in points]),
        np.array([north for _, north in points]),
        np.array([float(station) - ego for station in stations]),
    )


def shaken(seen: Window, random: np.random.Generator, noise: float = 0.02) -> Window:
    """The same samples with white noise on both coordinates."""
    count = len(seen.east)
    return seen._replace(
        east=seen.east + noise * random.standard_normal(count),
        north=seen.north + noise * random.standard_normal(count),
    )


def misses(fit: Fit, path: ArcSpline, station: float) -> tuple[float, float, float]:
    """How far offset (m), heading (rad) and curvature (1/m) of a fit are off at a station."""
    true = path.at(station)
    foot = fit.spline.project(true.east, true.north)
    return (
        foot.lateral,
        math.remainder(foot.yaw - true.yaw, math.tau),
        foot.curvature - true.curvature,
    )
