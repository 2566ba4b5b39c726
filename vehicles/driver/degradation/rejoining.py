"""Back to the path, without a jerk, of a car that has left it while it heard nobody."""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from vehicles.driver.tracking import TrackingErrors
from vehicles.schedule import SECOND

LATERAL: Final = 2.0
"""Lateral acceleration (m/s²) that the way back may take."""
SHORTEST: Final = 10.0
"""Shortest way back (m)."""
SLOWEST: Final = 8.0
"""A car that is slower (m/s) will soon be as fast as this again."""


@dataclass(slots=True)
class _Way:
    """A way back: lateral error (m) and heading error (rad) that it begins with, its length (m)."""

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
    """Takes the car from where it is to a path that it hears of again.

    A steering law would turn its wheels by all that the error asks for, at once. So the error to
    be corrected is that from a cubic (Hermite) which leads from the car's place and heading to the
    path, as long as it needs to be for a mild lateral acceleration.
    """

    def __init__(self) -> None:
        self._way: _Way | None = None
        self._driven = 0.0
        self._last_at = 0
        self._wanted = False

    @property
    def under_way(self) -> bool:
        """Whether the car is still on its way back."""
        return self._wanted or self._way is not None

    def want(self) -> None:
        """Begin at the next errors: the path has become another one."""
        self._wanted = True

    def from_there(self, now: int, errors: TrackingErrors, speed: float) -> TrackingErrors:
        """Errors from the way back at `now` (ns) and `speed` (m/s), or as they are (Hermite)."""
        span, self._last_at = (now - self._last_at) / SECOND, now
        if self._wanted:
            self._way, self._driven, self._wanted = _way_back(errors, speed), 0.0, False
        elif self._way is not None:
            self._driven += speed * span
        if self._way is None or self._driven >= self._way.length:
            self._way = None
            return errors
        lateral, heading = self._way.at(self._driven)
        return replace(errors, lateral=errors.lateral - lateral, heading=errors.heading - heading)


def _way_back(errors: TrackingErrors, speed: float) -> _Way:
    """The shortest cubic whose curvature, at most 6 e / D² + 4 θ / D, is mild at this speed."""
    most = LATERAL / max(speed, SLOWEST) ** 2
    slope, bend = 4.0 * abs(errors.heading), 6.0 * abs(errors.lateral)
    length = (slope + sqrt(slope * slope + 4.0 * most * bend)) / (2.0 * most)
    return _Way(errors.lateral, errors.heading, max(length, SHORTEST))
