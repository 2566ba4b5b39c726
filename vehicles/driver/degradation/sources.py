"""The sources of a follower: lead and predecessor, which are one for the first follower."""

from collections.abc import Iterable, Mapping
from math import isnan, nan

from vehicles.driver.degradation.intended_path import IntendedPath, IntendedShare
from vehicles.driver.degradation.settings import Braking, DegradationSettings
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.degradation.source import RELIED_ON, Source, reaches_ahead
from vehicles.driver.degradation.stopping import stopping_distance
from vehicles.driver.ego.own_state import Pose
from vehicles.messages import Mode
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.received.known_path import PathHole, known_path
from vehicles.preview.received.samples import Window
from vehicles.preview.received.trace import Trace
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

AWAITED = ("unheard", *RELIED_ON)
"""Statuses of a source whose samples may still determine a trajectory."""


class SourcePair:
    """Lead and predecessor (Section III-A), and their use for the trajectory.

    `used` are the sources of the trajectory, by the mode of a follower that steers along one alone;
    `relied` are those relied on at the last control instant.
    """

    def __init__(
        self, lead: Source, predecessor: Source, settings: DegradationSettings, *, uses_lead: bool
    ) -> None:
        """`lead` and `predecessor` are one object for the first follower, whatever the fusion."""
        self.lead = lead
        self.predecessor = predecessor
        self.all = {one.name: one for one in (lead, predecessor)}
        self.used: dict[Mode, Source] = {}
        self.relied: dict[Mode, Source] = {}
        if uses_lead or lead is predecessor:
            self.used["lead"] = lead
        if lead is not predecessor:
            self.used["predecessor"] = predecessor
            predecessor.may_leave_path = len(self.used) > 1 and settings.reaction == "degrade"
        path = settings.predecessor_path if predecessor.may_leave_path else "driven"
        if path != "driven":
            predecessor.intended = IntendedPath()
        self._intended = IntendedShare(settings.probation, path)
        self._degrades = settings.reaction == "degrade"
        self._comfortable, self._firm = settings.comfortable, settings.firm
        self._emergency = settings.emergency
        self._assessed_at = 0
        self._hole: PathHole | None = None
        self._hole_ahead = 0.0
        self._all_lost_at = 0

    def receive(self, pose: ReceivedPose) -> Trace:
        """Pass a pose to its source, and return the source's trace."""
        source = self.all[pose.message.vehicle]
        source.receive(pose)
        return source.trace

    def windows(self, pose: Pose, settings: FitSettings, *, runs_out: bool) -> dict[Mode, Window]:
        """Preview data (Section III-A) of the sources that reach ahead of the ego.

        While the known path `runs_out`, the window extends behind by what is missing ahead, so that
        the fit stays equally certain. It ends before a hole that the car cannot cross.
        """
        behind, ahead = settings.behind(pose.speed), settings.ahead(pose.speed)
        self._find_hole(pose)
        if self._hole is not None and self._hole_ahead > 0.0 and not self._crossable:
            ahead = min(ahead, self._hole_ahead)
        windows: dict[Mode, Window] = {}
        for mode, source in self.used.items():
            known = source.freshness.known
            known = 0.0 if isnan(known) else known
            more = min(max(ahead - known, 0.0), ahead) if runs_out else 0.0
            window = source.window(pose.east, pose.north, behind + more, ahead)
            if window is not None:
                windows[mode] = window
        windows = self._without_bridges(windows, behind)
        alone, source = windows.get("predecessor"), self.predecessor
        if alone is not None and source.intended is not None and self._intended.value > 0.0:
            instants = source.trace.instants(alone)
            windows["predecessor"] = source.intended.corrected(
                alone, instants, self._intended.value
            )
        return windows

    def have_bridge_points(self, windows: Mapping[Mode, Window]) -> bool:
        return any(
            self.used[mode].trace.has_bridge_points(window) for mode, window in windows.items()
        )

    @property
    def bend(self) -> float:
        """Largest curvature (1/m) of the recently received poses."""
        return max([source.bend for source in self.used.values()])

    def sample_count(self, windows: Mapping[Mode, Window]) -> int:
        return sum([self.used[mode].trace.sample_count for mode in windows])

    def _without_bridges(self, windows: dict[Mode, Window], behind: float) -> dict[Mode, Window]:
        """Remove bridge points if a source has received samples around the car.

        Samples within `behind` (m) ahead and behind are required, or samples closer together than
        the bridge is long: within a longer hole a bridge is the better guess. If no samples behind
        are used, as in the paper, the path ahead suffices.
        """
        received: dict[Mode, Window] = {}
        bridged, longest = False, 0.0
        for mode, window in windows.items():
            trace = self.used[mode].trace
            received[mode] = trace.without_bridges(window)
            if received[mode] is not window:
                bridged, longest = True, max(longest, trace.longest_bridge(window))
        if not bridged:
            return windows
        received = {mode: window for mode, window in received.items() if reaches_ahead(window)}
        if behind == 0.0:
            return received or windows
        for mode, window in received.items():
            passed = int(window.station.searchsorted(0.0, "right"))
            beside = window.station[max(passed - 1, 0) : passed + 1].tolist()
            around = beside[0] <= 0.0 <= beside[-1]
            near = -behind <= beside[0] and beside[-1] <= behind
            if self.used[mode].weight and around and (near or beside[-1] - beside[0] < longest):
                return received
        return windows

    def steer_along(self, mode: Mode, span: float) -> None:
        """Blend between driven and intended path while steering along `mode` for `span` (s).

        The paper's followers without lead data follow the path driven (Section V-D.1).
        """
        self._intended.advance(mode, span)

    def alpha(self, alpha: float) -> float:
        """Weight of the predecessor, α of eq. (5), scaled by the weights of both sources."""
        lead, ahead = self.lead.weight, self.predecessor.weight
        if lead == ahead or lead + ahead == 0.0:
            return alpha
        total = (1.0 - alpha) * lead + alpha * ahead
        return alpha * ahead / total if total > 0.0 else alpha

    def assess(self, now: int, pose: Pose, acceleration: float, *, refit: bool) -> Situation:
        """Update all sources at a control instant `now` (ns); `acceleration` is the last one."""
        span = (now - self._assessed_at) / SECOND if self._assessed_at else 0.0
        self._assessed_at = now
        speed = pose.speed
        for source in self.all.values():
            source.update(now, pose, span, refit=refit)
        known = nan
        self.relied = {}
        for mode, source in self.used.items():
            freshness = source.freshness
            if freshness.status != "distrusted" and (isnan(known) or freshness.known > known):
                known = freshness.known
            if source.usable and freshness.status in RELIED_ON:
                self.relied[mode] = source
        if not any(source.gives_path for source in self.relied.values()):
            self.relied = {}
        hole = self._hole
        if hole is not None:
            self._hole_ahead -= 0.0 if refit else speed * span
            known = self._hole_ahead
        comfortable = _stop(speed, acceleration, self._comfortable)
        firm = _stop(speed, acceleration, self._firm)
        blind = _stop(speed, acceleration, self._emergency, period=span) - known
        blind = 0.0 if blind < 0.0 else blind
        lead, predecessor = self.lead.freshness, self.predecessor.freshness
        situation = Situation(lead, predecessor, known, comfortable, firm, blind)
        if hole is not None:
            situation.hole, situation.crossable = hole.length, self._crossable
        return situation

    @property
    def _crossable(self) -> bool:
        return self._hole is not None and self._hole.is_certain(self.bend)

    def _find_hole(self, pose: Pose) -> None:
        """Find the hole at which the known path of both sources ends, if there is one."""
        self._hole = None
        traces = [
            source.trace
            for source in self.used.values()
            if len(source.trace) and source.freshness.status != "distrusted"
        ]
        if [trace for trace in traces if trace.holes]:
            path = known_path(traces, pose.east, pose.north)
            self._hole_ahead, self._hole = path.end, path.hole

    @property
    def path_runs_out(self) -> bool:
        """Whether no source relied on extends the known path."""
        return all(source.path_ends for source in self.relied.values())

    def stops_at(self, mode: Mode, brakes_at: int) -> int:
        """Instant (ns) at which a car in `mode` begins to stop without new data, or 0.

        The earliest of three: the loss of the last source that it relies on or waits for, once a
        message of each is overdue; `brakes_at`, at which its guard brakes behind the predecessor (0
        for never); and the predecessor's own announced stop.
        """
        if not self._degrades:
            return 0
        awaited: Iterable[Source] = self.relied.values()
        if not self.relied:
            awaited = [source for source in self.used.values() if source.status in AWAITED]
        lost_at, all_overdue = 0, mode != "coast"
        for source in awaited:
            lost_at = max(lost_at, source.freshness.lost_at)
            all_overdue = all_overdue and source.is_overdue
        self._all_lost_at = lost_at or self._all_lost_at
        earliest = self._all_lost_at if all_overdue else 0
        for at in (brakes_at, self.predecessor.freshness.stops_at):
            if at and (at < earliest or not earliest):
                earliest = at
        return earliest


def _stop(speed: float, acceleration: float, braking: Braking, period: float = 0.0) -> float:
    """Braking distance (m), without releasing a brake that is already applied harder.

    Commands held for a `period` (s) are on average half a period ahead of the jerk ramp: 0.3 m at
    30 m/s and 50 Hz.
    """
    sooner = acceleration - 0.5 * braking.jerk * period
    emergency = -braking.deceleration
    return stopping_distance(speed, emergency if emergency > sooner else sooner, braking)
