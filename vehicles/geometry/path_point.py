"""A point of a path, and the projection of a point on a path."""

from dataclasses import dataclass


@dataclass(slots=True)
class PathPoint:
    """A point of a path: position (m), yaw of the tangent (rad), signed curvature (1/m).

    (X_0, Y_0), θ_R and 1/R of Section III-B, with positive curvature in left turns. The yaw is
    wrapped on an arc spline and unwrapped on a sampled path.
    """

    east: float
    north: float
    yaw: float
    curvature: float


@dataclass(slots=True)
class Foot:
    """Projection of a point on a path (Section III-B, Figs. 4 and 5).

    Station (m) along the path, lateral offset of the point (m, left of the path positive: e_lat),
    yaw of the tangent (rad) and signed curvature (1/m) there. The yaw is wrapped on an arc spline
    and unwrapped on a sampled path.
    """

    station: float
    lateral: float
    yaw: float
    curvature: float
