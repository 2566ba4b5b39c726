"""One source of a follower: its messages, its trace, and whether it is relied on.

SI units; instants in ns.
"""

from math import hypot, log, remainder, sin, tau
from typing import Final

from vehicles.car.gnss_settings import GnssSettings
from vehicles.driver.controller import RELIED_ON, SourceState, SpacingPolicy
from vehicles.driver.intended_path import IntendedPath, is_beside
from vehicles.driver.own_state import Pose
from vehicles.driver.plausibility import REFUSED, PoseJudge
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import LOST, OFF_PATH
from vehicles.driver.speed import MIN_SPEED, BendsAhead
from vehicles.preview.samples import Window
from vehicles.preview.trace import Trace
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Messages of a source: their period, their losses, and the silence that is a loss


LOSS_MEMORY: Final = 10.0  # Averaging time (s) of the losses
PRIOR_SENT, PRIOR_LOST, PRIOR_BURSTS = 6.0, 0.5, 0.35
"""Messages assumed before the first one: half of one in six is lost, as a burst of its own."""
LEAST_BURST: Final = 2.0  # Lost messages from which bursts are taken into account
IMPROBABLE: Final = 1e-6
"""Probability of a silence that is taken for the loss of its source: 16 cars with two links each at
20 Hz see a few false ones in 200 runs of 30 s."""
PERIOD_WEIGHT: Final = 0.25  # Weight of a new message in the period


class Reception:
    """Period, losses and `usual_silence` (s) of the messages of a source, by sequence numbers.

    `lost_after` (s) is the silence that is improbable under the usual losses: n missing messages
    have the probability Π (l + k) / (s + k), k < n, after l of s were lost, which accounts for the
    few messages at the start (beta-binomial distribution); if losses come in b bursts, p p_c^(n-1)
    with p = l/s and p_c = 1 - b/l (Gilbert, "Capacity of a burst-noise channel", 1960). The longer
    silence of both counts.
    """

    def __init__(self, period: float, settings: DegradationSettings) -> None:
        """`period` (s) is the shortest expected one."""
        self._least_period = self.period = period
        self._settings = settings
        self.received_at: int | None = None
        self._measured_at = self._seq = 0
        self.usual_silence = 0.0
        self._sent, self._lost, self._bursts = PRIOR_SENT, PRIOR_LOST, PRIOR_BURSTS
        self.lost_after = self._improbable_silence()

    def add(self, now: int, measured_at: int, seq: int) -> bool:
        """Count a message received at `now`; returns whether it is the newest by its stamp."""
        if self.received_at is None:
            self.received_at, self._measured_at, self._seq = now, measured_at, seq
            return True
        if measured_at <= self._measured_at:
            if seq < self._seq and self._lost >= 1.0:  # it was overtaken, not lost
                self._lost -= 1.0
            return False
        span, numbers = (measured_at - self._measured_at) / SECOND, seq - self._seq
        silence = (now - self.received_at) / SECOND
        self.received_at, self._measured_at, self._seq = now, measured_at, seq
        if numbers <= 0:  # the sender has restarted
            return True
        self.period += PERIOD_WEIGHT * (max(span / numbers, self._least_period) - self.period)
        missed = numbers - 1
        if missed * self.period <= self.lost_after:  # a cut is no usual loss
            kept = max(1.0 - span / LOSS_MEMORY, 0.0)
            self.usual_silence = max(kept * self.usual_silence, silence)
            self._sent = kept * self._sent + missed + 1.0
            self._lost = kept * self._lost + missed
            self._bursts = kept * self._bursts + (missed > 0)
        self.lost_after = self._improbable_silence()
        return True

    def _improbable_silence(self) -> float:
        """Silence (s) that is improbable, within the bounds of the settings."""
        settings, sent, lost = self._settings, self._sent, self._lost
        least = settings.lost_after_silence(self.period)
        most = max(settings.lost_after_max, least)
        missing, probability = 0, 1.0
        while probability > IMPROBABLE and missing * self.period < most:
            probability *= (lost + missing) / (sent + missing)
            missing += 1
        if lost > LEAST_BURST:
            continues = min(max(1.0 - (self._bursts + 0.2) / (lost + 0.4), 0.05), 0.95)
            in_bursts = 1.0 + log(IMPROBABLE * sent / lost) / log(continues)
            missing = max(missing, round(in_bursts))
        return min(max(self.period * missing, least), most)

    def share(self, silence: float) -> float:
        """Received ratio; messages that are overdue after a `silence` (s) count as lost."""
        overdue = silence / self.period - 1.0
        overdue = overdue if overdue > 0.0 else 0.0
        return 1.0 - (self._lost + overdue) / (self._sent + overdue)


# ---- Source


LATE_PERIODS: Final = 3.0  # Periods without a message after which a source is late
MIN_SAMPLES: Final = 3  # Fewer samples of a source determine no trajectory
CURVATURE_MEMORY: Final = 300.0
"""Distance (m) over which a received curvature loses half of its effect: the bends of a car park do
not count on a motorway."""


class Source:
    """A vehicle whose poses a follower receives: its state, its trace and its weight.

    The `weight` in the trajectory is 1 while the status (see `messages.SourceStatus`) is fresh.
    Once late, it decreases with the known path and returns slowly, so that no sample appears or
    vanishes at once.

    `place` is 0 for the lead, k for the k-th vehicle ahead, -k for the k-th vehicle behind.

    A source that `may_leave_path`, because there is another one, is not followed while it announces
    trouble or a large offset from the path; then `has_left_path` is True. Its samples `reaches`
    ahead of the car at the last refit, or once did if it is `usable`. `bend` is the largest
    curvature (1/m) of its recent poses, `refusal` why a pose was refused last.
    """

    def __init__(
        self,
        name: str,
        period: float,
        settings: DegradationSettings,
        *,
        place: int = 0,
        delay: float = 0.0,
        lag: float = 0.0,
        receiver: GnssSettings | None = None,
        policy: SpacingPolicy | None = None,
        bends: BendsAhead | None = None,
        remarks: list[str] | None = None,
    ) -> None:
        """`period` (s) between messages and `delay` (s) of the first one are the expected ones.

        `lag` (s) is the assumed drive lag. Poses are judged by the noise of the `receiver`; without
        it only jumps are refused. Lines for the log are appended to `remarks`.
        `policy` is the spacing to keep, `bends` the limit of speed by the poses.
        """
        self.name, self.place, self.policy, self.bends = name, place, policy, bends
        self._degrades = settings.reaction == "degrade"
        self.trace = Trace(closes_holes=self._degrades)
        self.state = SourceState(lag=lag)
        self.reception = Reception(period, settings)
        self.intended: IntendedPath | None = None
        self.weight = 1.0
        self.usable = self.reaches = False
        self.bend = 0.0
        self.refusal = ""
        self.may_leave_path = self.has_left_path = False
        self._judge = PoseJudge(
            name, receiver, gate=settings.gate, settle=settings.probation, remarks=remarks
        )
        self._moved = False
        self._settings = settings
        self._refused_at: int | None = None
        self._returned_at = 0
        self._delay = round(delay * SECOND)
        self._known_at_full_weight = 0.0

    @property
    def path_ends(self) -> bool:
        return self.state.status == "late" or self.has_left_path

    @property
    def gives_path(self) -> bool:
        return self.usable and self.state.status in RELIED_ON and not self.has_left_path

    def receive(self, pose: ReceivedPose) -> None:
        """Check a pose, and add it to the trace if it is accepted (Section III-A)."""
        reason, now, state = self._judge.judge(pose), pose.received_at, self.state
        if reason in REFUSED:
            self._refused_at, self.refusal = now, reason
            return
        message, last = pose.message, self.trace.newest
        newer = last is None or pose.measured_at > last.measured_at
        lost = newer and state.status in LOST
        if self.may_leave_path and last is not None and self._is_off_path(pose):
            self.has_left_path |= newer
            self._moved |= self._judge.at_new_place
            self.trace.record_position(pose)
        else:
            # Baselines bridge no holes: the next pose after a silence is just another sample.
            hole = (lost and self._degrades) or (newer and self.has_left_path)
            moved = newer and (self._moved or self._judge.at_new_place)
            self.has_left_path &= not newer
            self._moved &= not newer
            self.trace.add(pose, after_hole=hole, at_new_place=moved)
            if newer:
                self._measure_bend(last, pose)
            if self.intended is not None:
                self.intended.add(pose, message.path_offset_m)
            if newer and self.bends is not None:
                self.bends.add(pose)
        if self.reception.add(now, pose.measured_at, message.seq):
            self._announce(pose)
            if state.status == "unheard":
                state.status = "fresh"
            elif state.status in LOST:
                self._returned_at = now
                state.status = "probation"

    def _announce(self, pose: ReceivedPose) -> None:
        state, message = self.state, pose.message
        state.mode, state.hazard, state.leaving = message.mode, message.hazard, message.leaving
        state.acceleration = message.acceleration_mps2
        state.achieved = message.achieved_acceleration_mps2
        state.stops_at = message.stops_at_ns

    def _is_off_path(self, pose: ReceivedPose) -> bool:
        """Whether a pose is not on the lead's path, or may not be, as after a restart."""
        message = pose.message
        if message.hazard or message.mode in OFF_PATH:
            return True
        if message.path_offset_m != message.path_offset_m:  # NaN
            return self.state.status in LOST or self.state.status == "probation"
        return is_beside(pose)

    def _measure_bend(self, last: ReceivedPose | None, pose: ReceivedPose) -> None:
        """Update the largest recent curvature, dθ/dt over v (Section III-B)."""
        if last is not None:
            moved = hypot(pose.east - last.east, pose.north - last.north)
            self.bend *= 0.5 ** (moved / CURVATURE_MEMORY)
        if pose.speed >= MIN_SPEED:
            bend = abs(pose.yaw_rate) / pose.speed
            self.bend = bend if bend > self.bend else self.bend

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window | None:
        """Preview data (Section III-A) from `behind` to `ahead` (m) of the ego at (east, north).

        None if no samples reach ahead of the ego.
        """
        window = self.trace.window(east, north, behind, ahead)
        self.reaches = reaches_ahead(window)
        self.usable |= self.reaches
        return window if self.reaches else None

    def update(self, now: int, pose: Pose, span: float, *, refit: bool) -> None:
        """Update state and weight at a control instant `now`, `span` (s) after the last one.

        The status depends on silence, not on age, so that latency alone does not lose a source.
        Known path and spacing are measured at a `refit`, and predicted from the speed otherwise.
        """
        state, reception, newest = self.state, self.reception, self.trace.newest
        driven = pose.speed * span
        if refit:
            state.known = self.trace.known_ahead(pose.east, pose.north)
            self._measure_spacing(pose)
        else:
            state.known -= driven
            state.spacing -= driven
        received_at = reception.received_at
        if newest is None or received_at is None:
            if not state.lost_at:
                state.lost_at = now + self._delay + round(reception.lost_after * SECOND)
            return
        silence = state.silence = (now - received_at) / SECOND
        state.lost_at = received_at + round(reception.lost_after * SECOND)
        state.age = (now - newest.measured_at) / SECOND
        state.measured_at, state.speed = newest.measured_at, max(newest.speed, 0.0)
        state.period, state.share = reception.period, reception.share(silence)
        state.usual_silence = reception.usual_silence
        self._update_status(now, silence)
        if self.weight == 1.0 and state.status in ("fresh", "probation"):  # the usual case
            self._known_at_full_weight = 0.0
        elif self._degrades:
            self._weigh(span)

    def _measure_spacing(self, pose: Pose) -> None:
        """Spacing to the newest pose: along the trace, to a vehicle behind along an arc.

        The arc has the directions of both poses as tangents: the chord times θ/2 over sin(θ/2) for
        the angle θ between them.
        """
        newest = self.trace.newest
        if newest is None:
            return
        if self.place >= 0:
            spacing = self.trace.spacing(pose.east, pose.north)
            if spacing is not None:
                self.state.spacing = spacing
            return
        half = 0.5 * remainder(pose.yaw - newest.yaw, tau)
        chord = hypot(pose.east - newest.east, pose.north - newest.north)
        self.state.spacing = -chord * (half / sin(half) if half else 1.0)

    def _update_status(self, now: int, silence: float) -> None:
        """Set lost or distrusted at once, fresh again only after the probation."""
        state, after = self.state, self.reception.lost_after
        late = silence > LATE_PERIODS * state.period
        refused = self._refused_at is not None and (now - self._refused_at) / SECOND <= after
        if (late and refused) or silence > after:
            state.status = "distrusted" if refused else "lost"
        elif state.status == "probation":
            if (now - self._returned_at) / SECOND >= self._settings.probation:
                state.status = "fresh"
        else:
            state.status = "late" if late else "fresh"

    def _weigh(self, span: float) -> None:
        if self.state.status in ("fresh", "probation"):
            self._known_at_full_weight = 0.0
            self.weight = min(self.weight + span / self._settings.probation, 1.0)
            return
        known = self.state.known
        if not known > 0.0:  # also NaN
            self.weight = 0.0
            return
        if not self._known_at_full_weight and self.weight > 0.0:
            self._known_at_full_weight = known / self.weight
        if self._known_at_full_weight:
            self.weight = min(self.weight, known / self._known_at_full_weight)


def reaches_ahead(window: Window) -> bool:
    """Whether samples determine a trajectory and reach ahead of the ego (Section III-A)."""
    return len(window.station) >= MIN_SAMPLES and window.station.item(-1) >= 0.0
