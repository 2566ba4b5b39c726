"""Curves of the local frame laid in the world, alone or as their mean."""

from collections.abc import Sequence
from math import atan2, cos, sin

from vehicles.geometry.arc_spline import STRAIGHT, ArcSpline, Piece, clothoid_chord
from vehicles.geometry.geodesy import wrap_angle
from vehicles.preview.fit_arc import FitData, LocalCurve, X, Y

Frame = tuple[float, float, float, float]
"""Origin of the local frame (m, m) and the unit vector of its x axis, in the world."""
LOCAL: Frame = (0.0, 0.0, 1.0, 0.0)


def laid(shares: Sequence[tuple[float, LocalCurve]], data: FitData, frame: Frame) -> ArcSpline:
    """Lay the mean of curves, each with its share, from the first sample to the last one.

    The arc spline of Section III-A; a mean is beyond the paper.
    """
    if len(shares) == 1:
        return _alone(shares[0][1], data, frame)
    return _mean(shares, data, frame)


def _alone(curve: LocalCurve, data: FitData, frame: Frame) -> ArcSpline:
    """Lay one curve, from the first sample's projection to the last one's."""
    origin_east, origin_north, ux, uy = frame
    east = origin_east + curve.x * ux - curve.y * uy
    north = origin_north + curve.x * uy + curve.y * ux
    yaw = atan2(uy, ux) + curve.angle
    start = _station(curve, curve.before, data.rows.item(X, 0), data.rows.item(Y, 0))
    end = _station(curve, curve.after, data.rows.item(X, -1), data.rows.item(Y, -1))
    if curve.before != curve.after:
        begin = Piece(east, north, yaw, curve.before, 0.0).at(start)
        return ArcSpline(
            (
                Piece(begin.east, begin.north, begin.yaw, curve.before, -start),
                Piece(east, north, yaw, curve.after, end),
            )
        )
    rate = curve.rate
    if rate == 0.0:
        begin = Piece(east, north, yaw, curve.before, 0.0).at(start)
        return ArcSpline((Piece(begin.east, begin.north, begin.yaw, curve.after, end - start),))
    ahead, left = clothoid_chord(curve.after, rate, start)
    forward, aside = cos(yaw), sin(yaw)
    return ArcSpline(
        (
            Piece(
                east + ahead * forward - left * aside,
                north + ahead * aside + left * forward,
                wrap_angle(yaw + start * (curve.after + 0.5 * rate * start)),
                curve.after + rate * start,
                end - start,
                rate,
            ),
        )
    )


def _station(curve: LocalCurve, curvature: float, x: float, y: float) -> float:
    """Arc length (m) from the curve's join to the projection of (x, y) on its piece."""
    ux, uy = cos(curve.angle), sin(curve.angle)
    dx, dy = x - curve.x, y - curve.y
    xi = dx * ux + dy * uy
    if abs(curvature) < STRAIGHT:
        return xi
    return atan2(curvature * xi, 1.0 - curvature * (dy * ux - dx * uy)) / curvature


def _mean(shares: Sequence[tuple[float, LocalCurve]], data: FitData, frame: Frame) -> ArcSpline:
    """Lay the curve whose place, direction beside the ego and curvature all along are means."""
    nearest = min(int(data.station.searchsorted(0.0)), len(data.station) - 1)
    x, y = data.rows.item(X, nearest), data.rows.item(Y, nearest)
    splines = [(share, _alone(curve, data, LOCAL)) for share, curve in shares]
    feet = [(share, spline, spline.project(x, y)) for share, spline in splines]
    first = feet[0][2].yaw
    yaw = first + sum(share * wrap_angle(foot.yaw - first) for share, _, foot in feet)
    lateral = sum(share * foot.lateral for share, _, foot in feet)
    begin = -sum(share * foot.station for share, _, foot in feet)
    end = begin + sum(share * spline.length for share, spline in splines)
    inner = sorted(
        spline.pieces[0].length - foot.station for _, spline, foot in feet if len(spline.pieces) > 1
    )
    cuts = [begin, *(cut for cut in inner if begin < cut < end), end]
    pieces, here = [], Piece(0.0, 0.0, 0.0, 0.0, 0.0).at(0.0)
    for low, high in zip(cuts, cuts[1:], strict=False):
        middle = 0.5 * (low + high)
        bend = rate = 0.0
        for share, spline, foot in feet:
            bend += share * spline.curvature_at(middle + foot.station)
            rate += share * spline.pieces[0].rate
        piece = Piece(
            here.east, here.north, here.yaw, bend - 0.5 * rate * (high - low), high - low, rate
        )
        here = piece.at(high - low)
        pieces.append(piece)
    return _moved(
        ArcSpline(pieces), -begin, (x + lateral * sin(yaw), y - lateral * cos(yaw), yaw), frame
    )


def _moved(
    spline: ArcSpline, station: float, to: tuple[float, float, float], frame: Frame
) -> ArcSpline:
    """Move a spline so that it passes `to` (x, y, angle in `frame`) at `station` (m)."""
    origin_east, origin_north, ux, uy = frame
    x, y, angle = to
    there = spline.at(station)
    turn = atan2(uy, ux) + angle - there.yaw
    east, north = origin_east + x * ux - y * uy, origin_north + x * uy + y * ux
    forward, aside = cos(turn), sin(turn)
    return ArcSpline(
        [
            Piece(
                east + (one.east - there.east) * forward - (one.north - there.north) * aside,
                north + (one.east - there.east) * aside + (one.north - there.north) * forward,
                wrap_angle(one.yaw + turn),
                one.curvature,
                one.length,
                one.rate,
            )
            for one in spline.pieces
        ]
    )
