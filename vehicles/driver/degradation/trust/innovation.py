"""How far a pose lies from where earlier poses of its source say it should be.

Innovations as of a Kalman filter (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to
Tracking and Navigation, 2001, 5.4): what was measured less what was predicted, over the deviation
of that. The prediction holds for whatever a
car may do: the way between two poses is their mean velocity times the time between them, and with
an acceleration of at most A no car is further from there than A T² / 4.
"""

from functools import lru_cache
from math import cos, remainder, sin, sqrt, tau
from typing import Final, NamedTuple

from vehicles.car.gnss import Fix
from vehicles.car.positioning.noise import GnssNoise
from vehicles.schedule import SECOND

BRAKING: Final = 8.0
"""Acceleration along the road (m/s²) beyond which no car drives or brakes."""
CORNERING: Final = 9.0
"""Acceleration across the road (m/s²) beyond which none corners: what dry tyres carry."""
TURNING_UP: Final = 8.0
"""Yaw acceleration (rad/s²) of a car whose one axle alone uses all its friction, rounded up."""
SLIP_ARM: Final = 1.5
"""Lateral speed over yaw rate (m) at walking pace: from the rear axle to the antenna."""
SLIP_ARM_GROWTH: Final = 0.002
"""What tyres that slip add to it (s²/m), times the squared speed: the steady-state model's."""
BASE: Final = SECOND
"""Over so long (ns) the way told is held against the speeds told."""
LEAST_DEVIATION: Final = 0.01
"""No receiver of a car is taken to know its place better (m)."""
MOST_DEVIATION: Final = 5.0
"""None is taken to know it worse (m): else a pose that says so would pass whatever it tells."""


class Innovation(NamedTuple):
    """Innovation (of a Kalman filter) of a pose against another one of its source.

    `span` (s) lies between them, negative for an earlier pose. `east`, `north` (m) are the place
    less the prediction, `along` and `across` (m) the same by the direction of travel; the variances
    (m²) are those of what the car may have done meanwhile, `stated` (m²) that of both places by
    what the source says. `way` (m, m) is the prediction.
    """

    span: float
    east: float
    north: float
    along: float
    across: float
    along_variance: float
    across_variance: float
    stated: float
    way: tuple[float, float]

    def square(self) -> float:
        """Squared normalised innovation of the place, chi-squared of 2 (Kalman filter)."""
        along, across, noise = self.along, self.across, self.stated
        return along * along / (self.along_variance + noise) + across * across / (
            self.across_variance + noise
        )

    def deviations(self, inflation: float = 1.0) -> float:
        """Innovation of the place in its deviations, the larger axis (Kalman filter).

        `inflation` (ratio) is by how much deviations stated are taken for larger.
        """
        noise = self.stated * inflation * inflation
        along = abs(self.along) / sqrt(self.along_variance + noise)
        across = abs(self.across) / sqrt(self.across_variance + noise)
        return across if across > along else along


@lru_cache(maxsize=64)  # receivers mostly say the same again and again
def stated_variance(accuracy: float) -> float:
    """Variance (m²) of a place per axis by its own account, within reason.

    `accuracy` (m) is the deviation that its fix states.
    """
    return min(max(accuracy, LEAST_DEVIATION), MOST_DEVIATION) ** 2


def innovation(before: Fix, fix: Fix, noise: GnssNoise) -> Innovation:
    """Innovation of the place of `fix` against `before` (Kalman filter).

    `noise` is that of all but places. What the car may have done is normal with a third of the most
    as its deviation.
    """
    span = (fix.measured_at - before.measured_at) / SECOND
    size, half = abs(span), 0.5 * span
    cosine, sine = cos(fix.yaw), sin(fix.yaw)
    speed, speed_before = fix.speed, before.speed
    way_east = half * (speed_before * cos(before.yaw) + speed * cosine)
    way_north = half * (speed_before * sin(before.yaw) + speed * sine)
    east = fix.east - before.east - way_east
    north = fix.north - before.north - way_north
    fastest = speed if speed > speed_before else speed_before
    turning, turning_before = abs(fix.yaw_rate), abs(before.yaw_rate)
    slipping = turning if turning > turning_before else turning_before
    slip = slipping * (SLIP_ARM + SLIP_ARM_GROWTH * fastest * fastest)
    driven = (CORNERING * size * size / 12.0) ** 2
    along_variance = driven + 0.5 * (size * noise.speed) ** 2
    across_variance = driven + 0.5 * (size * fastest * noise.heading) ** 2 + (size * slip) ** 2
    stated = stated_variance(before.accuracy) + stated_variance(fix.accuracy)
    along, across = east * cosine + north * sine, north * cosine - east * sine
    return Innovation(
        span,
        east,
        north,
        along,
        across,
        along_variance,
        across_variance,
        stated,
        (way_east, way_north),
    )


def turned(before: Fix, fix: Fix, noise: GnssNoise) -> float:
    """Innovation of the heading of `fix` against `before`, in its deviations (Kalman filter)."""
    span = (fix.measured_at - before.measured_at) / SECOND
    size = abs(span)
    turn = remainder(
        fix.yaw - before.yaw - 0.5 * span * (before.yaw_rate + fix.yaw_rate),
        tau,
    )
    variance = (
        2.0 * noise.heading**2
        + 0.5 * (size * noise.yaw_rate) ** 2
        + (TURNING_UP * size * size / 12.0) ** 2
    )
    return abs(turn) / sqrt(variance) if variance else 0.0


def gained(before: Fix, fix: Fix, noise: GnssNoise) -> float:
    """Innovation of the speed in its deviations, beyond what a car can (Kalman filter)."""
    size = abs((fix.measured_at - before.measured_at) / SECOND)
    gain = abs(fix.speed - before.speed) - BRAKING * size
    return gain / (sqrt(2.0) * noise.speed + 1e-3) if gain > 0.0 else 0.0


class PoseTrack:
    """Poses of a source that agree with one another, the innovation of the next one, and its sum.

    Innovations of poses one after the other hide what goes wrong slowly. Their sum since a pose of
    up to a second ago, the anchor, has the noise of two places alone (CUSUM; Page, 1954).
    """

    def __init__(self, fix: Fix, inflation: float) -> None:
        """Begin at `fix`, whose place is so many times worse than stated (ratio)."""
        self.last = fix
        self._anchor = fix
        self._anchor_inflation = inflation
        self._east = self._north = self._spread = self._turned = 0.0

    def strays(self, one: Innovation, fix: Fix, inflation: float) -> float:
        """Sum of innovations with that of `fix`, in deviations (CUSUM).

        The anchor stays as bad as it was taken for, however exact its source has become since.
        """
        along, across = one.along_variance, one.across_variance
        spread = self._spread + sqrt(across if across > along else along)
        at_anchor = self._anchor_inflation
        at_anchor = inflation if inflation > at_anchor else at_anchor
        anchored = stated_variance(self._anchor.accuracy) * at_anchor * at_anchor
        noise = anchored + stated_variance(fix.accuracy) * inflation * inflation
        deviation = sqrt(spread * spread + noise)
        east, north = abs(self._east + one.east), abs(self._north + one.north)
        return (north if north > east else east) / deviation

    def cornering(self, fix: Fix) -> float:
        """Mean acceleration across the road (m/s²) up to `fix`, 0 before it can be told.

        Speed times the change of heading, over half a second at least: in it the lateral speed of
        eq. (1) averages out, which a swerving car's yaw rate alone is full of.
        """
        span = fix.measured_at - self._anchor.measured_at
        if 2 * span < BASE:
            return 0.0
        turned = self._turned + remainder(fix.yaw - self.last.yaw, tau)
        return min(self._anchor.speed, fix.speed) * abs(turned) * SECOND / span

    def push(self, one: Innovation, fix: Fix, inflation: float) -> None:
        """Go on with `fix`, a newer pose, and its innovation (Kalman filter)."""
        self._turned += remainder(fix.yaw - self.last.yaw, tau)
        self.last = fix
        if fix.measured_at - self._anchor.measured_at >= BASE:
            self._anchor, self._anchor_inflation = fix, inflation
            self._east = self._north = self._spread = self._turned = 0.0
            return
        self._east += one.east
        self._north += one.north
        along, across = one.along_variance, one.across_variance
        self._spread += sqrt(across if across > along else along)
