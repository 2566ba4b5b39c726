"""Errors of a car against the trajectory it steers along (paper, "Computation of Feedback Errors").

A car that has left its path while it received nothing comes back without a jerk (`Rejoining`).

The paper's `e_lat = R − distance` holds on left turns only, and its `y = mx + c` fails for roads
that run north; the signed form of `ArcSpline.project` holds for both turns and every heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, sqrt
from typing import Protocol

from vehicles.car.dynamics import Body
from vehicles.driver.ego.own_state import Pose
from vehicles.geometry.arc_spline import ArcSpline
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import SECOND

SPACING = 0.1
"""Distance (m) between the places at which the curvature of the path behind is kept."""
PLACES = 256
"""Number of the last places that are kept at least: 26 m."""
REJOINING_LATERAL = 2.0
"""Lateral acceleration (m/s²) that the return to a path may take."""
SHORTEST_RETURN = 10.0
"""Shortest return to a path (m)."""
SLOWEST_RETURN = 8.0
"""A slower car (m/s) will soon be as fast as this again."""


class CurvedPath(Protocol):
    """The arc spline of Section III-A, or the lead's own path: curvatures (1/m) at stations (m)."""

    def curvature_at(self, station: float) -> float: ...

    def curvatures(self, start: float, step: float, count: int) -> Sequence[float]: ...


@dataclass(slots=True)
class PathBehind:
    """Curvature 1/R (Section III-B) of the path behind a car, as it was followed then.

    A trajectory is fitted to samples ahead of the car and just behind. Where it begins its
    curvature is the least certain: where a bend sets in, wrong by a quarter of the bend's. When the
    car was there, it had samples on both sides.

    `driven` is the distance (m) driven, `rest` the part of it beyond the last place; `passed` are
    the curvatures (1/m) at the places, one every `SPACING`.
    """

    driven: float = 0.0
    rest: float = 0.0
    passed: list[float] = field(default_factory=list)

    def extend(self, driven: float, errors: "TrackingErrors") -> None:
        """Extend it to the foot point of `errors`, where `driven` (m) in all are driven."""
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
        """Curvature (1/m) at `count` places, `step` (m) apart, the first `start` (m, < 0) ahead.

        Each is that of the nearest place passed.
        """
        passed, newest = self.passed, len(self.passed) - 1
        first, pace = newest + (start + self.rest) / SPACING + 0.5, step / SPACING
        if (
            first >= 0.0 and int(first + (count - 1) * pace) <= newest
        ):  # the usual case: all are held
            return [passed[int(first + k * pace)] for k in range(count)]
        return [passed[min(max(int(first + k * pace), 0), newest)] for k in range(count)]


@dataclass(slots=True)
class TrackingErrors:
    """e_lat (m, left of the path positive), θ̃ (rad), dθ̃/dt (rad/s), path curvature (1/m).

    Section III-B, with signed curvature 1/R; the car's errors in eq. (7).
    The foot point is at `station` (m) of `path`; without a path its curvature is taken as constant.
    `behind` is the path as it was followed when the car was there, if that is known.
    """

    lateral: float
    heading: float
    yaw_rate: float
    curvature: float
    path: CurvedPath | None = field(default=None, compare=False, repr=False)
    station: float = field(default=0.0, compare=False, repr=False)
    behind: PathBehind | None = field(default=None, compare=False, repr=False)

    def curvature_ahead(self, distance: float) -> float:
        """Signed curvature (1/m) `distance` (m) ahead of the foot point; 1/R of eq. (6) at 0."""
        return (
            self.curvature if self.path is None else self.path.curvature_at(self.station + distance)
        )

    def curvatures_ahead(self, start: float, step: float, count: int) -> Sequence[float]:
        """`curvature_ahead` at `count` places, `step` (m) apart, the first `start` (m) ahead."""
        if self.path is None:
            return [self.curvature] * count
        return self.path.curvatures(self.station + start, step, count)

    def curvatures_driven(self, start: float, step: float, count: int) -> Sequence[float]:
        """`curvatures_ahead`, but behind the foot point those of `behind`, if there is one."""
        if self.behind is None or start >= 0.0:
            return self.curvatures_ahead(start, step, count)
        passed = min(ceil(-start / step), count)
        ahead = self.curvatures_ahead(start + passed * step, step, count - passed)
        return [*self.behind.curvatures(start, step, passed), *ahead]


def track(spline: ArcSpline, pose: Pose | Body) -> TrackingErrors:
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

    A steering law would turn its wheels at once by all that the error requires. So the error to
    be corrected is that from a cubic (Hermite) which leads from the car's place and heading to the
    path, as long as a mild lateral acceleration requires.
    """

    def __init__(self) -> None:
        self._return: _Return | None = None
        self._driven = 0.0
        self._last_at = 0
        self._wanted = False

    @property
    def is_active(self) -> bool:
        return self._wanted or self._return is not None

    def begin(self) -> None:
        """Begin at the next errors."""
        self._wanted = True

    def corrected(self, now: int, errors: TrackingErrors, speed: float) -> TrackingErrors:
        """Errors from the return at `now` (ns) and `speed` (m/s), or `errors` without one."""
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
