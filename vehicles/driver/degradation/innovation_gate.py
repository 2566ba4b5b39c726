"""Gate of one source: whether a car can have driven to a pose from its earlier poses.

Similar to the measurement rejection of estimators (PX4's EKF2: 5 standard deviations of position),
but the stated position, speed and heading are compared with each other. A source that is
consistently wrong is not detected: always beside the road, or permanently displaced.
"""

from collections import Counter, deque
from itertools import pairwise
from math import hypot, isfinite, sqrt
from typing import Final, Literal

from vehicles.car.positioning.noise import GnssNoise
from vehicles.driver.degradation.innovation import (
    CORNERING,
    MAX_DEVIATION,
    MIN_DEVIATION,
    Innovation,
    PoseTrack,
    heading_innovation,
    innovation,
    stated_variance,
)
from vehicles.geometry.sparse_path import HARDEST_BRAKING
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

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
