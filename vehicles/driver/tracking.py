"""Errors of a car against the trajectory it steers along (paper, "Computation of Feedback Errors").

The paper's `e_lat = R − distance` holds on left turns only, and its `y = mx + c` fails for roads
that run north; the signed form of `ArcSpline.project` holds for both turns and every heading.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from vehicles.geometry.arc_spline import ArcSpline
from vehicles.geometry.geodesy import wrap_angle


class PoseLike(Protocol):
    """Position (m), yaw (rad) and motion (m/s, rad/s) of a car: what it measures in Fig. 1."""

    @property
    def east(self) -> float:
        """East coordinate (m): X_v of Section III-B, with X to the east."""
        ...

    @property
    def north(self) -> float:
        """North coordinate (m): Y_v of Section III-B, with Y to the north."""
        ...

    @property
    def yaw(self) -> float:
        """Heading θ of Section III-B, counter-clockwise from east (rad)."""
        ...

    @property
    def speed(self) -> float:
        """Forward speed v_x of eq. (1) (m/s)."""
        ...

    @property
    def yaw_rate(self) -> float:
        """Rate of turn dθ/dt of eq. (1), counter-clockwise (rad/s)."""
        ...


@dataclass(slots=True)
class TrackingErrors:
    """e_lat (m, left of the path positive), θ̃ (rad), dθ̃/dt (rad/s), path curvature (1/m).

    Section III-B, with signed curvature 1/R; the car's errors in eq. (7).
    `ahead` gives the path's curvature (1/m) so many metres ahead of the foot point, or behind it
    for negative distances; without it the curvature is taken as constant.
    """

    lateral: float
    heading: float
    yaw_rate: float
    curvature: float
    ahead: Callable[[float], float] | None = field(default=None, compare=False, repr=False)

    def curvature_ahead(self, distance: float) -> float:
        """Signed curvature (1/m) `distance` (m) ahead of the foot point; 1/R of eq. (6) at 0."""
        return self.curvature if self.ahead is None else self.ahead(distance)


def track(spline: ArcSpline, pose: PoseLike) -> TrackingErrors:
    """Errors of `pose` against the nearest point of `spline` (Section III-B).

    Heading error θ̃ = θ − θ_R in (−π, π]; yaw-rate error dθ/dt − v/R with signed R, which is the
    paper's dθ/dt on a straight line.
    """
    foot = spline.project(pose.east, pose.north)
    return TrackingErrors(
        lateral=foot.lateral,
        heading=wrap_angle(pose.yaw - foot.yaw),
        yaw_rate=pose.yaw_rate - pose.speed * foot.curvature,
        curvature=foot.curvature,
        ahead=lambda distance: spline.curvature_at(foot.station + distance),
    )
