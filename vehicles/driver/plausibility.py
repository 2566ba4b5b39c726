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
from itertools import pairwise
from math import cos, hypot, isfinite, remainder, sin, sqrt, tau
from typing import Final, Literal, NamedTuple

from vehicles.car.gnss_settings import GnssSettings
from vehicles.geometry.sampled_path import HARDEST_BRAKING, drivable
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

Distrust = Literal["", "frozen", "jumping", "impossible", "ghost", "over-confident"]
"""Verdict on a pose; empty if it is trusted.

frozen          the position repeats although the speed is not zero
jumping         a position or heading that the car cannot have reached
impossible      numbers or a change of speed that are impossible, or positions that contradict them
ghost           two tracks under one name, and the pose is not on the trusted one
over-confident  used, but positions scatter more than stated
"""
REFUSED: tuple[Distrust, ...] = ("frozen", "jumping", "impossible", "ghost")

CORNERING: Final = 9.0  # Acceleration (m/s²) of any manoeuvre: limit of dry tyres
MAX_YAW_ACCELERATION: Final = 8.0  # rad/s², all friction at one axle, rounded up
SLIP_ARM: Final = 1.5  # Lateral speed over yaw rate (m): from rear axle to antenna
SLIP_ARM_GROWTH: Final = 0.002  # Its growth (s²/m) with the squared speed, by steady slip
ANCHOR_TIME: Final = SECOND  # Time (ns) over which positions are compared with speeds
MIN_DEVIATION: Final = 0.01  # Smallest assumed deviation (m), whatever is stated
MAX_DEVIATION: Final = 5.0  # Largest one (m): with a larger one every pose would pass

WINDOW: Final = 32  # Number of poses from which over-confidence is estimated
MAX_SQUARE: Final = 15.0  # Bound of squares, so that jumps do not look over-confident
OVERCONFIDENT_SUM: Final = 95.0
CONFIDENT_SUM: Final = 60.0
"""Sums over the window above which a source is over-confident, and below which it ends. The sum of
an honest source is 36.3 with a standard deviation of 7.8 (nearly chi-squared with 43 degrees of
freedom after scaling), which exceeds 90 as rarely as a normal number exceeds 5 deviations (Wilson
and Hilferty, 1931)."""
HONEST_THIRD: Final = 0.41
"""Lower tertile of an honest source's squared innovations, each the smaller one against the last
two poses. It also holds for two tracks of which one is honest."""
MIN_INFLATION: Final = 1.5  # Below this inflation a source is not over-confident
MAX_INFLATION: Final = 30.0  # One solver stated a twentieth of its true deviation
RESTART_POSES: Final = 3  # Smallest number of poses that must agree on a new position
SUSPECT_LIFETIME: Final = 3 * SECOND  # Age (ns) up to which a refused pose supports others
RECENT_POSES: Final = 12
RETURNS: Final = 2  # Trusted poses after refused ones, of the recent ones, that make two tracks
QUIET: Final = SECOND  # Time (ns) after the last refusal until a source is reported as trusted


class Innovation(NamedTuple):
    """Innovation of a pose against another one of its source.

    `span` (s) lies between them. `east`, `north` (m) are the position minus the prediction, `moved`
    (m) is the predicted displacement. `manoeuvre` (m) is the standard deviation by the manoeuvre in
    between along and across the direction of travel, the larger one; `deviations` is the larger
    axis in standard deviations, `square` the squared normalised innovation, chi-squared with 2
    degrees of freedom.
    """

    span: float
    east: float
    north: float
    moved: tuple[float, float]
    manoeuvre: float
    deviations: float
    square: float


def stated_variance(accuracy: float) -> float:
    """Variance (m²) per axis for a stated standard deviation `accuracy` (m), clipped."""
    return min(max(accuracy, MIN_DEVIATION), MAX_DEVIATION) ** 2


def innovation(
    before: ReceivedPose, pose: ReceivedPose, receiver: GnssSettings, inflation: float = 1.0
) -> Innovation:
    """Innovation of the position of `pose` against `before`.

    The prediction holds for any manoeuvre: the displacement is the mean velocity times the time T
    in between, and with an acceleration of at most A the error is at most A T²/4, assumed to be
    three standard deviations. `receiver` has the noise of all but positions; stated deviations
    count `inflation` times.
    """
    span = (pose.measured_at - before.measured_at) / SECOND
    size, half = abs(span), 0.5 * span
    cosine, sine = cos(pose.yaw), sin(pose.yaw)
    speed, speed_before = pose.speed, before.speed
    moved_east = half * (speed_before * cos(before.yaw) + speed * cosine)
    moved_north = half * (speed_before * sin(before.yaw) + speed * sine)
    east = pose.east - before.east - moved_east
    north = pose.north - before.north - moved_north
    fastest = speed if speed > speed_before else speed_before
    slipping = max(abs(pose.yaw_rate), abs(before.yaw_rate))
    slip = slipping * (SLIP_ARM + SLIP_ARM_GROWTH * fastest * fastest)
    driven = (CORNERING * size * size / 12.0) ** 2
    along_variance = driven + 0.5 * (size * receiver.speed_noise) ** 2
    across_variance = (
        driven + 0.5 * (size * fastest * receiver.heading_noise) ** 2 + (size * slip) ** 2
    )
    stated = stated_variance(before.accuracy) + stated_variance(pose.accuracy)
    along, across = east * cosine + north * sine, north * cosine - east * sine
    along, across = along * along, across * across
    inflated = stated * inflation * inflation
    largest = max(along / (along_variance + inflated), across / (across_variance + inflated))
    return Innovation(
        span,
        east,
        north,
        (moved_east, moved_north),
        sqrt(max(along_variance, across_variance)),
        sqrt(largest),
        along / (along_variance + stated) + across / (across_variance + stated),
    )


def heading_deviations(before: ReceivedPose, pose: ReceivedPose, receiver: GnssSettings) -> float:
    """Innovation of the heading of `pose` against `before`, in standard deviations."""
    span = (pose.measured_at - before.measured_at) / SECOND
    turn = remainder(pose.yaw - before.yaw - 0.5 * span * (before.yaw_rate + pose.yaw_rate), tau)
    variance = (
        2.0 * receiver.heading_noise**2
        + 0.5 * (span * receiver.yaw_rate_noise) ** 2
        + (MAX_YAW_ACCELERATION * span * span / 12.0) ** 2
    )
    return abs(turn) / sqrt(variance) if variance else 0.0


@dataclass(slots=True)
class _PoseTrack:
    """Consistent poses of a source, and the sum of their innovations since the `anchor`.

    Innovations of consecutive poses hide slow drifts. Their sum over up to a second has only the
    noise of two positions (CUSUM; Page, "Continuous inspection schemes", 1954).
    """

    last: ReceivedPose
    anchor: ReceivedPose
    anchor_inflation: float
    east: float = 0.0
    north: float = 0.0
    manoeuvre: float = 0.0

    def drift(self, found: Innovation, pose: ReceivedPose, inflation: float) -> float:
        """Sum of innovations up to `pose`, in standard deviations."""
        at_anchor = max(inflation, self.anchor_inflation)
        stated = stated_variance(self.anchor.accuracy) * at_anchor * at_anchor
        stated += stated_variance(pose.accuracy) * inflation * inflation
        deviation = hypot(self.manoeuvre + found.manoeuvre, sqrt(stated))
        return max(abs(self.east + found.east), abs(self.north + found.north)) / deviation

    def push(self, found: Innovation, pose: ReceivedPose, inflation: float) -> None:
        self.last = pose
        if pose.measured_at - self.anchor.measured_at >= ANCHOR_TIME:
            self.anchor_inflation = inflation
            self.anchor, self.east, self.north, self.manoeuvre = pose, 0.0, 0.0, 0.0
            return
        self.east, self.north = self.east + found.east, self.north + found.north
        self.manoeuvre += found.manoeuvre


class PoseJudge:
    """Judges the poses of one source in the order in which they are received.

    A pose is compared with the newest trusted one. Refused poses that agree with one another for
    `settle` become the trusted track, so no source is excluded forever. `refused` counts poses by
    reason. `at_new_place` is True if the last pose used is the first one at a position to which no
    car can have driven. Without `receiver` only such positions are refused, none reported.
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
        """`receiver` is that of the source; `gate` is in standard deviations, `settle` in s.

        Lines for the log, such as "v1 distrusted: frozen", are appended to `remarks`.
        """
        self.at_new_place = False
        self.refused: Counter[Distrust] = Counter()
        self._name, self._receiver, self._gate = name, receiver, gate
        self._settle = round(settle * SECOND)
        self._used: ReceivedPose | None = None
        self._away: list[ReceivedPose] = []
        self._remarks = [] if remarks is None else remarks
        self._trusted: _PoseTrack | None = None
        self._suspects: _PoseTrack | None = None
        self._agreed, self._agreed_since = 0, 0
        self._accepted: deque[bool] = deque(maxlen=RECENT_POSES)
        self._last: deque[ReceivedPose] = deque(maxlen=2)
        self._squares: deque[float] = deque(maxlen=WINDOW)
        self._inflation = 1.0
        self._still: ReceivedPose | None = None
        self._should_move = (0.0, 0.0, 0.0)
        self._refused_at, self._refusals = 0, 0
        self._reported = set[Distrust]()

    def judge(self, pose: ReceivedPose) -> Distrust:
        """Verdict on a pose; with a reason in `REFUSED` it must not be used."""
        reason: Distrust = "impossible"
        if isfinite(pose.east + pose.north + pose.yaw + pose.speed + pose.yaw_rate):
            reason = "" if self._receiver is None else self._verdict(pose, self._receiver)
            if reason not in REFUSED:
                reason = self._reach(pose) or reason
        if reason in REFUSED:
            self.refused[reason] += 1
        if self._receiver is not None and (reason or self._reported):  # rare
            self._report(pose, reason)
        return reason

    def deviation(self, pose: ReceivedPose) -> float:
        """Standard deviation (m, per axis) to assume for a pose instead of the stated one."""
        if self._inflation == 1.0:
            return pose.accuracy
        return min(self._inflation * max(pose.accuracy, MIN_DEVIATION), MAX_DEVIATION)

    def _reach(self, pose: ReceivedPose) -> Distrust:
        """Whether a car can have driven from the last used pose to this one; late poses pass.

        It also catches outliers of receivers that state a large deviation.
        """
        used, away = self._used, self._away
        self.at_new_place = False
        if used is not None and pose.measured_at <= used.measured_at:
            return ""
        if used is not None and not self._reachable(used, pose):
            if away and not self._reachable(away[-1], pose):
                away.clear()
            away.append(pose)
            if len(away) < RESTART_POSES:
                return "jumping"
            self.at_new_place = True
        away.clear()
        self._used = pose
        return ""

    def _reachable(self, first: ReceivedPose, second: ReceivedPose) -> bool:
        """Whether one car can have been at both positions, but for their stated deviations."""
        distance = hypot(second.east - first.east, second.north - first.north)
        if self._receiver is not None:
            stated = stated_variance(first.accuracy) + stated_variance(second.accuracy)
            distance -= self._gate * sqrt(stated)
        span = abs(second.measured_at - first.measured_at)
        return drivable(distance, span, max(abs(first.speed), abs(second.speed)))

    def _verdict(self, pose: ReceivedPose, receiver: GnssSettings) -> Distrust:
        """Compare a pose with the trusted track of its source."""
        frozen, track = self._observe(pose, receiver), self._trusted
        if track is None:
            self._trusted = _PoseTrack(pose, pose, self._inflation)
            return ""
        found, fault = self._compare(track, pose, receiver)
        reason: Distrust = "frozen" if frozen else fault
        if pose.measured_at <= track.last.measured_at:
            return reason or self._confidence  # a late pose changes nothing
        self._accepted.append(not reason)
        if not reason:
            track.push(found, pose, self._inflation)
            self._agreed = 0
            return self._confidence
        if reason != "frozen":
            returns = [after and not before for before, after in pairwise(self._accepted)]
            if sum(returns) >= RETURNS:  # alternately trusted and refused
                reason = "ghost"
        return self._suspect(pose, reason, receiver)

    def _compare(
        self, track: _PoseTrack, pose: ReceivedPose, receiver: GnssSettings
    ) -> tuple[Innovation, Distrust]:
        """Innovation of a pose, and how it contradicts a track; empty if it does not."""
        found, gate = innovation(track.last, pose, receiver, self._inflation), self._gate
        if found.deviations > gate or heading_deviations(track.last, pose, receiver) > gate:
            return found, "jumping"
        gain = abs(pose.speed - track.last.speed) - HARDEST_BRAKING * abs(found.span)
        if gain > gate * (sqrt(2.0) * receiver.speed_noise + 1e-3):
            return found, "impossible"
        if found.span > 0.0 and track.drift(found, pose, self._inflation) > gate:
            return found, "impossible"
        return found, ""

    def _suspect(self, pose: ReceivedPose, reason: Distrust, receiver: GnssSettings) -> Distrust:
        """Refuse a pose, unless it completes the poses that restart the track."""
        track, now = self._suspects, pose.received_at
        agrees = track is not None and (
            reason != "frozen" and pose.measured_at - track.last.measured_at <= SUSPECT_LIFETIME
        )
        if track is not None and agrees:
            found, fault = self._compare(track, pose, receiver)
            agrees = not fault
            if agrees and found.span > 0.0:
                track.push(found, pose, self._inflation)
        if track is None or not agrees:
            self._suspects = _PoseTrack(pose, pose, self._inflation)
            self._agreed, self._agreed_since = 1, now
            return reason
        if not self._agreed:
            self._agreed_since = now
        self._agreed += 1
        if self._agreed < RESTART_POSES or now - self._agreed_since < self._settle:
            return reason
        self._trusted, self._suspects = track, None
        return self._confidence

    @property
    def _confidence(self) -> Distrust:
        return "over-confident" if self._inflation > 1.0 else ""

    def _observe(self, pose: ReceivedPose, receiver: GnssSettings) -> bool:
        """Update the inflation of stated deviations; returns whether the position is frozen."""
        last = self._last
        if last and pose.measured_at <= last[-1].measured_at:
            return False
        frozen = False
        if last:
            found = innovation(last[-1], pose, receiver)
            frozen = self._is_frozen(found, pose, receiver)
            if not frozen:
                square = found.square
                if len(last) > 1:
                    square = min(square, innovation(last[0], pose, receiver).square)
                self._squares.append(square)
                self._set_inflation()
        last.append(pose)
        return frozen

    def _set_inflation(self) -> None:
        limit = OVERCONFIDENT_SUM if self._inflation == 1.0 else CONFIDENT_SUM
        self._inflation = 1.0
        if sum([min(square, MAX_SQUARE) for square in self._squares]) > limit:
            third = sorted(self._squares)[len(self._squares) // 3]
            inflation = min(sqrt(third / HONEST_THIRD), MAX_INFLATION)
            self._inflation = inflation if inflation >= MIN_INFLATION else 1.0

    def _is_frozen(self, found: Innovation, pose: ReceivedPose, receiver: GnssSettings) -> bool:
        """Whether the position is constant although the stated speeds must have changed it."""
        still = self._still or pose
        stated = stated_variance(still.accuracy) + stated_variance(pose.accuracy)
        limit = self._gate * self._inflation * sqrt(stated)
        if self._still is None or hypot(pose.east - still.east, pose.north - still.north) > limit:
            self._still, self._should_move = pose, (0.0, 0.0, 0.0)
            return False
        east, north, variance = self._should_move
        if pose.speed > self._gate * receiver.speed_noise:
            variance += found.manoeuvre**2
            east, north = east + found.moved[0], north + found.moved[1]
            self._should_move = east, north, variance
        return hypot(east, north) > 2.0 * limit + self._gate * sqrt(variance)

    def _report(self, pose: ReceivedPose, reason: Distrust) -> None:
        name = self._name
        if reason in REFUSED:
            self._refused_at = pose.received_at
            self._refusals += 1
        elif not reason and pose.received_at - self._refused_at > QUIET:
            count = f"; {self._refusals} poses refused" if self._refusals else ""
            self._remarks.append(f"{name} trusted again{count}")
            self._refusals = 0
            self._reported.clear()
        if reason and reason not in self._reported:
            self._reported.add(reason)
            text = f"distrusted: {reason}"
            if reason not in REFUSED:
                text = f"{reason}: assumed accuracy {self.deviation(pose):.2f} m"
            self._remarks.append(f"{name} {text}")
