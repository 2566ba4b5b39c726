"""A path of straight lines and circular arcs with a continuous tangent, and projection on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, inf, sin, sqrt

from vehicles.geometry.geodesy import wrap_angle
from vehicles.geometry.path_point import Foot, PathPoint

STRAIGHT = 1e-12
"""Curvature (1/m) below which a piece is as long as a line: no rounding of turn over curvature."""


@dataclass(slots=True)
class Piece:
    """One line or arc: start (m), yaw there (rad), signed curvature (1/m), length (m).

    A piece of the circular arc spline of Section III-A.
    """

    east: float
    north: float
    yaw: float
    curvature: float
    length: float

    def at(self, station: float) -> PathPoint:
        """Place `station` (m) after the start; the piece extends beyond both of its ends.

        By the chord of the arc in between (Section III-A has the shape, not the formula).
        """
        turn = self.curvature * station
        chord = station
        if abs(self.curvature) > STRAIGHT:
            chord = 2.0 * sin(turn / 2.0) / self.curvature
        direction = self.yaw + turn / 2.0
        return PathPoint(
            self.east + chord * cos(direction),
            self.north + chord * sin(direction),
            wrap_angle(self.yaw + turn),
            self.curvature,
        )

    def project(self, east: float, north: float) -> Foot:
        """Nearest point of the extended piece (projection and e_lat of Section III-B).

        With (ξ, η) the point in the frame of the start, u = 1 − κη and w = κξ: the arc turned by
        atan2(w, u) to get there and the offset is e = (1 − hypot(u, w))/κ, written so that it
        holds for either sign of κ and for a line.
        """
        forward, left = cos(self.yaw), sin(self.yaw)
        off_east, off_north = east - self.east, north - self.north
        xi = off_east * forward + off_north * left
        eta = off_north * forward - off_east * left
        kappa = self.curvature
        u, w = 1.0 - kappa * eta, kappa * xi
        turn = atan2(w, u)
        lateral = (2.0 * eta - kappa * (xi * xi + eta * eta)) / (1.0 + sqrt(u * u + w * w))
        station = turn / kappa if abs(kappa) > STRAIGHT else xi
        return Foot(station, lateral, wrap_angle(self.yaw + turn), kappa)


class ArcSpline:
    """Pieces in order of travel, each beginning where the one before ends, with its tangent.

    The circular arc spline of Section III-A.
    """

    __slots__ = ("pieces",)

    def __init__(self, pieces: Sequence[Piece]) -> None:
        """Raise ValueError without at least one piece."""
        if not pieces:
            raise ValueError("an arc spline has at least one piece")
        self.pieces = tuple(pieces)

    @property
    def length(self) -> float:
        """Arc length of the spline of Section III-A (m): the sum of its pieces'."""
        return sum(piece.length for piece in self.pieces)

    def at(self, station: float) -> PathPoint:
        """Place at `station` (m); the end pieces extend the path beyond both ends.

        Along the arc spline of Section III-A, which itself ends there.
        """
        for piece in self.pieces[:-1]:
            if station <= piece.length:
                return piece.at(station)
            station -= piece.length
        return self.pieces[-1].at(station)

    def curvature_at(self, station: float) -> float:
        """Signed curvature (1/m) at `station` (m), beyond the ends that of the end pieces.

        Piecewise constant, as the footnote of Section III-A says of arc splines.
        """
        for piece in self.pieces[:-1]:
            if station <= piece.length:
                return piece.curvature
            station -= piece.length
        return self.pieces[-1].curvature

    def project(self, east: float, north: float) -> Foot:
        """Nearest point of the path, extended beyond both ends by the end pieces (Section III-B).

        Of several pieces that with the least sum of offset and distance beyond the piece counts.
        """
        candidates, start, last = [], 0.0, len(self.pieces) - 1
        for index, piece in enumerate(self.pieces):
            foot = piece.project(east, north)
            low = -inf if index == 0 else 0.0
            high = inf if index == last else piece.length
            beyond = max(low - foot.station, foot.station - high, 0.0)
            candidates.append((abs(foot.lateral) + beyond, index, start, foot))
            start += piece.length
        _, _, start, foot = min(candidates)
        return Foot(start + foot.station, foot.lateral, foot.yaw, foot.curvature)
