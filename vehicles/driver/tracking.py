"""Errors of a car against its trajectory (paper, "Computation of Feedback Errors").

The paper's `e_lat = R − distance` holds on left turns only, and its `y = mx + c` fails for roads
that run north; the signed form of `ArcSpline.project` holds for both turns and every heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf, nan, remainder, sqrt, tau
from typing import NamedTuple, Protocol

from vehicles.car.dynamics import Body
from vehicles.driver.own_state import Pose
from vehicles.geometry.arc_spline import ArcSpline
from vehicles.geometry.sampled_path import Foot
from vehicles.schedule import SECOND

SPACING = 0.1  # Distance (m) between stored curvatures of the path behind
MIN_STORED = 256  # At least this number of curvatures is kept: 26 m
REJOINING_LATERAL = 2.0  # Limit (m/s²) of the lateral acceleration during the return to a path
REJOINING_ANGLE = 0.2  # Largest angle (rad) between the return and the path
SHORTEST_RETURN = 10.0  # Shortest return to a path (m)
SLOWEST_RETURN = 8.0  # Speed (m/s) for which slower cars plan, as they accelerate
JUMP = 0.3  # A change of the lateral error by more than this (m) within a tick is a new path
MOST_PLANS = 3  # A return is planned again up to three times; more jumps are noise
FAR, SLOW = 1.75, 3.0  # Half a lane (m) beside a path, beyond which a car is slow (m/s)
FARTHEST = 10.0  # A car more than this (m) beside a path stops instead
STEEPEST = 1.0  # So does a car whose heading differs by more than this (rad)


class CurvedPath(Protocol):
    """Curvatures (1/m) at stations (m) of the arc spline of Section III-A or of the lead's path."""

    def curvatures(self, start: float, step: float, count: int) -> Sequence[float]: ...


@dataclass(slots=True)
class PathBehind:
    """Curvature 1/R (Section III-B) of the path behind a car, as used when the car was there.

    A trajectory begins just behind the car, and its curvature is least certain there: at the start
    of a bend it is wrong by a quarter. When the car was there, it had samples on both sides.

    `driven` is the distance (m) driven, `rest` the part of it beyond the last stored curvature;
    `passed` are the curvatures (1/m), one every `SPACING`.
    """

    driven: float = 0.0
    rest: float = 0.0
    passed: list[float] = field(default_factory=list)

    def extend(self, driven: float, errors: "TrackingErrors") -> None:
        """Extend the path to the foot point of `errors`, at the total distance `driven` (m)."""
        self.rest += driven - self.driven
        self.driven = driven
        self.passed = self.passed or [errors.curvature]
        count = int(self.rest / SPACING)
        if count > 0:
            self.passed += errors.curvatures_ahead(SPACING - self.rest, SPACING, count)
            self.rest -= count * SPACING
        if len(self.passed) > 2 * MIN_STORED:
            del self.passed[:-MIN_STORED]

    def curvatures(self, start: float, step: float, count: int) -> list[float]:
        """Stored curvatures (1/m) nearest to `count` stations, from `start` (m, < 0) by `step` (m).

        Stations are relative to the car's foot point.
        """
        passed, newest = self.passed, len(self.passed) - 1
        first, pace = newest + (start + self.rest) / SPACING + 0.5, step / SPACING
        return [passed[min(max(int(first + k * pace), 0), newest)] for k in range(count)]


@dataclass(slots=True)
class TrackingErrors:
    """e_lat (m, positive to the left), θ̃ (rad), dθ̃/dt (rad/s), path curvature (1/m).

    Section III-B, with signed curvature 1/R; the errors of eq. (7). The foot point is at `station`
    (m) of `path`; without a path the curvature is constant. `behind` is the path behind the car as
    it was followed, if known.
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
        return self.curvatures_ahead(distance, 1.0, 1)[0]

    def curvatures_ahead(self, start: float, step: float, count: int) -> Sequence[float]:
        """`curvature_ahead` at `count` stations, from `start` (m) by `step` (m)."""
        if self.path is None:
            return [self.curvature] * count
        return self.path.curvatures(self.station + start, step, count)

    def curvatures_driven(self, start: float, step: float, count: int) -> Sequence[float]:
        """`curvatures_ahead`, but those of `behind` (if known) behind the foot point."""
        if self.behind is None or start >= 0.0:
            return self.curvatures_ahead(start, step, count)
        passed = min(ceil(-start / step), count)
        ahead = self.curvatures_ahead(start + passed * step, step, count - passed)
        return [*self.behind.curvatures(start, step, passed), *ahead]


def track(spline: ArcSpline, pose: Pose | Body) -> TrackingErrors:
    """Errors of `pose` against the nearest point of `spline` (Section III-B)."""
    return errors_at(spline.project(pose.east, pose.north), spline, pose)


def errors_at(foot: Foot, path: CurvedPath, pose: Pose | Body) -> TrackingErrors:
    """Errors of `pose` against its `foot` point on a path (Section III-B).

    Heading error θ̃ = θ − θ_R in [−π, π]; yaw-rate error dθ/dt − v/R with signed R, which is the
    paper's dθ/dt on a straight line.
    """
    heading = remainder(pose.yaw - foot.yaw, tau)
    yaw_rate = pose.yaw_rate - pose.speed * foot.curvature
    return TrackingErrors(foot.lateral, heading, yaw_rate, foot.curvature, path, foot.station)


class _Return(NamedTuple):
    """A return to a path: initial lateral (m) and heading error (rad), length (m), speed (m/s)."""

    lateral: float
    heading: float
    length: float
    speed: float

    def at(self, driven: float) -> tuple[float, float]:
        """Lateral (m) and heading error (rad) after `driven` (m), by a cubic (Hermite)."""
        u = min(driven / self.length, 1.0)
        rest = 1.0 - u
        lateral = (1.0 + 2.0 * u) * self.lateral + u * self.heading * self.length
        bent = -6.0 * u * rest * self.lateral / self.length
        return rest * rest * lateral, bent + self.heading * rest * (1.0 - 3.0 * u)


class Rejoining:
    """Returns the car smoothly to a path that has jumped, as after driving without a known path.

    A steering law would react to the whole error at once. Therefore the error is measured from a
    Hermite cubic that leads from the car's position and heading to the path, long enough for a mild
    lateral acceleration and a small angle. The speed is limited to that for which the return is
    planned, to SLOW while the car is far from the path, and to 0 where it cannot return.
    """

    def __init__(self, remarks: list[str], *, enabled: bool = True) -> None:
        """A line for the log is appended to `remarks` when the car cannot return."""
        self.speed_limit = inf
        self._remarks = remarks
        self._enabled = enabled
        self._return: _Return | None = None
        self._driven = 0.0
        self._plans = self._last_at = 0
        self._last = nan

    @property
    def is_active(self) -> bool:
        return self._return is not None

    def corrected(self, now: int, errors: TrackingErrors, speed: float) -> TrackingErrors:
        """Errors relative to the return at `now` (ns) and `speed` (m/s), if there is one."""
        if not self._enabled:
            return errors
        span, self._last_at = (now - self._last_at) / SECOND, now
        last, self._last = self._last, errors.lateral
        away, turned = abs(errors.lateral), abs(errors.heading)
        if abs(errors.lateral - last) > JUMP and self._plans <= MOST_PLANS:
            self._plans += 1
            self._return, self._driven = _return_from(errors, speed), 0.0
        elif self._return is not None:
            self._driven += speed * span
            if self._driven >= self._return.length:
                self._return, self.speed_limit, self._plans = None, inf, 0
        planned = self._return
        if planned is None:
            return errors
        before, self.speed_limit = self.speed_limit, SLOW if away > FAR else planned.speed
        if away > FARTHEST or turned > STEEPEST:
            self.speed_limit = 0.0
            if before > 0.0:
                place = f"{away:.1f} m beside it, at {turned:.1f} rad to it"
                self._remarks.append(f"stops, as it cannot return to the path: {place}")
        lateral, heading = planned.at(self._driven)
        return replace(errors, lateral=errors.lateral - lateral, heading=errors.heading - heading)


def _return_from(errors: TrackingErrors, speed: float) -> _Return:
    """Shortest cubic to the path whose curvature and angle are mild at this speed (m/s).

    The curvature is at most 6 e / D² + 4 θ / D, the angle at most 1.5 e / D plus the initial one.
    """
    lateral, heading = errors.lateral, errors.heading
    # For a steep car a long return would lead away from the path first.
    planned = max(1.05 * speed, SLOW if abs(heading) > REJOINING_ANGLE else SLOWEST_RETURN)
    most = REJOINING_LATERAL / planned**2
    slope, bend = 4.0 * abs(heading), 6.0 * abs(lateral)
    length = (slope + sqrt(slope * slope + 4.0 * most * bend)) / (2.0 * most)
    flat = 1.5 * abs(lateral) / REJOINING_ANGLE
    return _Return(lateral, heading, max(length, flat, SHORTEST_RETURN), planned)
