"""A follower fuses the poses received from vehicles ahead and steers along the result.

Each tick updates the own state, checks received poses and adds them to their source (`sources`),
refits the trajectory if poses arrived (`_fit`), and derives the state and the mode from the sources
(`modes`), the steering from the errors against the trajectory (`_steer`), and the speed from the
vehicles ahead (`speed_guard`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isnan, nan
from typing import Final

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.command_limit import CommandLimit, PositionLimit
from vehicles.driver.controller import OwnMotion, VehiclesAhead
from vehicles.driver.decision import Decision
from vehicles.driver.intended_path import path_offset
from vehicles.driver.modes import ModesByReach, StateMachine, Trajectory
from vehicles.driver.own_state import Pose
from vehicles.driver.pose_estimator import OwnState
from vehicles.driver.reactions import ReactionPolicy
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.slip_estimator import LoadWatch
from vehicles.driver.sources import Sources
from vehicles.driver.speed import SpeedLaw
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import PathBehind, Rejoining, TrackingErrors, track
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.fusion import CompositeFusion, SourceFusion, fused
from vehicles.preview.trajectory import Fit, SourceWindow
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import MILLISECOND, SECOND, Cadence, Timer

REFIT_AFTER: Final = 50 * MILLISECOND  # Period (ns) of refits, so that a silent source is noticed
FADE_TIME: Final = 1.0  # Driving time (s) over which the curvature fades beyond the samples
SLOWEST_FADE: Final = 1.0  # The fade of slower cars is that of this speed (m/s)
REMARKED: Final = ("contact", "announced stop")  # Overrides whose begin is a line of the log


@dataclass(kw_only=True, eq=False)
class Follower:
    """Steers along the composite trajectory of its sources (paper, Section III).

    When a source stops sending, the others are followed. When all have stopped, the last trajectory
    is kept, and the car stops within it, or reacts as configured.

    `alpha` in [0, 1] is the weight of the predecessor, the others share 1 - alpha. The `speed_law`
    is overridden by the `guard`, if there is one. `least_spacing` (m) to the predecessor is that at
    which the bumpers touch. `drive_lag` (s) is that of the car. Lines for the log are appended to
    `remarks`, which the sources share.
    """

    own_state: OwnState
    controller: LateralController
    speed_law: SpeedLaw
    guard: SpeedGuard | None
    control: Cadence
    sources: Sources
    least_spacing: float
    alpha: float
    fusion: SourceFusion
    settings: FitSettings
    degradation: DegradationSettings
    reaction: ReactionPolicy
    limit: CommandLimit = field(default_factory=CommandLimit)
    load: LoadWatch = field(default_factory=LoadWatch)
    drive_lag: float = 0.0
    remarks: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if len(self.sources.used) == 1:
            self.fusion = CompositeFusion()
        self._degrades = self.degradation.reaction == "degrade"
        self._period = 1.0 / self.control.rate_hz
        self._position_limit = PositionLimit(self.degradation)
        self._machine = StateMachine(self.degradation) if self._degrades else ModesByReach()
        self._trajectories: tuple[tuple[float, Fit], ...] = ()
        self._driven = 0.0
        self._behind: dict[int, PathBehind] = {}
        self._fitted = self._is_kept = False
        self._rejoining = Rejoining(self.remarks, enabled=self._degrades)
        self._refit = Timer(REFIT_AFTER)
        self._decided_at = 0
        self._own = OwnMotion()
        self._measured: GapMeasurement | None = None
        self._decision: Decision | None = None

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[ReceivedPose],
        gap: GapMeasurement | None = None,
    ) -> Decision:
        """Decide at `now` (ns), Sections III-A to III-E; between control instants hold."""
        self.load.observe(now, motion)
        self.own_state.update(now, fix, motion)
        if gap is not None:
            self._measured = gap
        for pose in received:
            self._receive(now, pose)
        if self._decision is not None and not self.control.due(now):
            self._decision = decision = self._decision.held(now, self.drive_lag)
        else:
            self._decision = decision = self._decide(now, self.own_state.at(now))
        if fix is not None:
            decision.path_offset = (
                path_offset(self._trajectories[0][1], fix) if self._trajectories else nan
            )
        return decision

    def _receive(self, now: int, pose: ReceivedPose) -> None:
        source = self.sources.receive(pose)
        if not source.trace.joined and source.place >= 0:
            own = self.own_state.at(now)
            source.trace.bridge(own.east, own.north, own.yaw)
        self._refit.due_at = now

    def _decide(self, now: int, pose: Pose) -> Decision:
        last, sources, limit = self._decision, self.sources, self._position_limit
        self._advance_own(now, pose.speed, last)
        refit = self._refit.is_due(now)
        if refit:
            self._fit(pose, last)
        acceleration = last.actuation.acceleration if last else 0.0
        situation = sources.assess(now, pose, acceleration, refit=refit)
        usual, reason = self._machine.decide(now, sources, situation, pose.speed, self._trajectory)
        mode = self.reaction.mode(situation, usual, pose.speed)
        self._is_kept = mode != usual
        errors, command = self._steer(now, pose)
        command = self.reaction.steering(mode, command, last.steering if last else command)
        steering = self.limit.limited(command)
        self.load.record_command(steering.steering)
        limit.observe(self.own_state.lateral_deviation)
        newest = sources.predecessor.trace.newest if sources.predecessor else None
        margin = limit.gap_margin(newest.accuracy if newest else 0.0)
        ahead = situation.ahead = self._vehicles_ahead(now, pose, errors, margin)
        situation.weights = sources.weights(self.alpha)
        situation.predecessor_weight = sources.predecessor_weight(self.alpha, situation.weights)
        crossing = situation.hole > 0.0 and situation.known <= 0.0
        situation.hazard = mode == "stop" or self._rejoining.is_active or crossing
        situation.speed_limit, situation.position_limit = self._rejoining.speed_limit, limit.speed
        gap = ahead.spacing + margin - self.least_spacing
        if self.guard is not None:
            speed = self.guard.command(now, pose, ahead, situation)
        else:
            speed = self.speed_law.command(now, pose, ahead)
            speed.law = speed.acceleration = min(speed.acceleration, ahead.bend)
        wanted = self.reaction.acceleration(situation, mode, pose.speed, speed.acceleration)
        target = speed.target_speed
        if wanted != speed.acceleration:
            target = min(target, pose.speed)
        situation.stops_at = sources.stops_at(situation.state)
        if speed.override in REMARKED and (last is None or last.override != speed.override):
            self.remarks.append(f"braking: {speed.override}: {speed.evidence}")
        remarks = tuple(self.remarks) if self.remarks else ()
        self.remarks.clear()
        parts = [
            "" if mode == usual else "chosen by the policy",
            reason,
            f"{speed.override}: {speed.evidence}" if speed.evidence else "",
            limit.reason,
        ]
        return Decision(
            at=now,
            actuation=Actuation(steering.steering, wanted),
            steering=steering,
            errors=errors,
            mode=mode,
            reason="; ".join([part for part in parts if part]),
            fit=self._trajectories[0][1] if refit and self._fitted else None,
            target_speed=target,
            law_acceleration=speed.law,
            override=speed.override,
            achieved=self._own.achieved,
            estimated_gap=gap,
            lateral_deviation=self.own_state.lateral_deviation,
            measured_gap=ahead.measured_gap,
            measured_gap_rate=ahead.measured_gap_rate,
            own_pose=pose,
            situation=situation,
            remarks=remarks,
        )

    @property
    def _trajectory(self) -> Trajectory:
        if not self._trajectories:
            return "none"
        return "fitted" if self._fitted else "kept"

    def _fit(self, pose: Pose, last: Decision | None) -> None:
        """Fit the received samples; if there are too few keep the last trajectory.

        It is also kept in a mode that the policy chose.
        """
        stops = last is not None and last.mode == "stop"
        runs_out = self._degrades and (stops or self.sources.path_runs_out)
        windows = self.sources.windows(pose, self.settings, runs_out=runs_out)
        weights = self.sources.weights(self.alpha)
        sources = [
            SourceWindow(self.sources.all[name].place, weights[name], window)
            for name, window in windows.items()
        ]
        count, settings = self.sources.samples_beside_bridge(windows), self.settings
        settings = settings if count is None else settings.beside_bridge(count)
        along = fused(self.fusion, sources, settings, self.sources.bend, pose.speed)
        if self._degrades and self._fitted and not along:
            self._extrapolate(pose.speed)
        self._fitted = bool(along)
        if not self._is_kept:
            self._trajectories = along or self._trajectories

    def _steer(self, now: int, pose: Pose) -> tuple[TrackingErrors, SteeringCommand]:
        """Errors and command along each trajectory, blended by their shares."""
        if not self._trajectories:
            errors = TrackingErrors(0.0, 0.0, pose.yaw_rate, 0.0)
            return errors, self.controller.steer(errors, pose.speed)
        self._driven += pose.speed * self._period
        tracked = [(share, self._track(fit, pose)) for share, fit in self._trajectories]
        errors = tracked[0][1] if len(tracked) == 1 else mean_errors(tracked)
        corrected = self._rejoining.corrected(now, errors, pose.speed)
        if len(tracked) == 1:
            return errors, self.controller.steer(corrected, pose.speed)
        command = SteeringCommand(0.0, 0.0, 0.0)
        for share, one in tracked:
            one.lateral += corrected.lateral - errors.lateral
            one.heading += corrected.heading - errors.heading
            steering = self.controller.steer(one, pose.speed)
            command.steering += share * steering.steering
            command.feedforward += share * steering.feedforward
            command.feedback += share * steering.feedback
        return errors, command

    def _extrapolate(self, speed: float) -> None:
        """Extend the last trajectories of Section III-A, whose samples now end behind the car."""
        length, bend = FADE_TIME * max(speed, SLOWEST_FADE), self.sources.bend
        self._trajectories = tuple(
            [
                (share, replace(fit, spline=fit.spline.fading(length, bend)))
                for share, fit in self._trajectories
            ]
        )

    def _track(self, fit: Fit, pose: Pose) -> TrackingErrors:
        """Errors along a trajectory; blended sources each have their own path behind."""
        errors = track(fit.spline, pose)
        place = fit.source.item(0) if getattr(self.fusion, "separate", False) else 0
        behind = self._behind.get(place)
        if behind is None:
            behind = self._behind[place] = PathBehind()
        behind.extend(self._driven, errors)
        errors.behind = behind
        return errors

    def _vehicles_ahead(
        self, now: int, pose: Pose, errors: TrackingErrors, margin: float
    ) -> VehiclesAhead:
        """Motion of the longitudinal sources, and of the predecessor if it is received.

        Those of lead and predecessor are predicted to now; spacings are reduced by a `margin` (m).
        Behind a predecessor that has left, which a human drives on, the spacing to the next vehicle
        ahead is reduced by that of the predecessor to it, so that its position stays free.
        """
        sources = self.sources
        ahead = VehiclesAhead(curvature_ahead=errors.curvature_ahead, own=self._own)
        ahead.bend = sources.bend_limit(pose)
        if self._measured is not None:
            ahead.measured_gap, ahead.measured_gap_rate = self._measured.at(now)
        lead, predecessor, place = sources.lead, sources.predecessor, 0.0
        if lead is not None and lead in sources.longitudinal and not isnan(lead.state.age):
            _, ahead.lead_speed, ahead.lead_acceleration = lead.state.predicted()
        if predecessor is not None:
            place, state = sources.place_of_left(pose.speed), predecessor.state
            if isnan(state.age):
                return ahead
            driven, ahead.predecessor_speed, ahead.predecessor_acceleration = state.predicted()
            ahead.spacing = state.spacing + driven - margin - place
        ahead.sources = {
            source.name: source.state
            for source in sources.longitudinal
            if not isnan(source.state.spacing)
        }
        if place and predecessor is not None and predecessor.name in ahead.sources:
            left = replace(predecessor.state, spacing=predecessor.state.spacing - place)
            ahead.sources[sources.own_predecessor] = left
        return ahead

    def _advance_own(self, now: int, speed: float, last: Decision | None) -> None:
        """Motion of the car at the control instant `now` (ns), for the longitudinal controller."""
        if last is not None:
            achieved = last.achieved_at(now, self.drive_lag) if speed > 0.0 else 0.0
            step = (now - self._decided_at) / SECOND
            self._own = OwnMotion(step, last.actuation.acceleration, achieved)
        self._decided_at = now


def mean_errors(parts: Sequence[tuple[float, TrackingErrors]]) -> TrackingErrors:
    """Mean of the errors along several trajectories, weighted by their shares."""
    errors = TrackingErrors(0.0, 0.0, 0.0, 0.0)
    for share, one in parts:
        errors.lateral += share * one.lateral
        errors.heading += share * one.heading
        errors.yaw_rate += share * one.yaw_rate
        errors.curvature += share * one.curvature
    return errors
