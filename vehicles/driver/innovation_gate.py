"""Gate of one source: whether a car can have driven to a pose from its earlier poses.

Similar to the measurement rejection of estimators (PX4's EKF2: 5 standard deviations of position),
but the stated position, speed and heading are compared with each other. A source that is
consistently wrong is not detected: always beside the road, or permanently displaced.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from math import cos, hypot, isfinite, remainder, sin, sqrt, tau
from typing import Final, Literal, NamedTuple

from vehicles.car.noise import GnssNoise
from vehicles.geometry.sampled_path import HARDEST_BRAKING
from vehicles.preview.samples import reachable
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Innovation of a pose: its difference from the prediction by earlier poses of its source
#
# As in a Kalman filter (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
# Navigation, 2001, 5.4), normalised by its standard deviation. The prediction holds for any
# manoeuvre: the displacement between two poses is their mean velocity times the time T between
# them, and with an acceleration of at most A the error is at most A T² / 4.


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


# ---- Innovation gate


Distrust = Literal["", "frozen", "jumping", "impossible", "ghost", "over-confident"]
"""Verdict on a pose; empty if it is trusted.

frozen          the position repeats although the speed is not zero
jumping         a position or heading that the car cannot have reached
impossible      an impossible acceleration, or a displacement that contradicts the speeds
ghost           two tracks under one name, and the pose is not on the trusted one
over-confident  used, but positions scatter more than stated
"""
REFUSED: tuple[Distrust, ...] = ("frozen", "jumping", "impossible", "ghost")

WINDOW: Final = 32  # Number of poses from which over-confidence is estimated
MAX_SQUARE: Final = 15.0  # Bound of squares, so that jumps do not look over-confident
OVERCONFIDENT_SUM: Final = 95.0
"""Sum over the window above which a source is over-confident. The sum of an honest source is 36.3
with a standard deviation of 7.8, nearly chi-squared (43 degrees of freedom after scaling), which
exceeds 90 as rarely as a normal number exceeds 5 deviations (Wilson and Hilferty, 1931)."""
CONFIDENT_SUM: Final = 60.0  # Over-confidence ends: 3 deviations above the mean
HONEST_THIRD: Final = 0.41
"""Lower tertile of an honest source's squared innovations, each the smaller one against the last
two poses. It also holds for two tracks of which one is honest."""
MIN_INFLATION: Final = 1.5  # Below this inflation a source is not over-confident
MAX_INFLATION: Final = 30.0  # One solver stated a twentieth of its true deviation
HEADING_MISSES: Final = 3
"""Consecutive headings beyond their gate, against each of the last two accepted ones, that refuse a
pose: by chance at most once in 2e7 poses."""
RESTART_POSES: Final = 3  # Smallest number of poses that must agree on a new position
RECENT_POSES: Final = 12
RETURNS: Final = 2  # Trusted poses after refused ones that make two tracks
SUSPECT_LIFETIME: Final = 3 * SECOND  # Age (ns) up to which a refused pose supports others


class InnovationGate:
    """Checks the poses of one source in the order in which they are received.

    A pose is compared with the newest trusted one. Refused poses that agree with one another for
    `settle` become the trusted track, so no source is excluded forever. `refused` counts poses by
    reason.
    """

    def __init__(
        self,
        noise: GnssNoise | None = None,
        *,
        gate: float = 5.0,
        heading_gate: float = 3.0,
        settle: float = 1.0,
    ) -> None:
        """`noise` applies to all but positions; gates are in standard deviations, `settle` in s."""
        self._noise = noise or GnssNoise()
        self._gate = gate
        self._heading_gate = heading_gate
        self._settle = round(settle * SECOND)
        self._trusted: PoseTrack | None = None
        self._aligned: deque[ReceivedPose] = deque(maxlen=2)
        self._heading_misses = 0
        self._suspect: PoseTrack | None = None
        self._suspected: Distrust = ""
        self._agreed = 0
        self._agreed_since = 0
        self._accepted: deque[bool] = deque(maxlen=RECENT_POSES)
        self._last: deque[ReceivedPose] = deque(maxlen=2)
        self._squares: deque[float] = deque(maxlen=WINDOW)
        self._counted: deque[float] = deque(maxlen=WINDOW)
        self._inflation = 1.0
        self._confidence: Distrust = ""
        self._reference: ReceivedPose | None = None
        self._predicted = (0.0, 0.0, 0.0)
        self.refused: Counter[Distrust] = Counter()

    def judge(self, pose: ReceivedPose) -> Distrust:
        """Verdict on a pose by its innovations; with a reason in `REFUSED` it must not be used."""
        if not isfinite(pose.east + pose.north + pose.yaw + pose.speed + pose.yaw_rate):
            return self._refuse("impossible")
        last = innovation(self._last[-1], pose, self._noise) if self._last else None
        before = self._last[-1] if self._last else pose
        frozen = self._update_inflation(pose, last)
        if self._trusted is None:
            return self._accept(PoseTrack(pose, self._inflation))
        if last is None or before is not self._trusted.last:
            last = innovation(self._trusted.last, pose, self._noise)
        turn = heading_innovation(self._trusted.last, pose, self._noise)
        reason: Distrust = "frozen" if frozen else self._fault(self._trusted, last, turn, pose)
        if last.span <= 0.0:
            return self._refuse(reason) if reason else self._confidence
        if not reason and (self._heading_misses or turn > self._heading_gate):
            reason = self._check_heading(pose)
        elif not reason:
            self._aligned.append(pose)
        if not reason:
            self._trusted.push(last, pose, self._inflation)
            self._agreed = 0
            self._accepted.append(True)
            return self._confidence
        self._accepted.append(False)
        if reason != "frozen":
            returns = [after and not before for before, after in pairwise(self._accepted)]
            if sum(returns) >= RETURNS:  # alternately trusted and refused: two tracks
                reason = "ghost"
        return self._handle_suspect(pose, reason)

    def deviation(self, pose: ReceivedPose) -> float:
        """Standard deviation (m, per axis) to assume for a pose instead of the stated one."""
        if self._inflation == 1.0:
            return pose.accuracy
        return min(self._inflation * max(pose.accuracy, MIN_DEVIATION), MAX_DEVIATION)

    def _refuse(self, reason: Distrust) -> Distrust:
        self.refused[reason] += 1
        return reason

    def _accept(self, track: PoseTrack) -> Distrust:
        self._trusted, self._suspect = track, None
        self._aligned.clear()
        self._aligned.append(track.last)
        self._heading_misses = 0
        return self._confidence

    def _fault(
        self, track: PoseTrack, residual: Innovation, turn: float, pose: ReceivedPose
    ) -> Distrust:
        """Contradiction between a pose and a track; empty if there is none."""
        noise = self._noise
        if residual.deviations(self._inflation) > self._gate:
            return "jumping"
        gain = abs(pose.speed - track.last.speed) - HARDEST_BRAKING * abs(residual.span)
        if gain > 0.0 and gain / (sqrt(2.0) * noise.speed + 1e-3) > self._gate:
            return "impossible"
        if residual.span > 0.0 and (
            track.cumulative_deviation(residual, pose, self._inflation) > self._gate
            or track.lateral_acceleration(pose)
            > CORNERING + self._gate * pose.speed * noise.heading
        ):
            return "impossible"
        return "jumping" if turn > self._gate else ""

    def _check_heading(self, pose: ReceivedPose) -> Distrust:
        smallest = min(heading_innovation(before, pose, self._noise) for before in self._aligned)
        if smallest <= self._heading_gate:
            self._aligned.append(pose)
            self._heading_misses = 0
            return ""
        self._heading_misses += 1
        return "jumping" if self._heading_misses >= HEADING_MISSES else ""

    def _handle_suspect(self, pose: ReceivedPose, reason: Distrust) -> Distrust:
        """Refuse a pose, unless it completes the poses that restart the track."""
        track, now = self._suspect, pose.received_at
        if track is not None and pose.measured_at - track.last.measured_at > SUSPECT_LIFETIME:
            track = None
        if track is not None:
            residual = innovation(track.last, pose, self._noise)
            turn = heading_innovation(track.last, pose, self._noise)
            if reason == "frozen" or self._fault(track, residual, turn, pose):
                track = None
            elif residual.span > 0.0:
                track.push(residual, pose, self._inflation)
        if track is None:
            self._suspect, self._suspected = PoseTrack(pose, self._inflation), reason
            self._agreed, self._agreed_since = 1, now
            return self._refuse(reason)
        if not self._agreed:
            self._agreed_since = now
        self._agreed += 1
        if self._agreed >= RESTART_POSES and now - self._agreed_since >= self._settle:
            return self._accept(track)
        return self._refuse("ghost" if reason == "ghost" else self._suspected)

    def _update_inflation(self, pose: ReceivedPose, residual: Innovation | None) -> bool:
        if residual is None:
            self._last.append(pose)
            self._reference = pose
            return False
        if residual.span <= 0.0:
            return False
        frozen = self._is_frozen(residual, pose)
        if not frozen:
            square = residual.square
            if len(self._last) > 1:
                square = min(square, innovation(self._last[0], pose, self._noise).square)
            self._squares.append(square)
            self._counted.append(MAX_SQUARE if square > MAX_SQUARE else square)
            limit = OVERCONFIDENT_SUM if self._inflation == 1.0 else CONFIDENT_SUM
            if sum(self._counted) > limit:
                third = sorted(self._squares)[len(self._squares) // 3]
                inflation = min(sqrt(third / HONEST_THIRD), MAX_INFLATION)
                self._inflation = inflation if inflation >= MIN_INFLATION else 1.0
            else:
                self._inflation = 1.0
            self._confidence = "over-confident" if self._inflation > 1.0 else ""
        self._last.append(pose)
        return frozen

    def _is_frozen(self, residual: Innovation, pose: ReceivedPose) -> bool:
        """Whether the position is constant although the stated speeds must have changed it."""
        reference, noise = self._reference or pose, self._noise
        stated = stated_variance(reference.accuracy) + stated_variance(pose.accuracy)
        limit = self._gate * self._inflation * sqrt(stated)
        if hypot(pose.east - reference.east, pose.north - reference.north) > limit:
            self._reference, self._predicted = pose, (0.0, 0.0, 0.0)
            return False
        east, north, variance = self._predicted
        if pose.speed > self._gate * noise.speed:
            along, across = residual.along_variance, residual.across_variance
            variance += across if across > along else along
            east, north = east + residual.east_driven, north + residual.north_driven
            self._predicted = east, north, variance
        return hypot(east, north) > 2.0 * limit + self._gate * sqrt(variance)


# ---- Plausibility of received poses: decides whether a follower uses them
#
# `transport.links.link` has already checked that a message can be a pose at all (stamps,
# coordinates, speeds). Fixes of the own receiver are checked by the own filter
# (`ego.pose_estimator`), announced offsets are bounded in `intended_path`, and `preview.outliers`
# removes samples that the rest of a fit contradicts.


QUIET: Final = SECOND  # Time (ns) after the last refusal until a source is trusted again


@dataclass(slots=True)
class _RefusalSpell:
    """A period in which poses of a source are refused: their number and the reported reasons."""

    refused_at: int = 0
    refused: int = 0
    reported: set[Distrust] = field(default_factory=set)


class Trust:
    """Decides whether to use the received poses of one source, and reports refusals.

    Poses are checked by their innovations, if there is a gate, and by reachability: a pose that no
    car can have driven to is refused until several agree on the new position. Reachability also
    catches outliers of receivers that state a large deviation. `at_new_place` is True if the last
    pose used is the first one at a new position.
    """

    def __init__(
        self, name: str, gate: InnovationGate | None = None, remarks: list[str] | None = None
    ) -> None:
        """Lines for the log, such as "v1 distrusted: frozen", are appended to `remarks`.

        Without a `gate` only jumps are refused, and nothing is reported.
        """
        self.at_new_place = False
        self._name = name
        self._gate = gate
        self._newest: ReceivedPose | None = None
        self._suspects: list[ReceivedPose] = []
        self._spell = _RefusalSpell()
        self._remarks = [] if remarks is None else remarks

    def judge(self, pose: ReceivedPose) -> Distrust:
        """Verdict on a pose; with a reason in `REFUSED` it must not be used."""
        reason: Distrust = ""
        if self._gate is not None:
            reason = self._gate.judge(pose)
            if reason or self._spell.reported:  # rare
                self._report(pose, reason, self._gate)
            if reason in REFUSED:
                return reason
        elif not isfinite(pose.east + pose.north + pose.yaw + pose.speed):
            return "impossible"
        return self._reach(pose) or reason

    def _reach(self, pose: ReceivedPose) -> Distrust:
        """Check whether a car can have driven from the newest pose to this one; late poses pass."""
        newest, suspects = self._newest, self._suspects
        self.at_new_place = False
        if newest is not None and pose.measured_at <= newest.measured_at:
            return ""
        if newest is not None and not reachable(newest, pose):
            if suspects and not reachable(suspects[-1], pose):
                suspects.clear()
            suspects.append(pose)
            if len(suspects) < RESTART_POSES:
                return "jumping"
            self.at_new_place = True
        suspects.clear()
        self._newest = pose
        return ""

    def _report(self, pose: ReceivedPose, reason: Distrust, gate: InnovationGate) -> None:
        spell, name = self._spell, self._name
        if reason in REFUSED:
            spell.refused_at = pose.received_at
            spell.refused += 1
        elif not reason and pose.received_at - spell.refused_at > QUIET:
            count = f"; {spell.refused} poses refused" if spell.refused else ""
            self._remarks.append(f"{name} trusted again{count}")
            self._spell = _RefusalSpell()
        if reason and reason not in spell.reported:
            spell.reported.add(reason)
            text = f"distrusted: {reason}"
            if reason not in REFUSED:
                text = f"{reason}: assumed accuracy {gate.deviation(pose):.2f} m"
            self._remarks.append(f"{name} {text}")
