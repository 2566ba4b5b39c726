"""A follower fuses the poses received from vehicles ahead and steers along the result.

Each tick updates the own state, checks received poses and adds them to their source (`sources`),
refits the trajectory if poses arrived (`_fit`), and derives the state and the mode from the sources
(`modes`), the steering from the errors against the trajectory (`_steer`), and the speed from the
vehicles ahead (`speed_guard`).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import isnan, nan
from typing import Final

from vehicles.car.dynamics import Actuation, Body, achieved_acceleration
from vehicles.car.gnss import Fix
from vehicles.car.gnss_settings import GnssSettings
from vehicles.car.imu import Motion
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.command_limit import CommandLimit, PositionLimit
from vehicles.driver.controller import OwnMotion, SourceMotion, SpacingPolicy, VehiclesAhead
from vehicles.driver.decision import Decision
from vehicles.driver.intended_path import path_offset
from vehicles.driver.modes import ModesByReach, StateMachine
from vehicles.driver.own_state import OwnState, Pose
from vehicles.driver.plausibility import PoseJudge
from vehicles.driver.reactions import ReactionPolicy
from vehicles.driver.settings import DegradationSettings, InstantDraw
from vehicles.driver.situation import RELIED_ON, Situation
from vehicles.driver.slip_estimator import LoadWatch
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.driver.speed import SpeedCommand
from vehicles.driver.speed_guard import NoOverride, SpeedGuard
from vehicles.driver.steering import BendsAhead, LateralController, SteeringCommand
from vehicles.driver.tracking import OwnPath, PathBehind, Rejoining, TrackingErrors, track
from vehicles.messages import Mode
from vehicles.preview.curve_fit import MIN_WEIGHT_FOR_NOISE, FitSettings
from vehicles.preview.fusion import CompositeFusion, SourceFusion
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import Fit, SourceWindow
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import MILLISECOND, SECOND, Cadence, Timer

REFIT_AFTER: Final = 50 * MILLISECOND  # Period (ns) of refits, so that a silent source is noticed
JUST_BEGUN: Final = 3
"""Up to this number of samples beyond the initial bridge make no bend: their offset from its line
may be noise of the sample at which the bridge ends."""

ONE_SOURCE: Final = ("lead", "predecessor", "intermediate")
KEEPING: Final = ("coast", "stop", "straight")  # Keep the last trajectory
FADE_TIME: Final = 1.0  # Driving time (s) over which the curvature fades beyond the samples
SLOWEST_FADE: Final = 1.0  # The fade of slower cars is that of this speed (m/s)
REMARKED: Final = ("contact", "announced stop")  # Overrides whose begin is a line of the log


class Follower:
    """Steers along the composite trajectory of its sources (paper, Section III).

    When a source stops sending, the others are followed. When all have stopped, the last trajectory
    is kept, and the car stops within it, or reacts as configured.
    """

    def __init__(
        self,
        *,
        own_state: OwnState,
        controller: LateralController,
        speed_guard: SpeedGuard | NoOverride,
        control: Cadence,
        lead: str,
        predecessor: str,
        places: Mapping[str, int],
        lateral: Collection[str],
        longitudinal: Collection[str],
        least_spacing: float,
        periods: Mapping[str, float],
        delays: Mapping[str, float] | None = None,
        lags: Mapping[str, float] | None = None,
        policies: Mapping[str, SpacingPolicy] | None = None,
        alpha: float,
        fusion: SourceFusion,
        settings: FitSettings,
        degradation: DegradationSettings,
        reaction: ReactionPolicy,
        limit: CommandLimit | None = None,
        load: LoadWatch | None = None,
        receivers: Mapping[str, GnssSettings] | None = None,
        bends: Mapping[str, BendsAhead] | None = None,
        drive_lag: float,
        relay: int = 0,
        draw: InstantDraw | None = None,
    ) -> None:
        """`alpha` in [0, 1] is the weight of the predecessor, the others share 1 - alpha.

        `places` has all sources from front to back, `lateral` and `longitudinal` name those of
        either direction of control (see `Source`: 0 is the lead, k the k-th vehicle ahead).
        `periods` (s) between messages, `delays` (s) of the first message, drive `lags` (s), spacing
        `policies` and `receivers` are by source; without a receiver only jumps are refused.
        `bends` by source limit the speed. `least_spacing` (m) to the predecessor is that at which
        the bumpers touch. `drive_lag` (s) is the car's. The lead's message repeats the
        predecessor's announced stop at the index `relay`. `draw` has the random numbers of
        controllers, fusion and reaction.
        """
        self._draw, self._drive_lag = draw, drive_lag
        self._chosen: Mode | None = None
        self._own_state = own_state
        self._controller = controller
        self._speed_guard = speed_guard
        self._control = control
        self._least_spacing = least_spacing
        self._rate_hz, self._period = control.rate_hz, 1.0 / control.rate_hz
        self._alpha = alpha
        self._fusion: SourceFusion = CompositeFusion() if len(lateral) == 1 else fusion
        self._settings = settings
        self._stated_noise = settings.with_stated_noise()
        self._cautious, self._line_only = settings.cautious(), settings.line_only()
        self._limit = limit or CommandLimit()
        self._load = load or LoadWatch()
        self._position_limit = PositionLimit(degradation)
        self._bends = bends or {}
        self._remarks: list[str] = []
        delays, receivers, lags = delays or {}, receivers or {}, lags or {}
        self._sources = Sources(
            [
                Source(
                    name,
                    periods[name],
                    degradation,
                    delays.get(name, 0.0),
                    self._judge(name, receivers.get(name), degradation),
                    place,
                    lags.get(name, 0.0),
                )
                for name, place in places.items()
            ],
            degradation,
            lead=lead,
            predecessor=predecessor,
            lateral=lateral,
            relay=relay,
        )
        self._predecessor, self._policies = predecessor, policies or {}
        self._longitudinal = [self._sources.all[name] for name in longitudinal]
        self._own_path = OwnPath()
        self._degrades = degradation.reaction == "degrade"
        self._reaction = reaction
        self._machine = StateMachine(degradation) if self._degrades else ModesByReach()
        self._trajectories: tuple[tuple[float, Fit], ...] = ()
        self._driven = 0.0
        self._behind: dict[int, PathBehind] = {}
        self._fitted = False
        self._rejoining = Rejoining(self._remarks, enabled=self._degrades)
        self._mode: Mode = "straight"
        self._override = ""
        self._refit = Timer(REFIT_AFTER)
        self._decided_at = 0
        self._own = OwnMotion()
        self._measured: GapMeasurement | None = None
        self._decision: Decision | None = None

    def _judge(
        self, name: str, receiver: GnssSettings | None, settings: DegradationSettings
    ) -> PoseJudge:
        gate, settle = settings.gate, settings.probation
        return PoseJudge(name, receiver, gate=gate, settle=settle, remarks=self._remarks)

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[ReceivedPose],
        gap: GapMeasurement | None = None,
    ) -> Decision:
        """Decide at `now` (ns), Sections III-A to III-E; between control instants hold."""
        self._load.observe(now, motion)
        self._own_state.update(now, fix, motion)
        if gap is not None:
            self._measured = gap
        for pose in received:
            self._receive(now, pose)
        if self._decision is not None and not self._control.due(now):
            self._decision = decision = self._decision.held()
            decision.achieved = self._achieved(now)
        else:
            self._decision = decision = self._decide(now, self._own_state.at(now))
        if fix is not None:
            decision.path_offset = (
                path_offset(self._trajectories[0][1], fix) if self._trajectories else nan
            )
        return decision

    def _receive(self, now: int, pose: ReceivedPose) -> None:
        trace, name = self._sources.receive(pose), pose.message.vehicle
        bends = self._bends.get(name)
        if bends is not None and trace.newest is pose:  # accepted
            bends.add(pose)
        if name == self._predecessor:
            self._position_limit.predecessor_accuracy = pose.message.position_accuracy_m
        if not trace.joined and self._sources.all[name].place >= 0:
            own = self._own_state.at(now)
            trace.bridge(own.east, own.north, own.yaw)
        self._refit.due_at = now

    def _decide(self, now: int, pose: Pose) -> Decision:
        last, sources = self._decision, self._sources
        self._advance_own(now, pose)
        refit = self._refit.is_due(now)
        if refit:
            self._fit(pose)
        acceleration = last.actuation.acceleration if last else 0.0
        situation = sources.assess(now, pose, acceleration, refit=refit)
        reason = self._decide_mode(now, situation, pose.speed)
        sources.steer_along(self._mode, self._period)
        errors, command = self._steer(now, pose)
        held = last.steering if last else command
        command = self._reaction.steering(self._mode, command, held)
        steering = self._limit.limited(command)
        self._position_limit.observe(self._own_state.lateral_deviation)
        margin = self._position_limit.gap_margin(self._period)
        ahead = situation.ahead = self._vehicles_ahead(now, pose, errors, margin)
        self._load.record_command(steering.steering)
        situation.weights = sources.weights(self._alpha)
        situation.predecessor_weight = sources.predecessor_weight(self._alpha, situation.weights)
        crossing = situation.hole > 0.0 and situation.known <= 0.0
        situation.hazard = self._mode == "stop" or self._rejoining.is_active or crossing
        self._speed_guard.is_slowed = self._position_limit.is_active
        situation.speed_limit = self._rejoining.speed_limit
        guarded = self._speed_guard.command(now, pose, ahead, situation)
        speed = self._position_limit.limited(guarded, pose.speed, acceleration, self._period)
        override = guarded.override if speed is guarded else "position"
        wanted = self._reaction.acceleration(situation, self._mode, pose.speed, speed.acceleration)
        if wanted != speed.acceleration:
            speed = SpeedCommand(wanted, min(speed.target_speed, pose.speed))
        situation.stops_at = sources.stops_at(situation.state)
        if guarded.override != self._override:
            self._override = guarded.override
            if self._override in REMARKED:
                self._remarks.append(f"braking: {self._override}: {guarded.evidence}")
        if guarded.evidence:
            text = f"{override}: {guarded.evidence}"
            reason = f"{reason}; {text}" if reason else text
        remarks = tuple(self._remarks) if self._remarks else ()
        self._remarks.clear()
        return Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode=self._mode,
            reason=self._position_limit.joined(reason),
            fit=self._trajectories[0][1] if refit and self._fitted else None,
            target_speed=speed.target_speed,
            law_acceleration=guarded.law,
            override=override,
            achieved=self._own.achieved,
            estimated_gap=ahead.spacing + margin - self._least_spacing,
            lateral_deviation=self._own_state.lateral_deviation,
            measured_gap=ahead.measured_gap,
            measured_gap_rate=ahead.measured_gap_rate,
            own_pose=pose,
            situation=situation,
            remarks=remarks,
        )

    def _decide_mode(self, now: int, situation: Situation, speed: float) -> str:
        """Set the mode, which the policy may choose, and return its reason."""
        machine, sources, has_path = self._machine, self._sources, bool(self._trajectories)
        if isinstance(machine, StateMachine):
            mode, reason = machine.decide(now, sources, situation, speed, has_path=has_path)
        else:
            mode, reason = machine.decide(sources, fitted=self._fitted, has_path=has_path)
        self._mode = self._reaction.mode(situation, mode, speed)
        if self._mode == mode:
            self._chosen = None
            return reason
        self._chosen = self._mode
        return f"chosen by the policy; {reason}" if reason else "chosen by the policy"

    def _fit(self, pose: Pose) -> None:
        """Fit the received samples; if there are too few keep the last trajectory."""
        degrades = self._degrades
        runs_out = degrades and (self._mode == "stop" or self._sources.path_runs_out)
        windows = self._sources.windows(pose, self._settings, runs_out=runs_out)
        chosen = self._chosen
        if chosen in ONE_SOURCE:
            windows = {
                name: window
                for name, window in windows.items()
                if self._sources.mode_along(self._sources.all[name]) == chosen
            }
        weights = self._sources.weights(self._alpha)
        if chosen in ONE_SOURCE:
            weights = {name: 1.0 / len(windows) for name in windows}
        sources = [
            SourceWindow(self._sources.all[name].place, weights[name], window)
            for name, window in windows.items()
        ]
        along = tuple(self._fusion.fuse(sources, self._settings_for(windows)))
        if degrades and self._fitted and not along:
            self._extrapolate(pose.speed)
        self._fitted = bool(along)
        if chosen not in KEEPING:
            self._trajectories = along or self._trajectories
        self._measure_spacings(pose)

    def _settings_for(self, windows: Mapping[str, Window]) -> FitSettings:
        """Settings of the fit; bridge points weaken the evidence for a bend."""
        if not self._sources.have_bridge_points(windows):
            return self._settings
        count = self._sources.sample_count(windows)
        if count < MIN_WEIGHT_FOR_NOISE:
            return self._cautious if count > JUST_BEGUN else self._line_only
        return self._stated_noise

    def _steer(self, now: int, pose: Pose) -> tuple[TrackingErrors, SteeringCommand]:
        """Errors and command along each trajectory, blended by their shares."""
        if not self._trajectories:
            errors = TrackingErrors(0.0, 0.0, pose.yaw_rate, 0.0)
            return errors, self._controller.steer(errors, pose.speed)
        self._driven += pose.speed / self._rate_hz
        if len(self._trajectories) == 1:
            errors = self._track(self._trajectories[0][1], pose)
            corrected = self._rejoining.corrected(now, errors, pose.speed)
            return errors, self._controller.steer(corrected, pose.speed)
        tracked = [(share, self._track(fit, pose)) for share, fit in self._trajectories]
        return blended([(share, e, self._controller.steer(e, pose.speed)) for share, e in tracked])

    def _extrapolate(self, speed: float) -> None:
        """Extend the last trajectories of Section III-A, whose samples now end behind the car."""
        length, bend = FADE_TIME * max(speed, SLOWEST_FADE), self._sources.bend
        self._trajectories = tuple(
            [
                (share, replace(fit, spline=fit.spline.fading(length, bend)))
                for share, fit in self._trajectories
            ]
        )

    def _track(self, fit: Fit, pose: Pose) -> TrackingErrors:
        """Errors along a trajectory; blended sources each have their own path behind."""
        errors = track(fit.spline, pose)
        place = fit.source.item(0) if self._fusion.separate else 0
        behind = self._behind.get(place)
        if behind is None:
            behind = self._behind[place] = PathBehind()
        behind.extend(self._driven, errors)
        errors.behind = behind
        return errors

    def _measure_spacings(self, pose: Pose) -> None:
        """Spacings (m) to the newest poses of the sources."""
        for source in self._sources.all.values():
            if source.place >= 0:
                spacing = source.trace.spacing(pose.east, pose.north)
                if spacing is not None:
                    source.state.spacing = spacing
        for source in self._longitudinal:
            newest = source.trace.newest
            if source.place < 0 and newest is not None:
                source.state.spacing = self._own_path.spacing(
                    source.name, newest.east, newest.north, pose
                )

    def _vehicles_ahead(
        self, now: int, pose: Pose, errors: TrackingErrors, margin: float
    ) -> VehiclesAhead:
        """Motion of the longitudinal sources, and of the predecessor if it is received.

        Those of lead and predecessor are predicted to now; spacings are reduced by a `margin` (m).
        In place of a predecessor that has left, the next vehicle ahead is followed, so much further
        back that the place of the one that left, which a human drives, stays free.
        """
        ahead = VehiclesAhead(curvature_ahead=errors.curvature_ahead, bend=self._bend(pose))
        ahead.own = self._own
        if self._measured is not None:
            measured = self._measured.at(now)
            ahead.measured_gap, ahead.measured_gap_rate, ahead.measured_gap_age = measured
        lead, place = self._sources.lead, self._place_of_left(pose.speed)
        if lead in self._longitudinal and lead is not None and not isnan(lead.state.age):
            _, ahead.lead_speed, ahead.lead_acceleration = lead.state.predicted()
        predecessor = self._sources.predecessor
        if predecessor is not None:
            state = predecessor.state
            if isnan(state.age):
                return ahead
            driven, ahead.predecessor_speed, ahead.predecessor_acceleration = state.predicted()
            ahead.spacing = state.spacing + driven - margin - place
        sources = dict[str, SourceMotion]()
        for source in self._longitudinal:
            state = source.state
            if not isnan(state.spacing):
                relied_on = state.status in RELIED_ON if self._degrades else None
                sources[source.name] = SourceMotion(
                    state.spacing - margin, state.speed, state.acceleration, state.age, relied_on
                )
        if place and predecessor is not None and predecessor.name in sources:
            sources[self._predecessor] = replace(
                sources[predecessor.name], spacing=predecessor.state.spacing - margin - place
            )
        ahead.sources = sources
        return ahead

    def _place_of_left(self, speed: float) -> float:
        """Spacing (m) that a predecessor which has left would keep to the next vehicle ahead."""
        substitute = self._sources.predecessor
        if substitute is None or substitute.name == self._predecessor:
            return 0.0
        near, far = self._policies.get(self._predecessor), self._policies.get(substitute.name)
        return far.desired(speed) - near.desired(speed) if near and far else 0.0

    def _achieved(self, now: int) -> float:
        """Acceleration (m/s²) that the drive has reached at `now` (ns) by the last command."""
        span = (now - self._decided_at) / SECOND
        command = self._decision.actuation.acceleration if self._decision else 0.0
        return achieved_acceleration(self._own.achieved, command, span, self._drive_lag)

    def _advance_own(self, now: int, pose: Pose) -> None:
        """Motion of the car at the control instant `now` (ns), for the longitudinal controller."""
        if self._draw is not None:
            self._draw.now = now
        step = (now - self._decided_at) / SECOND if self._decided_at else 0.0
        if self._longitudinal[-1].place < 0:
            self._own_path.extend(now, pose)
        if pose.speed <= 0.0:
            self._own.achieved = 0.0  # it stands, as its drive assumes
        command = self._decision.actuation.acceleration if self._decision else 0.0
        achieved = self._achieved(now) if self._decided_at else 0.0
        self._decided_at = now
        self._own = OwnMotion(step, command, self._own.distance + pose.speed * step, achieved)

    def _bend(self, pose: Pose) -> tuple[float, float] | None:
        """Bend of the received path that allows the lowest speed now (see `BendsAhead`).

        By the lead alone while it is relied on: others turn to correct errors of their own.
        """
        lead = self._sources.lead
        if lead is not None and lead.name in self._bends and lead.state.status in RELIED_ON:
            return self._bends[lead.name].allowed(pose.east, pose.north)
        found = [bends.allowed(pose.east, pose.north) for bends in self._bends.values()]
        return min((bend for bend in found if bend is not None), default=None)


def blended(
    parts: Sequence[tuple[float, TrackingErrors, SteeringCommand]],
) -> tuple[TrackingErrors, SteeringCommand]:
    return (
        TrackingErrors(
            lateral=sum([share * e.lateral for share, e, _ in parts]),
            heading=sum([share * e.heading for share, e, _ in parts]),
            yaw_rate=sum([share * e.yaw_rate for share, e, _ in parts]),
            curvature=sum([share * e.curvature for share, e, _ in parts]),
        ),
        SteeringCommand(
            steering=sum([share * c.steering for share, _, c in parts]),
            feedforward=sum([share * c.feedforward for share, _, c in parts]),
            feedback=sum([share * c.feedback for share, _, c in parts]),
        ),
    )
