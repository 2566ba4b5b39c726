"""Plausibility of received poses: the one place where a follower decides whether to use a pose.

`transport.links.link` has checked that a message can be a pose at all (stamps, coordinates,
speeds); here a pose is compared with earlier poses of its source. The innovation of a pose is its
difference from the prediction by an earlier one, as in a Kalman filter (Bar-Shalom, Li,
Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 5.4), normalised by
its standard deviation, and gated like PX4's EKF2. A source that is consistently wrong is not
detected: always beside the road, or permanently displaced.
"""

from collections import Counter, deque
from dataclasses import dataclass
from math import cos, hypot, inf, isfinite, remainder, sin, sqrt, tau
from typing import Final, Literal, NamedTuple

from vehicles.car.gnss_settings import GnssSettings
from vehicles.geometry.sampled_path import HARDEST_BRAKING, drivable
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

Distrust = Literal["", "frozen", "jumping", "impossible", "over-confident"]
"""Verdict on a pose; empty if it is trusted.

frozen          the position repeats although the speed is not zero
jumping         a position or heading that the car cannot have reached
impossible      numbers or a change of speed that are impossible, or positions that contradict them
over-confident  used, but positions scatter more than stated
"""
REFUSED: tuple[Distrust, ...] = ("frozen", "jumping", "impossible")

CORNERING: Final = 9.0  # Acceleration (m/s²) of any manoeuvre: limit of dry tyres
MAX_YAW_ACCELERATION: Final = 8.0  # rad/s², all friction at one axle, rounded up
LEAST_VARIANCE: Final = 1e-12  # rad², of a heading without noise
SLIP_ARM: Final = 1.5  # Lateral speed over yaw rate (m): from rear axle to antenna
SLIP_ARM_GROWTH: Final = 0.002  # Its growth (s²/m) with the squared speed, by steady slip
ANCHOR_TIME: Final = SECOND  # Time (ns) over which positions are compared with speeds
MIN_DEVIATION: Final = 0.01  # Smallest assumed deviation (m), whatever is stated
MAX_DEVIATION: Final = 5.0  # Largest one (m): with a larger one every pose would pass

WINDOW: Final = 32  # Number of poses from which over-confidence is estimated
HONEST_THIRD: Final = 0.81
"""Lower tertile of an honest source's squared innovations, chi-squared with 2 degrees of freedom.
Jumps and a second track under the same name do not disturb it."""
MIN_INFLATION: Final = 2.0
"""Least inflation of an over-confident source: two thirds of its squares exceed the honest 80 %
quantile. An honest source has that in one of ten million windows."""
MAX_INFLATION: Final = 30.0  # One solver stated a twentieth of its true deviation
RESTART_POSES: Final = 3  # Smallest number of poses that must agree on a new position
QUIET: Final = SECOND  # Time (ns) after the last refusal until a source is reported as trusted


class _Stated(NamedTuple):
    """A pose, the cosine and sine of its yaw, and its stated variance (m², per axis), clipped."""

    pose: ReceivedPose
    cosine: float
    sine: float
    variance: float


class _Innovation(NamedTuple):
    """Innovation of a pose against another one of its source.

    `east`, `north` (m) are the position minus the prediction, `manoeuvre` (m) its larger standard
    deviation, along or across the direction of travel, by any manoeuvre in between. `deviations` is
    the largest innovation of position and heading in standard deviations, `square` the squared
    normalised innovation of the position, chi-squared with 2 degrees of freedom.
    """

    east: float
    north: float
    manoeuvre: float
    deviations: float
    square: float


def _innovation(
    first: _Stated, second: _Stated, receiver: GnssSettings, inflation: float
) -> _Innovation:
    """Innovation of the `second` pose against the `first`.

    The prediction holds for any manoeuvre: the displacement is the mean velocity times the time T
    in between, and with an acceleration of at most A the error is at most A T²/4, assumed to be
    three standard deviations; so is that of the heading. `receiver` has the noise of all but
    positions; stated deviations count `inflation` times, except in the `square`.
    """
    before, pose, cosine, sine = first.pose, second.pose, second.cosine, second.sine
    span = (pose.measured_at - before.measured_at) / SECOND
    size, half, speed, speed_before = abs(span), 0.5 * span, pose.speed, before.speed
    east = pose.east - before.east - half * (speed_before * first.cosine + speed * cosine)
    north = pose.north - before.north - half * (speed_before * first.sine + speed * sine)
    turn = remainder(pose.yaw - before.yaw - half * (before.yaw_rate + pose.yaw_rate), tau)
    fastest = speed if speed > speed_before else speed_before
    slipping = max(abs(pose.yaw_rate), abs(before.yaw_rate))
    slip = slipping * (SLIP_ARM + SLIP_ARM_GROWTH * fastest * fastest)
    driven, turned = CORNERING * size * size / 12.0, MAX_YAW_ACCELERATION * size * size / 12.0
    along_variance = driven * driven + 0.5 * (size * receiver.speed_noise) ** 2
    across_variance = driven * driven + 0.5 * (size * fastest * receiver.heading_noise) ** 2
    across_variance += (size * slip) ** 2
    turn_variance = (
        turned * turned
        + 2.0 * receiver.heading_noise**2
        + 0.5 * (size * receiver.yaw_rate_noise) ** 2
    )
    along, across = east * cosine + north * sine, north * cosine - east * sine
    along, across = along * along, across * across
    stated = first.variance + second.variance
    inflated = stated * inflation * inflation
    largest = max(
        along / (along_variance + inflated),
        across / (across_variance + inflated),
        turn * turn / (turn_variance + LEAST_VARIANCE),
    )
    return _Innovation(
        east,
        north,
        sqrt(max(along_variance, across_variance)),
        sqrt(largest),
        along / (along_variance + stated) + across / (across_variance + stated),
    )


@dataclass(slots=True)
class _PoseTrack:
    """Consistent poses of a source, and the sum of their innovations since the `anchor`.

    Innovations of consecutive poses hide slow drifts. Their sum over up to a second has only the
    noise of two positions (CUSUM; Page, "Continuous inspection schemes", 1954). `inflation` is that
    at the anchor. The first of `count` poses was received at `since` (ns).
    """

    last: _Stated
    anchor: _Stated
    inflation: float
    since: int
    count: int = 1
    east: float = 0.0
    north: float = 0.0
    manoeuvre: float = 0.0

    def add(self, step: _Innovation, pose: _Stated, inflation: float, gate: float) -> bool:
        """Append a pose unless the sum of innovations is beyond the gate."""
        east, north = self.east + step.east, self.north + step.north
        manoeuvre, widest = self.manoeuvre + step.manoeuvre, max(inflation, self.inflation)
        variance = self.anchor.variance * widest * widest + pose.variance * inflation * inflation
        if max(abs(east), abs(north)) > gate * sqrt(manoeuvre * manoeuvre + variance):
            return False
        self.last = pose
        if pose.pose.measured_at - self.anchor.pose.measured_at >= ANCHOR_TIME:
            self.anchor, self.inflation = pose, inflation
            east = north = manoeuvre = 0.0
        self.east, self.north, self.manoeuvre = east, north, manoeuvre
        return True


class PoseJudge:
    """Judges the poses of one source in the order in which they are received.

    A pose is compared with the newest trusted one. Refused poses that agree with one another become
    the trusted track, so no source is excluded forever. `refused` counts poses by reason.
    `at_new_place` is True if the last pose used is the first one at a position to which no car can
    have driven. Without `receiver` only such positions are refused, and nothing is reported.
    """

    def __init__(
        self,
        name: str = "",
        receiver: GnssSettings | None = None,
        *,
        gate: float = 5.0,
        settle: float = 1.0,
        remarks: list[str] | None = None,
    ) -> None:
        """`receiver` is that of the source; `gate` is in standard deviations.

        With it, poses must agree for `settle` (s) to be trusted again. Lines for the log, such as
        "v1 distrusted: frozen", are appended to `remarks`.
        """
        self.at_new_place = False
        self.refused: Counter[Distrust] = Counter()
        self._name, self._receiver, self._gate = name, receiver, gate
        self._settle = 0 if receiver is None else round(settle * SECOND)
        self._remarks = [] if remarks is None else remarks
        self._trusted: _PoseTrack | None = None
        self._suspects: _PoseTrack | None = None
        self._squares = deque([0.0] * WINDOW, WINDOW)
        self._square, self._inflation = inf, 1.0
        self._received: ReceivedPose | None = None
        self._unmoved = 0.0
        self._refused_at = 0
        self._reported = set[Distrust]()

    def judge(self, pose: ReceivedPose) -> Distrust:
        """Verdict on a pose; with a reason in `REFUSED` it must not be used."""
        reason: Distrust = "impossible"
        self.at_new_place = False
        if isfinite(pose.east + pose.north + pose.yaw + pose.speed + pose.yaw_rate):
            variance = min(max(pose.accuracy, MIN_DEVIATION), MAX_DEVIATION) ** 2
            reason = self._verdict(_Stated(pose, cos(pose.yaw), sin(pose.yaw), variance))
        if reason in REFUSED:
            self.refused[reason] += 1
        elif self._inflation > 1.0:
            reason = "over-confident"
        if self._receiver is not None and (reason or self._reported):  # rare
            self._report(pose, reason)
        return reason

    def _verdict(self, pose: _Stated) -> Distrust:
        """Add a pose to the trusted track of its source, or to the suspects."""
        track, now = self._trusted, pose.pose.received_at
        frozen = self._is_frozen(pose)
        if track is None:
            self._trusted = _PoseTrack(pose, pose, self._inflation, now)
            return ""
        is_late, self._square = pose.pose.measured_at <= track.last.pose.measured_at, inf
        reason: Distrust = "frozen" if frozen else self._extend(track, pose)
        if is_late:
            return reason  # it changes nothing
        if reason and not frozen and self._restart(track, pose, now):
            return ""
        if not reason or frozen:
            self._suspects = None
        if not frozen and self._receiver is not None:
            self._squares.append(self._square)
            third = sorted(self._squares)[WINDOW // 3]
            inflation = min(sqrt(third / HONEST_THIRD), MAX_INFLATION)
            self._inflation = inflation if inflation >= MIN_INFLATION else 1.0
        return reason

    def _restart(self, track: _PoseTrack, pose: _Stated, now: int) -> bool:
        """Add a refused pose to the suspects, which replace the track if enough of them agree."""
        suspects = self._suspects
        if suspects is None or self._extend(suspects, pose):
            self._suspects = _PoseTrack(pose, pose, self._inflation, now)
            return False
        suspects.count += 1
        if suspects.count < RESTART_POSES or now - suspects.since < self._settle:
            return False
        self.at_new_place = not self._is_reachable(track.last, pose)
        self._trusted, self._suspects = suspects, None
        return True

    def _extend(self, track: _PoseTrack, pose: _Stated) -> Distrust:
        """Append a pose, unless it is late, to a track; returns why it contradicts it, else ""."""
        last, receiver, gate = track.last, self._receiver, self._gate
        span = (pose.pose.measured_at - last.pose.measured_at) / SECOND
        if not self._is_reachable(last, pose):
            return "jumping"
        if receiver is None:
            track.last = pose if span > 0.0 else last
            return ""
        step = _innovation(last, pose, receiver, self._inflation)
        self._square = min(self._square, step.square)
        if step.deviations > gate:
            return "jumping"
        excess = abs(pose.pose.speed - last.pose.speed) - HARDEST_BRAKING * abs(span)
        if excess > gate * (sqrt(2.0) * receiver.speed_noise + 1e-3):
            return "impossible"
        if span > 0.0 and not track.add(step, pose, self._inflation, gate):
            return "impossible"
        return ""

    def _is_reachable(self, before: _Stated, after: _Stated) -> bool:
        """Whether one car can have been at both positions, but for their stated deviations.

        After a long silence it is stricter than the innovation.
        """
        first, second = before.pose, after.pose
        distance = hypot(second.east - first.east, second.north - first.north)
        if self._receiver is not None:
            distance -= self._gate * sqrt(before.variance + after.variance)
        span = abs(second.measured_at - first.measured_at)
        return drivable(distance, span, max(abs(first.speed), abs(second.speed)))

    def _is_frozen(self, stated: _Stated) -> bool:
        """Whether the position repeats although the stated speeds must have changed it."""
        before, pose, receiver = self._received, stated.pose, self._receiver
        if receiver is None or (before is not None and pose.measured_at <= before.measured_at):
            return False
        self._received = pose
        if before is None or (pose.east, pose.north) != (before.east, before.north):
            self._unmoved = 0.0
        elif pose.speed > self._gate * receiver.speed_noise:
            span = (pose.measured_at - before.measured_at) / SECOND
            self._unmoved += 0.5 * (before.speed + pose.speed) * span
        return self._unmoved > 2.0 * self._gate * sqrt(2.0 * stated.variance)

    def _report(self, pose: ReceivedPose, reason: Distrust) -> None:
        """Log a reason once, until the source has been trusted for `QUIET`."""
        if reason in REFUSED:
            self._refused_at = pose.received_at
        elif not reason and pose.received_at - self._refused_at > QUIET:
            self._remarks.append(
                f"{self._name} trusted again; {self.refused.total()} poses refused"
            )
            self._reported.clear()
        if reason and reason not in self._reported:
            self._reported.add(reason)
            text = f"distrusted: {reason}"
            if reason not in REFUSED:
                text = f"{reason}: positions scatter {self._inflation:.1f} times as much as stated"
            self._remarks.append(f"{self._name} {text}")
