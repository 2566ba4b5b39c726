"""The sources of a follower: the vehicles that it receives."""

from collections.abc import Collection, Mapping, Sequence
from math import inf, isnan, nan
from typing import Final

from vehicles.driver.controller import RELIED_ON
from vehicles.driver.intended_path import IntendedPath
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import UNUSED, Situation, stopping_distance
from vehicles.driver.source import Source, reaches_ahead
from vehicles.messages import Mode, State
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trace import PathHole, known_path
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

AWAITED: Final = ("unheard", "fresh", "late", "probation")  # Sources that keep a car going


class Sources:
    """The vehicles that a follower receives, and their use for the trajectory (Section III-A).

    `all` are in the order of the convoy, by name. `used` are the lateral ones, through whose poses
    the trajectory is fitted, `longitudinal` those by which the speed is controlled; `relied` are
    those of the lateral ones relied on at the last control instant. `lead` and `predecessor` are
    one source for the first follower, None if they are not received. `own_predecessor` is the name
    of the vehicle directly ahead. While that has left the convoy, `predecessor` is the next vehicle
    ahead that is received.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        settings: DegradationSettings,
        *,
        lead: str,
        predecessor: str,
        lateral: Collection[str],
        longitudinal: Collection[str] = (),
        relay: int = 0,
    ) -> None:
        """`lateral` and `longitudinal` name the sources of either direction of control.

        At least one of the lateral ones is ahead. The lead's message relays the predecessor's
        announced stop at the index `relay`.
        """
        self.all = {source.name: source for source in sources}
        self.lead, self.own_predecessor = self.all.get(lead), predecessor
        self.predecessor = self._own = self.all.get(predecessor)
        self.used = {name: source for name, source in self.all.items() if name in lateral}
        self.longitudinal = [self.all[name] for name in longitudinal]
        self.relied: dict[str, Source] = {}
        self._degrades = settings.reaction == "degrade"
        for source in self.used.values():
            if source is not self.lead and len(self.used) > 1 and self._degrades:
                source.may_leave_path = True
                if settings.predecessor_path == "intended":
                    source.intended = IntendedPath()
        chosen = self.lead, self.predecessor
        self._situation = Situation(
            self.lead.state if self.lead else UNUSED,
            self.predecessor.state if self.predecessor else UNUSED,
            others={one.name: one.state for one in self.all.values() if one not in chosen},
        )
        self._relay = relay
        self._relayed_stop = 0
        self._emergency = settings.emergency
        self._assessed_at = 0
        self._hole: PathHole | None = None
        self._hole_ahead = 0.0
        self._stops_at = 0

    def mode_along(self, source: Source) -> Mode:
        """Mode of a follower that steers along one source alone."""
        if source is self.lead:
            return "lead"
        return "predecessor" if source is self.predecessor else "intermediate"

    def receive(self, pose: ReceivedPose) -> Source:
        """Pass a pose to its source, and return that."""
        source, relayed = self.all[pose.message.vehicle], pose.message.relayed_stops_at_ns
        source.receive(pose)
        if 0 <= self._relay < len(relayed) and source is self.lead and source.trace.newest is pose:
            self._relayed_stop = relayed[self._relay]
        return source

    # ---- Preview data

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
            known = source.state.known
            known = 0.0 if isnan(known) else known
            more = min(max(ahead - known, 0.0), ahead) if runs_out else 0.0
            window = source.window(pose.east, pose.north, behind + more, ahead)
            if window is not None:
                windows[name] = window
        windows = self._without_bridges(windows, behind)
        for name, window in windows.items():
            source = self.used[name]
            if source.intended is not None:
                instants = source.trace.instants(window)
                windows[name] = source.intended.corrected(window, instants)
        return windows

    def samples_beside_bridge(self, windows: Mapping[str, Window]) -> int | None:
        """Number of received samples; None if the windows contain no points of a bridge."""
        traces = {name: self.used[name].trace for name in windows}
        bridged = any(traces[name].has_bridge_points(window) for name, window in windows.items())
        return sum([trace.sample_count for trace in traces.values()]) if bridged else None

    @property
    def bend(self) -> float:
        return max([source.bend for source in self.used.values()])  # 1/m

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

    def bend_limit(self, pose: Pose) -> float:
        """Largest acceleration (m/s²) in bends of the received path (see `BendsAhead`).

        By the lead alone while it is relied on: others turn to correct errors of their own.
        """
        lead = self.lead
        if lead is not None and lead.bends is not None and lead.state.status in RELIED_ON:
            return lead.bends.acceleration(pose)
        bends = [source.bends for source in self.all.values() if source.bends is not None]
        return min([one.acceleration(pose) for one in bends], default=inf)

    def place_of_left(self, speed: float) -> float:
        """Spacing (m) that a predecessor which has left would keep to the next vehicle ahead."""
        own, substitute = self._own, self.predecessor
        if own is None or substitute is None or substitute is own:
            return 0.0
        near, far = own.policy, substitute.policy
        return far.desired(speed) - near.desired(speed) if near and far else 0.0

    # ---- Weights

    def weights(self, alpha: float) -> dict[str, float]:
        """Weights of the lateral sources, which add up to 1.

        That of the predecessor is α of eq. (5), the others share 1 - α equally, in the paper the
        lead alone; without the predecessor all are equal. They are scaled by the weights of the
        sources.
        """
        used, predecessor, scaled = self.used, self.predecessor, dict[str, float]()
        others = len(used) - (predecessor is not None and predecessor.name in used)
        alpha = 0.0 if others == len(used) else alpha if others else 1.0
        total = 0.0
        for faded in (True, False):  # without any weight left, all sources count fully
            for name, source in used.items():
                share = alpha if source is predecessor else (1.0 - alpha) / others
                scaled[name] = share * source.weight if faded else share
                total += scaled[name]
            if total > 0.0:
                break
        return {name: share / total for name, share in scaled.items()}

    def predecessor_weight(self, alpha: float, weights: Mapping[str, float]) -> float:
        """Weight of the predecessor for the log; that of a first follower remains α of eq. (5)."""
        if self.predecessor is None:
            return 0.0
        return alpha if self.predecessor is self.lead else weights.get(self.predecessor.name, 0.0)

    # ---- State at a control instant

    def assess(self, now: int, pose: Pose, acceleration: float, *, refit: bool) -> Situation:
        """Update all sources at a control instant `now` (ns); `acceleration` is the last one."""
        span = (now - self._assessed_at) / SECOND if self._assessed_at else 0.0
        self._assessed_at = now
        for source in self.all.values():
            source.update(now, pose, span, refit=refit)
        self._follow_next()
        situation, known = self._situation, nan
        self.relied = {}
        for name, source in self.used.items():
            state = source.state
            if state.status != "distrusted" and (isnan(known) or known < state.known):
                known = state.known
            if source.gives_path:
                self.relied[name] = source
        own = self._own
        if own is not None and own.state.stops_at < self._relayed_stop:
            own.state.stops_at = self._relayed_stop
        hole = self._hole
        situation.hole, situation.crossable = 0.0, False
        if hole is not None:
            self._hole_ahead -= 0.0 if refit else pose.speed * span
            known = self._hole_ahead
            situation.hole, situation.crossable = hole.length, self._crossable
        situation.known = known
        emergency = self._emergency
        # Commands held for a period are on average half a period ahead of the jerk ramp.
        braked = max(acceleration - 0.5 * emergency.jerk * span, -emergency.deceleration)
        blind = stopping_distance(pose.speed, braked, emergency) - known
        situation.blind = 0.0 if blind < 0.0 else blind
        return situation

    def _follow_next(self) -> None:
        """Take the next received vehicle ahead as predecessor while that has left the convoy."""
        own = self._own
        if own is None or (not own.state.leaving and self.predecessor is own):
            return
        ahead = [one for one in self.all.values() if one.place == 0 or one.place > own.place]
        staying = [one for one in ahead if one is not own and not one.state.leaving]
        self.predecessor = staying[-1] if own.state.leaving and staying else own
        self._situation.predecessor = self.predecessor.state

    @property
    def _crossable(self) -> bool:
        return self._hole is not None and self._hole.is_certain(self.bend)

    def _find_hole(self, pose: Pose) -> None:
        """Find the hole at which the known path of all sources ends, if there is one."""
        self._hole = None
        traces = [
            source.trace
            for source in self.used.values()
            if len(source.trace) and source.state.status != "distrusted"
        ]
        if [trace for trace in traces if trace.holes]:
            path = known_path(traces, pose.east, pose.north)
            self._hole_ahead, self._hole = path.end, path.hole

    @property
    def path_runs_out(self) -> bool:
        return all(source.path_ends for source in self.relied.values())

    def stops_at(self, state: State) -> int:
        """Instant (ns) at which a car in `state` begins to stop without new data, 0 for never.

        It is the loss of the last source that keeps it going; while it stops, that instant stays.
        Behind a silent predecessor that announced an earlier stop, it brakes from that stop on.
        """
        if not self._degrades:
            return 0
        if state == "stop":
            return min(self._stops_at, self._assessed_at)
        for source in self.used.values():
            one = source.state
            if one.status in AWAITED and not source.has_left_path and one.lost_at > self._stops_at:
                self._stops_at = one.lost_at
        ahead = self._situation.predecessor
        if ahead.is_silent and ahead.measured_at < ahead.stops_at < self._stops_at:
            return ahead.stops_at
        return self._stops_at
