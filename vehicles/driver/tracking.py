"""Errors of a car against the trajectory it steers along (paper, "Computation of Feedback Errors").

The paper's `e_lat = R − distance` holds on left turns only, and its `y = mx + c` fails for roads
that run north; the signed form of `ArcSpline.project` holds for both turns and every heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Protocol

from vehicles.geometry.arc_spline import ArcSpline
from vehicles.geometry.geodesy import wrap_angle

SPACING = 0.1
"""Distance (m) between the places at which the curvature of the way behind is kept."""
PLACES = 256
"""So many of the last places are kept at least: 26 m."""


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
class WayBehind:
    """The way that a car came, as it was followed then: its curvature 1/R of Section III-B.

    A trajectory is fitted to samples ahead of the car and just behind. Where it begins its
    curvature is the least sure: where a bend sets in, wrong by a quarter of the bend's. When the
    car was there, it had samples on both sides.

    `driven` is the distance (m) that the car has come, `rest` what of it lies beyond the last place
    `passed`, one every `SPACING`, whose curvatures (1/m) these are.
    """

    driven: float = 0.0
    rest: float = 0.0
    passed: list[float] = field(default_factory=list)

    def go_on(self, driven: float, errors: "TrackingErrors") -> None:
        """Go on until so much (m) is driven in all, to the foot point of these (Section III-B)."""
        self.rest += driven - self.driven
        self.driven = driven
        self.passed = self.passed or [errors.curvature]
        count = int(self.rest / SPACING)
        if count > 0:
            self.passed += errors.curvatures_ahead(SPACING - self.rest, SPACING, count)
            self.rest -= count * SPACING
        if len(self.passed) > 2 * PLACES:
            del self.passed[:-PLACES]

    def curvatures(self, start: float, step: float, count: int) -> list[float]:
        """Curvature (1/m), as it was on the arcs of Section III-A, at the nearest places passed.

        They are `count`, `step` (m) apart, from `start` (m, negative) ahead of the car on.
        """
        passed, newest = self.passed, len(self.passed) - 1
        first, pace = newest + (start + self.rest) / SPACING + 0.5, step / SPACING
        if first >= 0.0 and int(first + (count - 1) * pace) <= newest:  # as mostly: all are held
            return [passed[int(first + k * pace)] for k in range(count)]
        return [passed[min(max(int(first + k * pace), 0), newest)] for k in range(count)]


@dataclass(slots=True)
class TrackingErrors:
    """e_lat (m, left of the path positive), θ̃ (rad), dθ̃/dt (rad/s), path curvature (1/m).

    Section III-B, with signed curvature 1/R; the car's errors in eq. (7).
    The foot point is at `station` (m) of `path`; without a path its curvature is taken as constant.
    The way `behind` is as it was followed when the car was there, if that is known.
    """

    lateral: float
    heading: float
    yaw_rate: float
    curvature: float
    path: Curved | None = field(default=None, compare=False, repr=False)
    station: float = field(default=0.0, compare=False, repr=False)
    behind: WayBehind | None = field(default=None, compare=False, repr=False)

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

    def curvatures_driven(self, start: float, step: float, count: int) -> Sequence[float]:
        """As `curvatures_ahead`, of eq. (6), but behind the foot point as they were followed there.

        Without a way `behind` they are the same.
        """
        if self.behind is None or start >= 0.0:
            return self.curvatures_ahead(start, step, count)
        passed = min(ceil(-start / step), count)
        ahead = self.curvatures_ahead(start + passed * step, step, count - passed)
        return [*self.behind.curvatures(start, step, passed), *ahead]


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
