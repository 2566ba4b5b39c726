"""Innovation of a pose: its difference from the prediction by earlier poses of its source.

As in a Kalman filter (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, 5.4), normalised by its standard deviation. The prediction holds for any
manoeuvre: the displacement between two poses is their mean velocity times the time T between them,
and with an acceleration of at most A the error is at most A T² / 4.
"""

from functools import lru_cache
from math import cos, remainder, sin, sqrt, tau
from typing import Final, NamedTuple

from vehicles.car.positioning.noise import GnssNoise
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

CORNERING: Final = 9.0  # Acceleration (m/s²) across the road: limit of dry tyres
MAX_YAW_ACCELERATION: Final = 8.0  # rad/s², all friction at one axle, rounded up
SLIP_ARM: Final = 1.5  # Lateral speed over yaw rate (m): from rear axle to antenna
SLIP_ARM_GROWTH: Final = 0.002  # Its growth (s²/m) with the squared speed, by steady slip
ANCHOR_TIME: Final = SECOND  # Time (ns) over which positions are compared with speeds
MIN_DEVIATION: Final = 0.01  # Smallest assumed deviation (m), whatever is stated
MAX_DEVIATION: Final = 5.0  # Largest one (m): with a larger one every pose would pass


class Innovation(NamedTuple):
    """Innovation of a pose against another one of its source.

    `span` (s) lies between them, negative for an earlier pose. `east`, `north` (m) are the position
    minus the prediction, `along` and `across` (m) the same in the direction of travel; their
    variances (m²) are those of the manoeuvre in between, `stated` (m²) is that of both positions as
    stated by the source. `east_driven`, `north_driven` (m) are the predicted displacement. `square`
    is the squared normalised innovation, chi-squared with 2 degrees of freedom.
    """

    span: float
    east: float
    north: float
    along: float
    across: float
    along_variance: float
    across_variance: float
    stated: float
    east_driven: float
    north_driven: float
    square: float

    def deviations(self, inflation: float = 1.0) -> float:
        """Innovation of the larger axis in standard deviations; stated ones times `inflation`."""
        noise = self.stated * inflation * inflation
        along = abs(self.along) / sqrt(self.along_variance + noise)
        across = abs(self.across) / sqrt(self.across_variance + noise)
        return across if across > along else along


@lru_cache(maxsize=64)  # receivers mostly state the same accuracy
def stated_variance(accuracy: float) -> float:
    """Variance (m²) per axis for a stated standard deviation `accuracy` (m), clipped."""
    return min(max(accuracy, MIN_DEVIATION), MAX_DEVIATION) ** 2


def innovation(before: ReceivedPose, pose: ReceivedPose, noise: GnssNoise) -> Innovation:
    """Innovation of the position of `pose` against `before`.

    `noise` is that of all but positions. The manoeuvre is assumed normal, with a third of the
    extreme as standard deviation.
    """
    span = (pose.measured_at - before.measured_at) / SECOND
    size, half = abs(span), 0.5 * span
    cosine, sine = cos(pose.yaw), sin(pose.yaw)
    speed, speed_before = pose.speed, before.speed
    east_driven = half * (speed_before * cos(before.yaw) + speed * cosine)
    north_driven = half * (speed_before * sin(before.yaw) + speed * sine)
    east = pose.east - before.east - east_driven
    north = pose.north - before.north - north_driven
    fastest = speed if speed > speed_before else speed_before
    turning, turning_before = abs(pose.yaw_rate), abs(before.yaw_rate)
    slipping = turning if turning > turning_before else turning_before
    slip = slipping * (SLIP_ARM + SLIP_ARM_GROWTH * fastest * fastest)
    driven = (CORNERING * size * size / 12.0) ** 2
    along_variance = driven + 0.5 * (size * noise.speed) ** 2
    across_variance = driven + 0.5 * (size * fastest * noise.heading) ** 2 + (size * slip) ** 2
    stated = stated_variance(before.accuracy) + stated_variance(pose.accuracy)
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
        east_driven,
        north_driven,
        along * along / (along_variance + stated) + across * across / (across_variance + stated),
    )


def heading_innovation(before: ReceivedPose, pose: ReceivedPose, noise: GnssNoise) -> float:
    """Innovation of the heading of `pose` against `before`, in standard deviations."""
    span = (pose.measured_at - before.measured_at) / SECOND
    size = abs(span)
    turn = remainder(pose.yaw - before.yaw - 0.5 * span * (before.yaw_rate + pose.yaw_rate), tau)
    variance = (
        2.0 * noise.heading**2
        + 0.5 * (size * noise.yaw_rate) ** 2
        + (MAX_YAW_ACCELERATION * size * size / 12.0) ** 2
    )
    return abs(turn) / sqrt(variance) if variance else 0.0


class PoseTrack:
    """Consistent poses of a source, and the sum of their innovations.

    Innovations of consecutive poses hide slow drifts. Their sum since the anchor, a pose of up to a
    second ago, has only the noise of two positions (CUSUM; Page, 1954).
    """

    def __init__(self, pose: ReceivedPose, inflation: float) -> None:
        """Begin at `pose`, whose standard deviation is the stated one times `inflation`."""
        self.last = pose
        self._anchor = pose
        self._anchor_inflation = inflation
        self._east = self._north = self._spread = self._turned = 0.0

    def cumulative_deviation(
        self, residual: Innovation, pose: ReceivedPose, inflation: float
    ) -> float:
        """Sum of innovations up to `pose`, in standard deviations."""
        along, across = residual.along_variance, residual.across_variance
        spread = self._spread + sqrt(across if across > along else along)
        at_anchor = self._anchor_inflation
        at_anchor = inflation if inflation > at_anchor else at_anchor
        anchored = stated_variance(self._anchor.accuracy) * at_anchor * at_anchor
        noise = anchored + stated_variance(pose.accuracy) * inflation * inflation
        deviation = sqrt(spread * spread + noise)
        east, north = abs(self._east + residual.east), abs(self._north + residual.north)
        return (north if north > east else east) / deviation

    def lateral_acceleration(self, pose: ReceivedPose) -> float:
        """Mean acceleration across the road (m/s²) up to `pose`; 0 over less than half a second.

        Speed times the change of heading: over half a second the lateral speed of eq. (1), which
        dominates the yaw rate of a swerving car, averages out.
        """
        span = pose.measured_at - self._anchor.measured_at
        if 2 * span < ANCHOR_TIME:
            return 0.0
        turned = self._turned + remainder(pose.yaw - self.last.yaw, tau)
        return min(self._anchor.speed, pose.speed) * abs(turned) * SECOND / span

    def push(self, residual: Innovation, pose: ReceivedPose, inflation: float) -> None:
        self._turned += remainder(pose.yaw - self.last.yaw, tau)
        self.last = pose
        if pose.measured_at - self._anchor.measured_at >= ANCHOR_TIME:
            self._anchor, self._anchor_inflation = pose, inflation
            self._east = self._north = self._spread = self._turned = 0.0
            return
        self._east += residual.east
        self._north += residual.north
        along, across = residual.along_variance, residual.across_variance
        self._spread += sqrt(across if across > along else along)
