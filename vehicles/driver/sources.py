"""The sources of a follower: the vehicles that it receives."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import isnan, nan

from vehicles.driver.intended_path import IntendedPath, IntendedShare
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import Braking, DegradationSettings
from vehicles.driver.situation import UNUSED, Situation, stopping_distance
from vehicles.driver.source import RELIED_ON, Source, reaches_ahead
from vehicles.messages import Mode
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trace import PathHole, Trace, known_path
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

FOLLOWING: tuple[Mode, ...] = ("composite", "lead", "predecessor", "intermediate")
"""Modes in which a follower steers along sources."""
AWAITED = ("unheard", *RELIED_ON)  # May still determine a trajectory


class Sources:
    """The vehicles that a follower receives, and their use for the trajectory (Section III-A).

    `all` are in the order of the convoy, by name. `used` are the lateral ones, through whose poses
    the trajectory is fitted; `relied` are those relied on at the last control instant. `lead` and
    `predecessor` are one source for the first follower, None if they are not received.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        settings: DegradationSettings,
        *,
        lead: str,
        predecessor: str,
        lateral: Collection[str],
    ) -> None:
        """`lateral` are the names of at least one source ahead."""
        self.all = {source.name: source for source in sources}
        self.lead = self.all.get(lead)
        self.predecessor = self.all.get(predecessor)
        self.used = {name: source for name, source in self.all.items() if name in lateral}
        self.relied: dict[str, Source] = {}
        self._degrades = settings.reaction == "degrade"
        corrects = False
        for source in self.used.values():
            if source is not self.lead and len(self.used) > 1 and self._degrades:
                source.may_leave_path = True
                if settings.predecessor_path != "driven":
                    source.intended = IntendedPath()
                    corrects = True
        path = settings.predecessor_path if corrects else "driven"
        self._intended = IntendedShare(settings.probation, path)
        self._others = {
            name: source
            for name, source in self.all.items()
            if source is not self.lead and source is not self.predecessor
        }
        self._comfortable, self._firm = settings.comfortable, settings.firm
        self._emergency = settings.emergency
        self._assessed_at = 0
        self._hole: PathHole | None = None
        self._hole_ahead = 0.0
        self._all_lost_at = 0

    def mode_along(self, source: Source) -> Mode:
        """Mode of a follower that steers along one source alone."""
        if source is self.lead:
            return "lead"
        return "predecessor" if source is self.predecessor else "intermediate"

    def receive(self, pose: ReceivedPose) -> Trace:
        """Pass a pose to its source, and return the source's trace."""
        source = self.all[pose.message.vehicle]
        source.receive(pose)
        return source.trace

    def windows(self, pose: Pose, settings: FitSettings, *, runs_out: bool) -> dict[str, Window]:
        """Preview data (Section III-A) of the sources that reach ahead of the ego.

        While the known path `runs_out`, the window extends behind by what is missing ahead, so that
        the fit stays equally certain. It ends before a hole that the car cannot cross.
        """
        behind, ahead = settings.behind(pose.speed), settings.ahead(pose.speed)
        self._find_hole(pose)
        if self._hole is not None and self._hole_ahead > 0.0 and not self._crossable:
            ahead = min(ahead, self._hole_ahead)
        windows: dict[str, Window] = {}
        for name, source in self.used.items():
            known = source.freshness.known
            known = 0.0 if isnan(known) else known
            more = min(max(ahead - known, 0.0), ahead) if runs_out else 0.0
            window = source.window(pose.east, pose.north, behind + more, ahead)
            if window is not None:
                windows[name] = window
        windows = self._without_bridges(windows, behind)
        share = self._intended.value
        for name, window in windows.items() if share > 0.0 else ():
            source = self.used[name]
            if source.intended is not None:
                instants = source.trace.instants(window)
                windows[name] = source.intended.corrected(window, instants, share)
        return windows

    def have_bridge_points(self, windows: Mapping[str, Window]) -> bool:
        return any(
            self.used[name].trace.has_bridge_points(window) for name, window in windows.items()
        )

    @property
    def bend(self) -> float:
        return max([source.bend for source in self.used.values()])  # 1/m

    def sample_count(self, windows: Mapping[str, Window]) -> int:
        return sum([self.used[name].trace.sample_count for name in windows])

    def _without_bridges(self, windows: dict[str, Window], behind: float) -> dict[str, Window]:
        """Remove bridge points if a source has received samples around the car.

        Samples within `behind` (m) ahead and behind are required, or samples closer together than
        the bridge is long: within a longer hole a bridge is the better guess. If no samples behind
        are used, as in the paper, the path ahead suffices.
        """
        received: dict[str, Window] = {}
        bridged, longest = False, 0.0
        for name, window in windows.items():
            trace = self.used[name].trace
            received[name] = trace.without_bridges(window)
            if received[name] is not window:
                bridged, longest = True, max(longest, trace.longest_bridge(window))
        if not bridged:
            return windows
        received = {name: window for name, window in received.items() if reaches_ahead(window)}
        if behind == 0.0:
            return received or windows
        for name, window in received.items():
            passed = int(window.station.searchsorted(0.0, "right"))
            beside = window.station[max(passed - 1, 0) : passed + 1].tolist()
            around = beside[0] <= 0.0 <= beside[-1]
            near = -behind <= beside[0] and beside[-1] <= behind
            if self.used[name].weight and around and (near or beside[-1] - beside[0] < longest):
                return received
        return windows

    def steer_along(self, mode: Mode, span: float) -> None:
        """Blend between driven and intended path while steering along `mode` for `span` (s).

        The paper's followers without lead data follow the path driven (Section V-D.1).
        """
        if mode not in FOLLOWING:
            return
        by_lead = mode == "lead" or (
            mode == "composite" and self.lead is not None and self.lead.name in self.relied
        )
        self._intended.advance(span, without_lead=not by_lead)

    def weights(self, alpha: float) -> dict[str, float]:
        """Weights of the lateral sources, which add up to 1.

        That of the predecessor is α of eq. (5), the others share 1 - α equally, in the paper the
        lead alone; without the predecessor all are equal. They are scaled by the weights of the
        sources.
        """
        used = list(self.used.values())
        others = [source for source in used if source is not self.predecessor]
        count = len(others)
        ahead = 0.0
        if count < len(used) and self.predecessor is not None:
            ahead = self._weight_of_predecessor(alpha, others, self.predecessor)
        rest, total = 1.0 - ahead, sum([source.weight for source in others])
        return {
            source.name: ahead
            if source is self.predecessor
            else rest * (source.weight / total if total > 0.0 else 1.0 / count)
            for source in used
        }

    def predecessor_weight(self, alpha: float, weights: Mapping[str, float]) -> float:
        """Weight of the predecessor for the log; that of a first follower remains α of eq. (5)."""
        if self.predecessor is None:
            return 0.0
        return alpha if self.predecessor is self.lead else weights.get(self.predecessor.name, 0.0)

    def _weight_of_predecessor(
        self, alpha: float, others: Sequence[Source], predecessor: Source
    ) -> float:
        """Weight α of eq. (5) of the predecessor, scaled by the weights of the sources."""
        if not others:
            return 1.0
        own = [source.weight for source in others]
        if max(own) == min(own) == predecessor.weight or sum(own) + predecessor.weight == 0.0:
            return alpha
        total = sum([(1.0 - alpha) / len(own) * weight for weight in own])
        total += alpha * predecessor.weight
        return alpha * predecessor.weight / total if total > 0.0 else alpha

    def assess(self, now: int, pose: Pose, acceleration: float, *, refit: bool) -> Situation:
        """Update all sources at a control instant `now` (ns); `acceleration` is the last one."""
        span = (now - self._assessed_at) / SECOND if self._assessed_at else 0.0
        self._assessed_at = now
        speed = pose.speed
        for source in self.all.values():
            source.update(now, pose, span, refit=refit)
        known = nan
        self.relied = {}
        for name, source in self.used.items():
            freshness = source.freshness
            if freshness.status != "distrusted" and (isnan(known) or freshness.known > known):
                known = freshness.known
            if source.usable and freshness.status in RELIED_ON:
                self.relied[name] = source
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
        lead = self.lead.freshness if self.lead else UNUSED
        predecessor = self.predecessor.freshness if self.predecessor else UNUSED
        situation = Situation(lead, predecessor, known, comfortable, firm, blind)
        if self._others:
            situation.others = {name: one.freshness for name, one in self._others.items()}
        if hole is not None:
            situation.hole, situation.crossable = hole.length, self._crossable
        return situation

    @property
    def _crossable(self) -> bool:
        return self._hole is not None and self._hole.is_certain(self.bend)

    def _find_hole(self, pose: Pose) -> None:
        """Find the hole at which the known path of all sources ends, if there is one."""
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
        its_stop = self.predecessor.freshness.stops_at if self.predecessor else 0
        for at in (brakes_at, its_stop):
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
