"""One source of a follower: its trace, its freshness, and whether it is relied on."""

from collections import deque
from math import exp, hypot, isnan, nan
from typing import Final, NamedTuple

from vehicles.driver.innovation_gate import REFUSED, Trust
from vehicles.driver.intended_path import IntendedPath, is_beside
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import LOST, OFF_PATH, SourceFreshness
from vehicles.messages import SourceStatus
from vehicles.preview.samples import Window
from vehicles.preview.trace import Trace
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

# ---- Reception of a source: period, share and age of its messages, probation after a loss
#
# SI units; instants in ns.


RECENT: Final = SECOND  # Time (ns) over which arrivals are counted and the period is estimated
SHARE_TIME: Final = 10.0  # Averaging time (s) of the usual share
CLOSING_RATE: Final = 0.1  # An opened gap closes again at this share of the own speed
CLOSING_TIME: Final = 3.0  # Time constant (s) of a wide gap, as after a stop of a minute
AGE_WEIGHT: Final = 0.05  # Weight of a new message in the usual age of messages at reception


class _Arrival(NamedTuple):
    received_at: int
    measured_at: int
    seq: int


class Reception:
    """Statistics of the messages of one source that arrived in the last second.

    The period is the time between two stamps divided by the difference of their sequence numbers,
    so losses do not stretch it.
    """

    def __init__(self, period: float) -> None:
        """`period` (s) is the shortest expected one."""
        self._least_period = period
        self.period = period
        self.usual_share = nan
        self._recent: deque[_Arrival] = deque()
        self._highest = -1
        self._received_at: deque[int] = deque()
        self._first_at = 0
        self._newest_at: int | None = None
        self._newest_measured_at = 0
        self._counted_until = 0
        self._counted = 0.0

    def add(self, now: int, measured_at: int, seq: int) -> bool:
        """Count a message received at `now`, unless its number is repeated.

        Returns whether it is the newest by its stamp.
        """
        if seq > self._highest:
            self._highest = seq
        elif seq in [arrival.seq for arrival in self._recent]:
            return False
        recent, arrival = self._recent, _Arrival(now, measured_at, seq)
        self._received_at.append(now)
        if self._newest_at is None:
            self._first_at = self._counted_until = now
        elif measured_at <= self._newest_measured_at:
            recent.insert(max(len(recent) - 1, 0), arrival)
            return False
        self._newest_at, self._newest_measured_at = now, measured_at
        recent.append(arrival)
        while len(recent) > 2 and recent[0].received_at <= now - RECENT:
            recent.popleft()
        self._learn_period()
        return True

    def reset(self) -> None:
        self._recent.clear()
        self._received_at.clear()

    def silence(self, now: int) -> float:
        """Time (s) since a newer message was received (not measured), NaN before the first."""
        return nan if self._newest_at is None else (now - self._newest_at) / SECOND

    def share(self, now: int) -> float:
        """Received share of the expected messages of the last second, NaN before the first."""
        if self._newest_at is None:
            return nan
        received, expected = self._counts(now)
        share = received / expected
        return 1.0 if share > 1.0 else share

    def delivers(self, now: int, share: float) -> bool:
        """Whether `share` of the usual messages arrived in the last second; one may be missing."""
        received, expected = self._counts(now)
        return received + 1 >= share * self.usual_share * expected

    def update_usual_share(self, now: int, share: float) -> None:
        span = (now - self._counted_until) / SECOND
        self._counted_until = now
        if span <= 0.0:
            return
        counted = self._counted + span
        self._counted = SHARE_TIME if counted > SHARE_TIME else counted
        before = 0.0 if self._counted == span else self.usual_share
        self.usual_share = before + (share - before) * span / self._counted

    def skip_usual_share(self, now: int) -> None:
        self._counted_until = now

    def _counts(self, now: int) -> tuple[int, float]:
        since, received_at = now - RECENT, self._received_at
        while received_at and received_at[0] <= since:
            received_at.popleft()
        span = now - self._first_at
        expected = (RECENT if span > RECENT else span) / SECOND / self.period
        return len(received_at), 1.0 if expected < 1.0 else expected

    def _learn_period(self) -> None:
        first, last = self._recent[0], self._recent[-1]
        numbers = last.seq - first.seq
        if numbers > 0:
            spacing = (last.measured_at - first.measured_at) / SECOND / numbers
            self.period = max(spacing, self._least_period)
        elif numbers < 0:  # the sender has restarted
            self._recent.clear()
            self._recent.append(last)
            self._received_at.clear()
            self._received_at.append(last.received_at)


class Probation:
    """Time for which a source must be received before it is relied on again.

    It doubles with each relapse and halves after each `probation_halving` without one, similar to
    PX4's estimator EKF2.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._settings = settings
        self._next = settings.probation
        self._trusted_at: int | None = None
        self._began_at = 0
        self.length = settings.probation

    def fail(self, now: int) -> None:
        """Lengthen the next probation: the source was lost or refused at `now` (ns)."""
        settings = self._settings
        if self._trusted_at is not None:
            healthy = (now - self._trusted_at) / SECOND
            halvings = min(int(healthy / settings.probation_halving), 64)
            self._next = max(self._next * 0.5**halvings, settings.probation)
            self._trusted_at = None
        self.length = self._next
        self._next = min(2.0 * self.length, max(settings.probation_max, settings.probation))

    def begin(self, now: int) -> None:
        self._began_at = now

    def served(self, now: int) -> float:
        return (now - self._began_at) / SECOND  # s

    def end(self, now: int) -> None:
        self._trusted_at = now


class AgeWatch:
    """Age of the predecessor's newest sample beyond the usual age, and its recent maximum."""

    def __init__(self, settings: DegradationSettings, period: float) -> None:
        """`period` (s) is the time between messages until it is estimated."""
        self._settings = settings
        self._period = period
        self._usual = 0.0
        self._measured_at: int | None = None
        self._late_at: int | None = None
        self._peak, self._peak_at = 0.0, 0

    @property
    def usual(self) -> float:
        """Largest expected age (s): that at reception, plus a period."""
        return self._usual + self._period

    def observe(self, now: int, age: float, source: SourceFreshness) -> None:
        settings = self._settings
        if not isnan(source.period):
            self._period = source.period
        measured_at = now - round(age * SECOND)
        if not isnan(source.age) and measured_at != self._measured_at:
            first = self._measured_at is None
            self._measured_at = measured_at
            self._usual = age if first else self._usual + AGE_WEIGHT * (age - self._usual)
        if source.status in LOST or age > self._usual + settings.late_periods * self._period:
            self._late_at = now
            growth = max(age - self.usual, 0.0)
            if growth >= self.growth(now):
                self._peak, self._peak_at = growth, now

    def is_new_peak(self, now: int) -> bool:
        """Whether the newest sample at `now` (ns) is late, and older than any recent one."""
        return self._peak_at == now

    def is_recently_late(self, now: int) -> bool:
        """Whether messages are late at `now` (ns), or were so less than a probation ago."""
        if self._late_at is None:
            return False
        return now - self._late_at <= self._settings.probation * SECOND

    def growth(self, now: int) -> float:
        """Recent maximum (s) of the age beyond the usual age; it decays, so gaps do not pump."""
        if not self._peak:
            return 0.0
        since = (now - self._peak_at) / SECOND - self._settings.probation
        since = max(since, 0.0)
        return max(self._peak * exp(-since / CLOSING_TIME) - CLOSING_RATE * since, 0.0)


# ---- Source


RELIED_ON = ("fresh", "late")  # Statuses of a source that is steered along
OVERDUE_AFTER: Final = 1.5  # Multiple of the usual time between two messages
MIN_SHARE: Final = 0.05  # Smallest share of its messages that a source is expected to deliver
SLOW_SPEED: Final = 5.0  # Below this speed (m/s) a car stops within 4 m: relying early is safe
SLOW_PROBATION: Final = 2.0  # Longest probation (s) of a source of a slow car
SLOW_DELIVERY: Final = 0.8  # Share of all messages that ends this probation
MIN_SAMPLES: Final = 3  # Fewer samples of a source determine no trajectory
CURVATURE_MEMORY: Final = 300.0
"""Distance (m) over which a received curvature loses half of its effect: the bends of a car park do
not count on a motorway."""
MIN_SPEED: Final = 1.0  # Below it (m/s) the yaw rate determines no curvature


class Source:
    """A vehicle whose poses a follower receives: its trace, its status and its weight.

    Status: unheard before the first message, fresh, late if some messages are overdue, lost after a
    longer silence, distrusted while its poses are refused, on probation once they are accepted
    again. The `weight` in the trajectory is 1 while it is fresh. Once late, the weight decreases
    with the known path and returns slowly, so that no sample appears or vanishes at once.

    `place` is 0 for the lead, k for the k-th vehicle ahead, -k for the k-th vehicle behind.

    A source that `may_leave_path` is followed only while it announces neither trouble nor a large
    offset from the path, as there is another source; else `has_left_path` is True.
    `stop_is_assumed` is True while it is silent without an announced stop. `freshness` is that of
    the last control instant, `bend` the largest curvature (1/m) of its recent poses.
    """

    def __init__(  # noqa: PLR0917 - usually fewer
        self,
        name: str,
        period: float,
        settings: DegradationSettings,
        delay: float = 0.0,
        trust: Trust | None = None,
        place: int = 0,
    ) -> None:
        """`period` (s) between messages and `delay` (s) of the first one are the expected ones."""
        self.name = name
        self.place = place
        self.trace = Trace(closes_holes=settings.reaction == "degrade")
        self.intended: IntendedPath | None = None
        self.weight = 1.0
        self.usable = False
        self.bend = 0.0
        self.reaches = False
        self.refusal = ""
        self.may_leave_path = self.has_left_path = False
        self.stop_is_assumed = False
        self.status: SourceStatus = "unheard"
        self.freshness = SourceFreshness()
        self.probation = Probation(settings)
        self._trust = trust or Trust(name)
        self._moved = self._is_slow = False
        self._settings = settings
        self._reception = Reception(period)
        self._degrades = settings.reaction == "degrade"
        self._refused_at: int | None = None
        self._announced: ReceivedPose | None = None
        self._period = period
        self._delay = round(delay * SECOND)
        self._due_from: int | None = None
        self._waited = 0.0
        self._known = nan
        self._known_at_full_weight = 0.0

    @property
    def path_ends(self) -> bool:
        return self.status == "late" or self.has_left_path

    @property
    def gives_path(self) -> bool:
        return self.status in RELIED_ON and not self.has_left_path

    @property
    def probation_length(self) -> float:
        """Length of its probation (s), shorter for a slow car."""
        length = self.probation.length
        return min(length, SLOW_PROBATION) if self._is_slow else length

    @property
    def is_overdue(self) -> bool:
        if self.status == "unheard":
            return self._waited > OVERDUE_AFTER * self._period
        share = self._reception.usual_share
        usual = self.freshness.period / (MIN_SHARE if share < MIN_SHARE else share)
        return self.freshness.silence > OVERDUE_AFTER * usual

    @property
    def never_received(self) -> bool:
        """Whether no first message arrived within the time after which a source is lost."""
        after = self._settings.lost_after_silence(self._period)
        return self.status == "unheard" and self._waited > after

    def receive(self, pose: ReceivedPose) -> None:
        """Check a pose, and add it to the trace if it is accepted (Section III-A)."""
        reason, now = self._trust.judge(pose), pose.received_at
        if reason in REFUSED:
            self._refused_at, self.refusal = now, reason
            return
        message, last = pose.message, self.trace.newest
        newer = last is None or pose.measured_at > last.measured_at
        lost = newer and self.status in LOST
        if self.may_leave_path and last is not None and self._is_off_path(pose):
            self.has_left_path = True
            self._moved |= self._trust.at_new_place
            self.trace.record_position(pose)
        else:
            # Baselines bridge no holes: the next pose after a silence is just another sample.
            hole = (lost and self._degrades) or (newer and self.has_left_path)
            moved = newer and (self._moved or self._trust.at_new_place)
            self.has_left_path &= not newer
            self._moved &= not newer
            self.trace.add(pose, after_hole=hole, at_new_place=moved)
            if newer:
                self._measure_bend(last, pose)
            if self.intended is not None:
                self.intended.add(pose, message.path_offset_m)
        if lost:
            self._reception.reset()
        if self._reception.add(now, pose.measured_at, message.seq):
            self._announced = pose
            if self.status == "unheard":
                self.status = "fresh"
            elif self.status in LOST:
                self.probation.begin(now)
                self.status = "probation"

    def _is_off_path(self, pose: ReceivedPose) -> bool:
        """Whether its pose is not on the lead's path, or may not be, as after a restart."""
        message = pose.message
        if message.hazard or message.mode in OFF_PATH:
            return True
        if isnan(message.path_offset_m):
            return self.status in LOST or self.status == "probation"
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
        """Update status and weight at a control instant `now` (ns), `span` (s) after the last.

        The status depends on silence, not on age, so that latency alone does not lose a source. The
        known path is measured at a `refit`, and predicted from the speed otherwise.
        """
        if refit:
            self._known = self.trace.known_ahead(pose.east, pose.north)
        else:
            self._known -= pose.speed * span
        newest, announced = self.trace.newest, self._announced
        if newest is None or announced is None:
            if self._due_from is None:
                self._due_from = now + self._delay
            self._waited = (now - self._due_from) / SECOND
            after = self._settings.lost_after_silence(self._period)
            lost_at = self._due_from + round(after * SECOND)
            self.freshness = SourceFreshness(known=self._known, lost_at=lost_at)
            return
        reception, message = self._reception, announced.message
        silence, share, period = reception.silence(now), reception.share(now), reception.period
        after = self._settings.lost_after_silence(period)
        self._is_slow = pose.speed < SLOW_SPEED
        self._update_status(now, silence, share, after)
        stops_at = message.stops_at_ns or self._assumed_stop(announced, after)
        self.stop_is_assumed = stops_at != message.stops_at_ns
        if self.weight == 1.0 and self.status in ("fresh", "probation"):  # the usual case
            self._known_at_full_weight = 0.0
        elif self._degrades:
            self._weigh(span)
        self.freshness = SourceFreshness(
            self.status,
            (now - newest.measured_at) / SECOND,
            silence,
            period,
            share,
            self._known,
            message.mode,
            message.hazard,
            message.acceleration_mps2,
            now + round((after - silence) * SECOND),
            stops_at,
            newest.speed,
        )

    def _assumed_stop(self, announced: ReceivedPose, after: float) -> int:
        """Instant (ns) at which a silent follower without an announced stop may begin to stop.

        When it was received last it may have lost its own sources, with a message overdue; `after`
        (s) is the silence after which they are lost. 0 for a vehicle that is received or that
        follows its own path, which does not stop for lack of data.
        """
        status = self.status
        silent = status in ("late", "lost") or (status == "distrusted" and self.refusal == "frozen")
        if not silent or announced.message.mode == "path":
            return 0
        span = after - OVERDUE_AFTER * self._reception.period
        return announced.measured_at + round(span * SECOND)

    def _update_status(self, now: int, silence: float, share: float, after: float) -> None:
        """Set lost or distrusted at once, fresh again only after probation."""
        late = silence > self._settings.late_periods * self._reception.period
        refused = self._refused_at is not None and (now - self._refused_at) / SECOND <= after
        if (late and refused) or silence > after:
            if self.status not in LOST:
                self.probation.fail(now)
            self.status = "distrusted" if refused else "lost"
            self._reception.skip_usual_share(now)
            return
        if self.status == "probation":
            self._serve_probation(now, share)
        else:
            self._reception.update_usual_share(now, share)
        if self.status != "probation":
            self.status = "late" if late else "fresh"

    def _serve_probation(self, now: int, share: float) -> None:
        """End the probation if due; the usual share adapts, so that it always can end."""
        served = self.probation.served(now)
        if served * SECOND < RECENT:
            self._reception.skip_usual_share(now)
        else:
            self._reception.update_usual_share(now, share)
        delivers = self._reception.delivers(now, self._settings.probation_delivery)
        delivers = delivers or (self._is_slow and share >= SLOW_DELIVERY)
        if served >= self.probation_length and delivers:
            self.probation.end(now)
            self.status = "fresh"

    def _weigh(self, span: float) -> None:
        if self.status in ("fresh", "probation"):
            self._known_at_full_weight = 0.0
            self.weight = min(self.weight + span / self.probation_length, 1.0)
            return
        known = self._known
        if isnan(known) or known <= 0.0:
            self.weight = 0.0
            return
        if not self._known_at_full_weight and self.weight > 0.0:
            self._known_at_full_weight = known / self.weight
        if self._known_at_full_weight:
            self.weight = min(self.weight, known / self._known_at_full_weight)


def reaches_ahead(window: Window) -> bool:
    """Whether samples determine a trajectory and reach ahead of the ego (Section III-A)."""
    return len(window.station) >= MIN_SAMPLES and window.station.item(-1) >= 0.0
