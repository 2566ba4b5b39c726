"""Errors of a car against the trajectory it steers along (paper, "Computation of Feedback Errors").

The paper's `e_lat = R − distance` holds on left turns only, and its `y = mx + c` fails for roads
that run north; the signed form of `ArcSpline.project` holds for both turns and every heading.
"""

from collections.abc import Sequence
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


class Curved(Protocol):
    """A path whose curvature is known (the arc spline of Section III-A, or the lead's own)."""

    def curvature_at(self, station: float) -> float:
        """Signed curvature (1/m) at `station` (m), 1/R of Section III-A."""
        ...

    def curvatures(self, start: float, step: float, count: int) -> Sequence[float]:
        """The same at `count` places `step` (m) apart from station `start` (m) on."""
        ...


@dataclass(slots=True)
class TrackingErrors:
    """e_lat (m, left of the path positive), θ̃ (rad), dθ̃/dt (rad/s), path curvature (1/m).

    Section III-B, with signed curvature 1/R; the car's errors in eq. (7).
    The foot point is at `station` (m) of `path`; without a path its curvature is taken as constant.
    """

    lateral: float
    heading: float
    yaw_rate: float
    curvature: float
    path: Curved | None = field(default=None, compare=False, repr=False)
    station: float = field(default=0.0, compare=False, repr=False)

    def curvature_ahead(self, distance: float) -> float:
        """Signed curvature (1/m) `distance` (m) ahead of the foot point; 1/R of eq. (6) at 0.

        Behind it for negative distances.
        """
        return (
            self.curvature if self.path is None else self.path.curvature_at(self.station + distance)
        )

    def curvatures_ahead(self, start: float, step: float, count: int) -> Sequence[float]:
        """Signed curvature (1/m), as `curvature_ahead`, of eq. (6), at `count` places.

        They are `step` (m) apart, the first `start` (m) ahead.
        """
        if self.path is None:
            return [self.curvature] * count
        return self.path.curvatures(self.station + start, step, count)


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
        path=spline,
        station=foot.station,
    )
