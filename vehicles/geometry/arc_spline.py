"""A path of lines, arcs and clothoids with a continuous tangent, and projection on it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, ceil, cos, floor, sin, sqrt
from typing import Final

from vehicles.geometry.geodesy import wrap_angle
from vehicles.geometry.sampled_path import Foot, PathPoint
from vehicles.messages import CompositeTrajectory

PlanePose = tuple[float, float, float]  # East, north (m) and yaw (rad)
STRAIGHT: Final = 1e-12
"""Curvature (1/m) below which a piece counts as a line: turn / curvature loses precision."""
NODE_1: Final = 0.046910077030668018
NODE_2: Final = 0.23076534494715845
NODE_4: Final = 0.76923465505284155
NODE_5: Final = 0.95308992296933198
"""Nodes of Gauss-Legendre quadrature over (0, 1), except the middle; exact up to x⁹."""
OUTER_WEIGHT: Final = 0.11846344252809454
INNER_WEIGHT: Final = 0.23931433524968324
MIDDLE_WEIGHT: Final = 0.28444444444444444
"""Weights of the outer nodes, the inner nodes and the middle."""
CONVERGED: Final = 5e-3
"""Newton's method has converged after a step below this (m): the remaining error is its cube."""
MAX_STEPS: Final = 8  # Limit of the steps of Newton's method; one or two are typical


def clothoid_chord(curvature: float, rate: float, length: float) -> tuple[float, float]:
    """End (m ahead, m to the left) of a clothoid of `length` (m), in the frame of its start.

    Its curvature (1/m) at the start grows by `rate` (1/m²); the paper has arcs only. Gauss-Legendre
    quadrature of cos and sin of the turn κs + cs²/2: within 1e-9 of the length for turns up to
    2 rad, within 1e-5 for a half circle.
    """
    half = 0.5 * rate
    a, b, c, d, e = NODE_1 * length, NODE_2 * length, 0.5 * length, NODE_4 * length, NODE_5 * length
    a *= curvature + half * a  # the turns up to the nodes
    b *= curvature + half * b
    c *= curvature + half * c
    d *= curvature + half * d
    e *= curvature + half * e
    ahead = (
        OUTER_WEIGHT * cos(a)
        + INNER_WEIGHT * cos(b)
        + MIDDLE_WEIGHT * cos(c)
        + INNER_WEIGHT * cos(d)
        + OUTER_WEIGHT * cos(e)
    )
    left = (
        OUTER_WEIGHT * sin(a)
        + INNER_WEIGHT * sin(b)
        + MIDDLE_WEIGHT * sin(c)
        + INNER_WEIGHT * sin(d)
        + OUTER_WEIGHT * sin(e)
    )
    return length * ahead, length * left


def on_arc(start: PlanePose, curvature: float, station: float) -> PathPoint:
    """Point `station` (m) along the arc of `curvature` (1/m) from `start`.

    Computed by the chord of the arc (Section III-A has the shape, not the formula).
    """
    east, north, yaw = start
    turn = curvature * station
    chord = 2.0 * sin(0.5 * turn) / curvature if abs(curvature) > STRAIGHT else station
    direction = yaw + 0.5 * turn
    return PathPoint(
        east + chord * cos(direction),
        north + chord * sin(direction),
        wrap_angle(yaw + turn),
        curvature,
    )


def on_clothoid(start: PlanePose, curvature: float, rate: float, station: float) -> PathPoint:
    """Point `station` (m) along the clothoid (or arc) from `start`.

    Its `curvature` (1/m) at the start grows by `rate` (1/m²). The paper has arcs only
    (Section III-A).
    """
    if rate == 0.0:
        return on_arc(start, curvature, station)
    east, north, yaw = start
    ahead, left = clothoid_chord(curvature, rate, station)
    cos_yaw, sin_yaw = cos(yaw), sin(yaw)
    return PathPoint(
        east + ahead * cos_yaw - left * sin_yaw,
        north + ahead * sin_yaw + left * cos_yaw,
        wrap_angle(yaw + station * (curvature + 0.5 * rate * station)),
        curvature + rate * station,
    )


def along_arc(start: PlanePose, kappa: float, east: float, north: float) -> float:
    """Station (m) of `near_arc` (Section III-B) only."""
    start_east, start_north, yaw = start
    cos_yaw, sin_yaw = cos(yaw), sin(yaw)
    off_east, off_north = east - start_east, north - start_north
    xi = off_east * cos_yaw + off_north * sin_yaw
    if not abs(kappa) > STRAIGHT:
        return xi
    eta = off_north * cos_yaw - off_east * sin_yaw
    return atan2(kappa * xi, 1.0 - kappa * eta) / kappa


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
    return Foot(station, lateral, wrap_angle(yaw + turn), kappa)


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
        start = (self.east, self.north, self.yaw)
        if self.rate == 0.0:
            return on_arc(start, self.curvature, station)
        within = min(max(station, 0.0), self.length)
        point = on_clothoid(start, self.curvature, self.rate, within)
        if within == station:
            return point
        return on_arc((point.east, point.north, point.yaw), point.curvature, station - within)

    def curvature_at(self, station: float) -> float:
        """Signed curvature (1/m, Section III-A) at `station` (m), constant beyond the ends."""
        return self.curvature + self.rate * min(max(station, 0.0), self.length)

    def project(self, east: float, north: float) -> Foot:
        """Project a point on the extended piece (projection and e_lat of Section III-B)."""
        if self.rate == 0.0:
            return self.near(east, north)
        mean = self.curvature + 0.5 * self.rate * self.length
        near = along_arc((self.east, self.north, self.yaw), mean, east, north)
        return self.settled(near, east, north)

    def settled(self, near: float, east: float, north: float) -> Foot:
        """Project a point on a clothoid (Section III-B), given the station `near` on its mean arc.

        By Newton's method; each step is to the nearest point of the osculating circle.
        """
        # Start on the arc with the clothoid's mean curvature up to this station.
        bend = self.curvature + 0.5 * self.rate * min(max(near, 0.0), self.length)
        station = along_arc((self.east, self.north, self.yaw), bend, east, north)
        for _ in range(MAX_STEPS):
            point = self.at(station)
            foot = near_arc((point.east, point.north, point.yaw), point.curvature, east, north)
            station += foot.station
            if abs(foot.station) < CONVERGED:
                break
        return Foot(station, foot.lateral, foot.yaw, self.curvature_at(station))

    def near(self, east: float, north: float) -> Foot:
        """Project a point on the extended arc of the piece's mean curvature (Section III-B)."""
        mean = self.curvature + 0.5 * self.rate * self.length
        return near_arc((self.east, self.north, self.yaw), mean, east, north)


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

    def curvature_at(self, station: float) -> float:
        """Signed curvature (1/m) at `station` (m); the end pieces extend the path at both ends.

        Piecewise constant, as in the footnote of Section III-A on arc splines, or linear.
        """
        for piece in self.pieces[:-1]:
            if station <= piece.length:
                return piece.curvature_at(station)
            station -= piece.length
        return self.pieces[-1].curvature_at(station)

    def curvatures(self, start: float, step: float, count: int) -> list[float]:
        """Signed curvature (1/m, Section III-A) at `count` stations, `step` (m) apart from `start`.

        Much faster than repeated calls of `curvature_at`.
        """
        if len(self.pieces) == 1 and self.pieces[0].rate == 0.0:
            return [self.pieces[0].curvature] * count
        curvatures: list[float] = []
        offset, last = start, len(self.pieces) - 1
        for index, piece in enumerate(self.pieces):
            k, passed = len(curvatures), floor((piece.length - offset) / step) + 1
            end = max(count if index == last else min(count, passed), k)
            if piece.rate == 0.0:
                curvatures += [piece.curvature] * (end - k)
            elif end > k:
                # Constant before the piece, linear within it, and constant after it.
                begin = min(max(ceil(-offset / step), k), end)
                after = min(max(passed, begin), end)
                curvatures += [piece.curvature] * (begin - k)
                bend, rise = piece.curvature + piece.rate * offset, piece.rate * step
                curvatures += [bend + rise * j for j in range(begin, after)]
                curvatures += [piece.curvature + piece.rate * piece.length] * (end - after)
            offset -= piece.length
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
        if len(self.pieces) == 1:
            return self.pieces[0].project(east, north)
        chosen = self.pieces[0]
        foot = chosen.near(east, north)
        least = abs(foot.lateral) + max(foot.station - chosen.length, 0.0)
        start, begin, last = 0.0, chosen.length, self.pieces[-1]
        for piece in self.pieces[1:]:
            other = piece.near(east, north)
            beyond = 0.0 if piece is last else other.station - piece.length
            away = abs(other.lateral) + max(-other.station, beyond, 0.0)
            if away < least:
                chosen, foot, least, start = piece, other, away, begin
            begin += piece.length
        if chosen.rate != 0.0:
            foot = chosen.settled(foot.station, east, north)
        foot.station += start
        return foot


# ---- Points along a composite trajectory, for pictures of it


LONGEST_M: Final = 1000.0  # Longest trajectory (m) that is drawn, whatever a message contains


def points_along(
    trajectory: CompositeTrajectory, spacing_m: float
) -> list[tuple[float, float, float]]:
    """List points (east_m, north_m, yaw_rad) along arcs (Section III-A) and clothoids.

    Both ends are included. Neighbours are at most `spacing_m` apart, and pieces share their common
    point. Skips pieces whose values or turn are not finite, as the message may be from any sender.
    """
    points: list[tuple[float, float, float]] = []
    left = LONGEST_M
    for piece in zip(
        trajectory.piece_east_m,
        trajectory.piece_north_m,
        trajectory.piece_yaw_rad,
        trajectory.piece_curvature_per_m,
        trajectory.piece_curvature_rate_per_m2,
        trajectory.piece_length_m,
        strict=False,
    ):
        if not all(map(math.isfinite, piece)):
            continue
        east, north, yaw, curvature, rate, length = piece
        length = max(0.0, min(length, left))
        if not math.isfinite(length * (abs(curvature) + abs(rate) * length)):
            continue
        left -= length
        cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
        steps = max(1, math.ceil(length / spacing_m))
        for step in range(1 if points else 0, steps + 1):
            along = length * step / steps
            ahead, across = _chord(curvature, rate, along)
            points.append(
                (
                    east + ahead * cos_yaw - across * sin_yaw,
                    north + ahead * sin_yaw + across * cos_yaw,
                    yaw + along * (curvature + 0.5 * rate * along),
                )
            )
    return points


def _chord(curvature: float, rate: float, along: float) -> tuple[float, float]:
    """Point `along` (m) after the start of a piece, in the frame of the start; exact for arcs.

    The chord of an arc of length s and curvature κ has the direction κs/2 and the length
    s·sin(κs/2)/(κs/2).
    """
    if rate != 0.0:
        return clothoid_chord(curvature, rate, along)
    half_turn = 0.5 * curvature * along
    chord = along * (math.sin(half_turn) / half_turn if abs(half_turn) > 1e-9 else 1.0)
    return chord * math.cos(half_turn), chord * math.sin(half_turn)
