"""The mean of two curves of the local frame, and a curve laid in the world."""

from math import atan2, cos, sin

from vehicles.geometry.arc_spline import STRAIGHT, ArcSpline, Piece, clothoid_chord
from vehicles.geometry.geodesy import wrap_angle
from vehicles.preview.fit_arc import FitData, LocalCurve, X, Y

Frame = tuple[float, float, float, float]
"""Origin of the local frame (m, m) and the unit vector of its x axis, in the world."""
Place = tuple[float, float, float]
"""A point (m, m) and a direction (rad)."""


def laid(curve: LocalCurve, data: FitData, frame: Frame) -> ArcSpline:
    """Lay a curve in the world, from the first sample's projection to the last one's.

    The arc spline of Section III-A.
    """
    origin_east, origin_north, ux, uy = frame
    join = (
        origin_east + curve.x * ux - curve.y * uy,
        origin_north + curve.x * uy + curve.y * ux,
        atan2(uy, ux) + curve.angle,
    )
    rate, rows = curve.rate, data.rows
    start = _along(curve, curve.before, rows.item(X, 0), rows.item(Y, 0))[0]
    end = _along(curve, curve.after, rows.item(X, -1), rows.item(Y, -1))[0]
    begin = _on(join, curve.before, rate, start)
    bend = curve.before + rate * start
    if curve.before == curve.after:
        return ArcSpline((Piece(*begin, bend, end - start, rate),))
    return ArcSpline(
        (Piece(*begin, bend, -start, rate), Piece(*join, curve.after, end, rate)),
    )


def between(one: LocalCurve, joined: LocalCurve, share: float, data: FitData) -> LocalCurve:
    """Mean of a curve of one piece and one of two, `share` being that of the second.

    Place and direction are means beside the sample that is nearest to the ego, curvatures all along
    (beyond the paper): so the curve does not jump where another explains the samples better.
    """
    nearest = min(int(data.station.searchsorted(0.0)), len(data.station) - 1)
    x, y = data.rows.item(X, nearest), data.rows.item(Y, nearest)
    rest = 1.0 - share
    cut, lateral, angle = _foot(joined, x, y)
    station, aside, other = _foot(one, x, y)
    angle = angle + rest * wrap_angle(other - angle)
    lateral = share * lateral + rest * aside
    bend = rest * (one.after + one.rate * (station - cut))
    before, after, rate = share * joined.before + bend, share * joined.after + bend, rest * one.rate
    here = (x + lateral * sin(angle), y - lateral * cos(angle), wrap_angle(angle))
    join = _on(here, (before if cut < 0.0 else after) + rate * cut, rate, -cut)
    return LocalCurve(*join, before, after, joined.misfit, joined.freedom, rate)


def _foot(curve: LocalCurve, x: float, y: float) -> Place:
    """Station (m) from the curve's P, offset (m) and direction (rad) of the projection of (x, y).

    On a clothoid by two steps of Newton's method.
    """
    station, lateral, turn = _along(curve, curve.after, x, y)
    if station < 0.0 and curve.before != curve.after:
        station, lateral, turn = _along(curve, curve.before, x, y)
    if curve.rate == 0.0:
        return station, lateral, curve.angle + turn
    px, py, angle = _on((curve.x, curve.y, curve.angle), curve.after, curve.rate, station)
    bend = curve.after + curve.rate * station
    there = curve._replace(x=px, y=py, angle=angle, before=bend, after=bend)
    further, lateral, turn = _along(there, bend, x, y)
    return station + further, lateral, angle + turn


def _along(curve: LocalCurve, curvature: float, x: float, y: float) -> Place:
    """Station (m) from the curve's P, offset (m) and turn (rad) of the projection of (x, y).

    On the circle of `curvature` (1/m), as in `Piece.near`.
    """
    ux, uy = cos(curve.angle), sin(curve.angle)
    dx, dy = x - curve.x, y - curve.y
    xi, eta = dx * ux + dy * uy, dy * ux - dx * uy
    u, w = 1.0 - curvature * eta, curvature * xi
    turn = atan2(w, u)
    lateral = (2.0 * eta - curvature * (xi * xi + eta * eta)) / (1.0 + (u * u + w * w) ** 0.5)
    return (turn / curvature if abs(curvature) > STRAIGHT else xi), lateral, turn


def _on(start: Place, curvature: float, rate: float, station: float) -> Place:
    """Place `station` (m) along a curve that has `curvature` (1/m) at `start`."""
    east, north, yaw = start
    if rate == 0.0:
        point = Piece(east, north, yaw, curvature, 0.0).at(station)
        return point.east, point.north, point.yaw
    ahead, left = clothoid_chord(curvature, rate, station)
    forward, aside = cos(yaw), sin(yaw)
    return (
        east + ahead * forward - left * aside,
        north + ahead * aside + left * forward,
        wrap_angle(yaw + station * (curvature + 0.5 * rate * station)),
    )
