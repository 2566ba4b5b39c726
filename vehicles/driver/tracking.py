"""Errors of a car against the trajectory it steers along (paper, "Computation of Feedback Errors").

A car that has left its path while it received nothing comes back without a jerk (`Rejoining`).

The paper's `e_lat = R − distance` holds on left turns only, and its `y = mx + c` fails for roads
that run north; the signed form of `ArcSpline.project` holds for both turns and every heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, sqrt
from typing import Protocol

from vehicles.geometry.arc_spline import ArcSpline
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import SECOND

SPACING = 0.1
"""Distance (m) between the places at which the curvature of the way behind is kept."""
PLACES = 256
"""So many of the last places are kept at least: 26 m."""
REJOINING_LATERAL = 2.0
"""Lateral acceleration (m/s²) that the return to a path may take."""
SHORTEST_RETURN = 10.0
"""Shortest return to a path (m)."""
SLOWEST_RETURN = 8.0
"""A slower car (m/s) will soon be as fast as this again."""


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


@dataclass(slots=True)
class _Return:
    """A return to a path: its first lateral error (m) and heading error (rad), its length (m)."""

    lateral: float
    heading: float
    length: float

    def at(self, driven: float) -> tuple[float, float]:
        """Lateral (m) and heading error (rad) after `driven` (m): cubic, level at its end."""
        u = driven / self.length
        rest = 1.0 - u
        level, slope = (1.0 + 2.0 * u) * rest * rest, u * rest * rest
        lateral = self.lateral * level + self.heading * self.length * slope
        bent = -6.0 * u * rest * self.lateral / self.length
        return lateral, bent + self.heading * rest * (1.0 - 3.0 * u)


class Rejoining:
    """Takes the car from where it is to a path that is received again.

    A steering law would turn its wheels by all that the error asks for, at once. So the error to
    be corrected is that from a cubic (Hermite) which leads from the car's place and heading to the
    path, as long as it needs to be for a mild lateral acceleration.
    """

    def __init__(self) -> None:
        self._return: _Return | None = None
        self._driven = 0.0
        self._last_at = 0
        self._wanted = False

    @property
    def under_way(self) -> bool:
        """Whether the car is still returning."""
        return self._wanted or self._return is not None

    def begin(self) -> None:
        """Begin at the next errors: the path has become another one."""
        self._wanted = True

    def from_there(self, now: int, errors: TrackingErrors, speed: float) -> TrackingErrors:
        """Errors from the return at `now` (ns) and `speed` (m/s), or as they are (Hermite)."""
        span, self._last_at = (now - self._last_at) / SECOND, now
        if self._wanted:
            self._return, self._driven, self._wanted = _return_to(errors, speed), 0.0, False
        elif self._return is not None:
            self._driven += speed * span
        if self._return is None or self._driven >= self._return.length:
            self._return = None
            return errors
        lateral, heading = self._return.at(self._driven)
        return replace(errors, lateral=errors.lateral - lateral, heading=errors.heading - heading)


def _return_to(errors: TrackingErrors, speed: float) -> _Return:
    """The shortest cubic whose curvature, at most 6 e / D² + 4 θ / D, is mild at this speed."""
    most = REJOINING_LATERAL / max(speed, SLOWEST_RETURN) ** 2
    slope, bend = 4.0 * abs(errors.heading), 6.0 * abs(errors.lateral)
    length = (slope + sqrt(slope * slope + 4.0 * most * bend)) / (2.0 * most)
    return _Return(errors.lateral, errors.heading, max(length, SHORTEST_RETURN))
