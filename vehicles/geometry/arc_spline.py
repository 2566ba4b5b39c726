"""A path of lines, arcs and clothoids with a continuous tangent, and projection on it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, ceil, cos, inf, remainder, sin, sqrt, tau
from typing import Final

from vehicles.geometry.sampled_path import Foot, PathPoint
from vehicles.messages import CompositeTrajectory

PlanePose = tuple[float, float, float]  # East, north (m) and yaw (rad)
STRAIGHT: Final = 1e-12
"""Curvature (1/m) below which a piece counts as a line: turn / curvature loses precision."""
NODES = (
    (0.046910077030668018, 0.11846344252809454),
    (0.23076534494715845, 0.23931433524968324),
    (0.5, 0.28444444444444444),
    (0.76923465505284155, 0.23931433524968324),
    (0.95308992296933198, 0.11846344252809454),
)
"""Nodes and weights of Gauss-Legendre quadrature over (0, 1), exact up to x⁹."""
CONVERGED: Final = 5e-3
"""Newton's method has converged after a step below this (m): the remaining error is its cube."""
MAX_STEPS: Final = 8  # Limit of the steps of Newton's method; one or two are typical


def on_clothoid(start: PlanePose, curvature: float, rate: float, station: float) -> PathPoint:
    """Point `station` (m) along the arc or clothoid from `start`.

    Its `curvature` (1/m) at the start grows by `rate` (1/m²); the paper has arcs only
    (Section III-A). Clothoids by Gauss-Legendre quadrature of cos and sin of the yaw: within 1e-9
    of the length for turns up to 2 rad, within 1e-5 for a half circle.
    """
    east, north, yaw = start
    turn = station * (curvature + 0.5 * rate * station)
    to_east = to_north = 0.0
    if rate == 0.0:
        chord = 2.0 * sin(0.5 * turn) / curvature if abs(curvature) > STRAIGHT else station
        to_east, to_north = chord * cos(yaw + 0.5 * turn), chord * sin(yaw + 0.5 * turn)
    else:
        for node, weight in NODES:
            part = node * station
            direction = yaw + part * (curvature + 0.5 * rate * part)
            to_east += weight * station * cos(direction)
            to_north += weight * station * sin(direction)
    end_yaw = remainder(yaw + turn, tau)
    return PathPoint(east + to_east, north + to_north, end_yaw, curvature + rate * station)


def near_arc(start: PlanePose, kappa: float, east: float, north: float) -> Foot:
    """Point of the circle from `start` that is nearest to (east, north) (Section III-B).

    With (ξ, η) the point in the frame of the start, u = 1 − κη and w = κξ, the arc turns by
    atan2(w, u), and the offset is e = (1 − hypot(u, w))/κ, in a form that is valid for either sign
    of κ and for a line.
    """
    start_east, start_north, yaw = start
    cos_yaw, sin_yaw = cos(yaw), sin(yaw)
    off_east, off_north = east - start_east, north - start_north
    xi = off_east * cos_yaw + off_north * sin_yaw
    eta = off_north * cos_yaw - off_east * sin_yaw
    u, w = 1.0 - kappa * eta, kappa * xi
    turn = atan2(w, u)
    lateral = (2.0 * eta - kappa * (xi * xi + eta * eta)) / (1.0 + sqrt(u * u + w * w))
    station = turn / kappa if abs(kappa) > STRAIGHT else xi
    return Foot(station, lateral, remainder(yaw + turn, tau), kappa)


@dataclass(slots=True)
class Piece:
    """One line, arc or clothoid: start (m), yaw (rad), signed curvature (1/m) and length (m).

    A piece of the circular arc spline of Section III-A. Unlike in the paper its curvature may grow
    by `rate` (1/m²). Beyond each end it continues with constant curvature.
    """

    east: float
    north: float
    yaw: float
    curvature: float
    length: float
    rate: float = 0.0

    def at(self, station: float) -> PathPoint:
        """Point `station` (m) after the start, also beyond the ends (Section III-A)."""
        within = station if self.rate == 0.0 else min(max(station, 0.0), self.length)
        start = (self.east, self.north, self.yaw)
        point = on_clothoid(start, self.curvature, self.rate, within)
        if within == station:
            return point
        end = (point.east, point.north, point.yaw)
        return on_clothoid(end, point.curvature, 0.0, station - within)

    def settled(self, near: float, east: float, north: float) -> Foot:
        """Project a point on a clothoid (Section III-B), given the station `near` on its mean arc.

        By Newton's method; each step is to the nearest point of the osculating circle.
        """
        # Start on the arc with the clothoid's mean curvature up to this station.
        bend = self.curvature + 0.5 * self.rate * min(max(near, 0.0), self.length)
        station = near_arc((self.east, self.north, self.yaw), bend, east, north).station
        for _ in range(MAX_STEPS):
            point = self.at(station)
            foot = near_arc((point.east, point.north, point.yaw), point.curvature, east, north)
            station += foot.station
            if abs(foot.station) < CONVERGED:
                break
        curvature = self.curvature + self.rate * min(max(station, 0.0), self.length)
        return Foot(station, foot.lateral, foot.yaw, curvature)


class ArcSpline:
    """Pieces in order of travel, joined with a continuous tangent.

    The circular arc spline of Section III-A.
    """

    __slots__ = ("pieces",)

    def __init__(self, pieces: Sequence[Piece]) -> None:
        if not pieces:
            raise ValueError("an arc spline has at least one piece")
        self.pieces = tuple(pieces)

    @property
    def length(self) -> float:
        """Arc length of the spline of Section III-A (m)."""
        return sum([piece.length for piece in self.pieces])

    def at(self, station: float) -> PathPoint:
        """Point at `station` (m) (Section III-A); the end pieces extend the path at both ends."""
        for piece in self.pieces[:-1]:
            if station <= piece.length:
                return piece.at(station)
            station -= piece.length
        return self.pieces[-1].at(station)

    def curvatures(self, start: float, step: float, count: int) -> list[float]:
        """Signed curvature (1/m, Section III-A) at `count` stations from `start` by `step` (m).

        The end pieces extend the path at both ends, with constant curvature.
        """
        curvatures: list[float] = []
        begin, (piece, *later) = 0.0, self.pieces
        for k in range(count):
            station = start + k * step - begin
            while later and station > piece.length:
                begin += piece.length
                station -= piece.length
                piece, *later = later
            within = min(max(station, 0.0), piece.length) if piece.rate else 0.0
            curvatures.append(piece.curvature + piece.rate * within)
        return curvatures

    def fading(self, length: float, most: float) -> "ArcSpline":
        """Extend the path by a piece of `length` (m) whose curvature fades to zero, and a straight.

        The piece begins with the curvature at the end of the path of Section III-A, at most `most`
        (1/m). A path that kept its curvature would leave the road.
        """
        end = self.at(self.length)
        curvature = min(max(end.curvature, -most), most)
        fade = Piece(end.east, end.north, end.yaw, curvature, length, -curvature / length)
        straight = fade.at(length)
        return ArcSpline(
            (*self.pieces, fade, Piece(straight.east, straight.north, straight.yaw, 0.0, 1.0))
        )

    def project(self, east: float, north: float) -> Foot:
        """Project a point on the path, extended at both ends by the end pieces (Section III-B).

        Selects the piece with the smallest sum of offset and distance beyond the piece, measured on
        arcs of the pieces' mean curvatures.
        """
        begin, least, first, last = 0.0, inf, self.pieces[0], self.pieces[-1]
        for piece in self.pieces:
            bend = piece.curvature + 0.5 * piece.rate * piece.length
            other = near_arc((piece.east, piece.north, piece.yaw), bend, east, north)
            before = 0.0 if piece is first else -other.station
            beyond = 0.0 if piece is last else other.station - piece.length
            away = abs(other.lateral) + max(before, beyond, 0.0)
            if away < least:
                chosen, foot, least, start = piece, other, away, begin
            begin += piece.length
        if chosen.rate != 0.0:
            foot = chosen.settled(foot.station, east, north)
        foot.station += start
        return foot


# ---- Points along a composite trajectory, for pictures of it


LONGEST_M: Final = 1000.0  # Longest piece (m) that is drawn, whatever a message contains


def points_along(
    trajectory: CompositeTrajectory, spacing_m: float
) -> list[tuple[float, float, float]]:
    """List points (east_m, north_m, yaw_rad) along arcs (Section III-A) and clothoids.

    Both ends are included. Neighbours are at most `spacing_m` apart, and pieces share their common
    point. Skips pieces whose values or turn are not finite, as the message may be from any sender.
    """
    points: list[tuple[float, float, float]] = []
    for east, north, yaw, curvature, rate, length in zip(
        trajectory.piece_east_m,
        trajectory.piece_north_m,
        trajectory.piece_yaw_rad,
        trajectory.piece_curvature_per_m,
        trajectory.piece_curvature_rate_per_m2,
        trajectory.piece_length_m,
        strict=False,
    ):
        drawn = max(0.0, min(length, LONGEST_M))
        turn = drawn * (abs(curvature) + abs(rate) * drawn)
        if not math.isfinite(abs(east) + abs(north) + abs(yaw) + abs(length) + turn):
            continue
        steps = max(1, ceil(drawn / spacing_m))
        for step in range(1 if points else 0, steps + 1):
            station = drawn * step / steps
            place = on_clothoid((east, north, yaw), curvature, rate, station)
            turned = station * (curvature + 0.5 * rate * station)
            points.append((place.east, place.north, yaw + turned))
    return points
