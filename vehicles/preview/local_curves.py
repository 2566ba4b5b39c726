"""Averaging two curves of the local frame, and placing a curve in the world."""

from math import atan2, cos, sin

from vehicles.geometry.arc_spline import (
    ArcSpline,
    Piece,
    PlanePose,
    along_arc,
    near_arc,
    on_clothoid,
)
from vehicles.geometry.geodesy import wrap_angle
from vehicles.preview.fit_arc import FitData, LocalCurve, X, Y

Frame = tuple[float, float, float, float]  # Origin (m, m) and unit vector of the x axis


def place_in_world(curve: LocalCurve, data: FitData, frame: Frame) -> ArcSpline:
    """Arc spline of Section III-A in the world, from the first to the last sample's projection."""
    origin_east, origin_north, ux, uy = frame
    join = (
        origin_east + curve.x * ux - curve.y * uy,
        origin_north + curve.x * uy + curve.y * ux,
        atan2(uy, ux) + curve.angle,
    )
    rate, rows = curve.rate, data.rows
    origin = curve.x, curve.y, curve.angle
    before, after = curve.before, curve.after
    start = along_arc(origin, before, rows.item(X, 0), rows.item(Y, 0))
    end = along_arc(origin, after, rows.item(X, -1), rows.item(Y, -1))
    east, north, yaw = _pose_at(join, before, rate, start)
    bend = before + rate * start
    if before == after:
        return ArcSpline((Piece(east, north, yaw, bend, end - start, rate),))
    return ArcSpline((Piece(east, north, yaw, bend, -start, rate), Piece(*join, after, end, rate)))


def average_curves(
    smooth: LocalCurve, joined: LocalCurve, share: float, data: FitData
) -> LocalCurve:
    """Average a one-piece and a two-piece curve; `share` is the weight of the second.

    Position and direction are averaged at the sample nearest to the ego, curvatures everywhere, so
    the curve does not jump when another shape explains the samples better.
    """
    nearest = min(int(data.station.searchsorted(0.0)), len(data.station) - 1)
    x, y = data.rows.item(X, nearest), data.rows.item(Y, nearest)
    rest = 1.0 - share
    cut, lateral, angle = _foot(joined, x, y)
    station, smooth_lateral, smooth_angle = _foot(smooth, x, y)
    angle += rest * wrap_angle(smooth_angle - angle)
    lateral = share * lateral + rest * smooth_lateral
    bend = rest * (smooth.after + smooth.rate * (station - cut))
    before, after, rate = (
        share * joined.before + bend,
        share * joined.after + bend,
        rest * smooth.rate,
    )
    here = (x + lateral * sin(angle), y - lateral * cos(angle), wrap_angle(angle))
    join = _pose_at(here, (before if cut < 0.0 else after) + rate * cut, rate, -cut)
    return LocalCurve(*join, before, after, rate)


def _foot(curve: LocalCurve, x: float, y: float) -> PlanePose:
    """Project (x, y): station (m) from the curve's P, offset (m) and direction (rad).

    On a clothoid by two Newton steps, each to the osculating circle.
    """
    origin = curve.x, curve.y, curve.angle
    foot = near_arc(origin, curve.after, x, y)
    if foot.station < 0.0 and curve.before != curve.after:
        foot = near_arc(origin, curve.before, x, y)
    station = foot.station
    if curve.rate != 0.0:
        there = _pose_at(origin, curve.after, curve.rate, station)
        foot = near_arc(there, curve.after + curve.rate * station, x, y)
        station += foot.station
    return station, foot.lateral, foot.yaw


def _pose_at(start: PlanePose, curvature: float, rate: float, station: float) -> PlanePose:
    point = on_clothoid(start, curvature, rate, station)
    return point.east, point.north, point.yaw
