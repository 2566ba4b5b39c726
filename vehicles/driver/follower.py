"""A follower fuses the poses received from lead and predecessor and steers along the result.

Each tick updates the own state, checks received poses and adds them to their source (`sources`),
refits the trajectory if poses arrived (`_fit`), and derives the mode from the freshness of the
sources (`modes`), the steering from the errors against the trajectory (`_steer`), and the speed
from the vehicles ahead (`speed_guard`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isnan, nan
from typing import Final

from vehicles.car.dynamics import Actuation, Body, achieved_acceleration
from vehicles.car.gnss import Fix
from vehicles.car.sensors.gap_sensor import GapMeasurement
from vehicles.car.sensors.imu import Motion
from vehicles.driver.bends import BendsAhead
from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.decision import Decision
from vehicles.driver.degradation.innovation_gate import InnovationGate
from vehicles.driver.degradation.intended_path import path_offset
from vehicles.driver.degradation.modes import (
    ModeMachine,
    Modes,
    ModesByReach,
)
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import SLOWING, Situation, SourceFreshness
from vehicles.driver.degradation.source import Source
from vehicles.driver.degradation.sources import SourcePair
from vehicles.driver.degradation.speed_guard import SpeedGuard
from vehicles.driver.degradation.trust import Trust
from vehicles.driver.ego.own_state import OwnState, Pose
from vehicles.driver.ego.slip_estimator import LoadWatch
from vehicles.driver.longitudinal.controller import OwnMotion, SourceMotion, VehiclesAhead
from vehicles.driver.position_limit import PositionLimit
from vehicles.driver.reactions import ReactionPolicy
from vehicles.driver.speed import SpeedCommand
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import PathBehind, Rejoining, TrackingErrors, track
from vehicles.messages import Mode
from vehicles.preview.curve_fit import MIN_WEIGHT_FOR_NOISE, FitSettings
from vehicles.preview.fusion import CompositeFusion, SourceFusion
from vehicles.preview.received.samples import Window
from vehicles.preview.trajectory import Fit
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import MILLISECOND, SECOND, Cadence, Timer

REFIT_AFTER: Final = 50 * MILLISECOND
"""Period (ns) of refits without new poses, so that a source that stopped sending is noticed."""
JUST_BEGUN: Final = 3
"""Up to this number of samples beyond the initial bridge make no bend: their offset from its line
may be noise of the sample at which the bridge ends."""

FADE_TIME: Final = 1.0
"""Driving time (s) over which the curvature fades to zero beyond the last samples."""
SLOWEST_FADE: Final = 1.0
"""The fade of slower cars is that of this speed (m/s)."""


class Follower:
    """Steers along the composite trajectory of its sources (paper, Section III).

    When a source stops sending, the other one alone is followed. When both have stopped, the last
    trajectory is kept, and the car slows down and stops, or reacts as configured.
    """

    def __init__(
        self,
        *,
        own_state: OwnState,
        controller: LateralController,
        speed_guard: SpeedGuard,
        control: Cadence,
        lead: str,
        predecessor: str,
        least_spacing: float,
        periods: Mapping[str, float],
        delays: Mapping[str, float] | None = None,
        alpha: float,
        fusion: SourceFusion,
        settings: FitSettings,
        degradation: DegradationSettings,
        reaction: ReactionPolicy,
        limit: CommandLimit | None = None,
        load: LoadWatch | None = None,
        gates: Mapping[str, InnovationGate] | None = None,
        bends: Mapping[str, BendsAhead] | None = None,
        drive_lag: float,
    ) -> None:
        """`alpha` in [0, 1] is the weight of the predecessor, 1 - alpha that of the lead.

        `periods` (s) between messages, `delays` (s) of the first message and `gates` are by source;
        without a gate only jumps are refused. `bends` by source limit the speed. `least_spacing`
        (m) to the predecessor is that at which the bumpers touch. `drive_lag` (s) is the car's.
        """
        self._drive_lag = drive_lag
        self._own_state = own_state
        self._controller = controller
        self._speed_guard = speed_guard
        self._control = control
        self._least_spacing = least_spacing
        self._rate_hz, self._period = control.rate_hz, 1.0 / control.rate_hz
        self._alpha = alpha
        # The first follower's predecessor is the lead: one source, whatever the fusion.
        self._fusion: SourceFusion = CompositeFusion() if lead == predecessor else fusion
        self._settings = settings
        self._stated_noise = settings.with_stated_noise()
        self._cautious, self._line_only = settings.cautious(), settings.line_only()
        self._limit = limit or CommandLimit()
        self._load = load or LoadWatch()
        self._position_limit = PositionLimit(degradation)
        self._bends = bends or {}
        self._remarks: list[str] = []
        delays, gates = delays or {}, gates or {}
        named = {
            name: Source(
                name,
                periods[name],
                degradation,
                delays.get(name, 0.0),
                Trust(name, gates.get(name), self._remarks),
            )
            for name in (lead, predecessor)
        }
        self._sources = SourcePair(
            named[lead], named[predecessor], degradation, uses_lead=fusion.uses_lead
        )
        self._degrades = degradation.reaction == "degrade"
        self._reaction = reaction
        self._modes: Modes = ModesByReach()
        if self._degrades:
            self._modes = ModeMachine(degradation)
        self._trajectories: tuple[tuple[float, Fit], ...] = ()
        self._driven = 0.0
        self._behind = PathBehind(), PathBehind()
        self._fitted = False
        self._stops_behind = False
        self._rejoining = Rejoining(self._remarks, enabled=self._degrades)
        self._mode: Mode = "straight"
        self._refit = Timer(REFIT_AFTER)
        self._spacings: dict[str, float] = {}
        self._spacings_at = 0
        self._own = OwnMotion()
        self._measured: GapMeasurement | None = None
        self._decided_at = 0
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
        self._load.observe(now, motion)
        self._own_state.update(now, fix, motion)
        if gap is not None:
            self._measured = gap
        for pose in received:
            trace = self._sources.receive(pose)
            bends = self._bends.get(pose.message.vehicle)
            if bends is not None and trace.newest is pose:  # accepted
                bends.add(pose)
            if pose.message.vehicle == self._sources.predecessor.name:
                self._position_limit.predecessor_accuracy = pose.message.position_accuracy_m
            if not trace.joined:
                own = self._own_state.at(now)
                trace.bridge(own.east, own.north, own.yaw)
            self._refit.due_at = now
        if self._decision is not None and not self._control.due(now):
            self._decision = self._decision.held()
        else:
            self._decision = self._decide(now, self._own_state.at(now))
        if fix is not None:
            self._decision.path_offset = (
                path_offset(self._trajectories[0][1], fix) if self._trajectories else nan
            )
        return self._decision

    def _decide(self, now: int, pose: Pose) -> Decision:
        last, sources = self._decision, self._sources
        self._advance_own(now, pose)
        refit = self._refit.is_due(now)
        if refit:
            self._fit(now, pose)
        acceleration = last.actuation.acceleration if last else 0.0
        situation = sources.assess(now, pose, acceleration, refit=refit)
        self._mode, reason = self._modes.decide(
            now,
            sources,
            situation,
            pose.speed,
            fitted=self._fitted,
            has_path=bool(self._trajectories),
        )
        sources.steer_along(self._mode, self._period)
        errors, command = self._steer(now, pose)
        held = last.steering if last else command
        command = self._reaction.steering(self._mode, command, held)
        steering = self._limit.limited(command)
        self._position_limit.observe(self._own_state.lateral_deviation)
        margin = self._position_limit.gap_margin(self._period)
        ahead = self._vehicles_ahead(now, pose, errors, margin)
        self._load.record_command(steering.steering)
        situation.predecessor_weight = sources.alpha(self._alpha)
        situation.hazard = self._mode == "stop" or self._rejoining.is_active
        self._speed_guard.is_slowed = self._position_limit.is_active
        situation.speed_limit = min(situation.speed_limit, self._rejoining.speed_limit)
        speed = self._speed_guard.command(now, pose, ahead, situation, self._mode)
        speed = self._position_limit.limited(speed, pose.speed, acceleration, self._period)
        wanted = self._reaction.acceleration(situation, self._mode, pose.speed, speed.acceleration)
        if wanted != speed.acceleration:
            speed = SpeedCommand(wanted, min(speed.target_speed, pose.speed))
        situation.stops_at = sources.stops_at(self._mode, self._speed_guard.brakes_at)
        self._log_stop(situation)
        remarks: tuple[str, ...] = ()
        if self._remarks:
            remarks = tuple(self._remarks)
            self._remarks.clear()
        return Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode=self._mode,
            reason=self._position_limit.joined(reason),
            fit=self._trajectories[0][1] if refit and self._fitted else None,
            target_speed=speed.target_speed,
            estimated_gap=ahead.spacing + margin - self._least_spacing,
            lateral_deviation=self._own_state.lateral_deviation,
            measured_gap=ahead.measured_gap,
            measured_gap_rate=ahead.measured_gap_rate,
            own_pose=pose,
            situation=situation,
            remarks=remarks,
        )

    def _log_stop(self, situation: Situation) -> None:
        before, self._stops_behind = self._stops_behind, self._speed_guard.stops_behind
        if self._stops_behind and not before:
            source = self._sources.predecessor
            event = "may have stopped" if source.stop_is_assumed else "announced a stop"
            silence = situation.predecessor.silence
            self._remarks.append(f"braking: {source.name} {event}, last pose {silence:.2f} s ago")

    def _fit(self, now: int, pose: Pose) -> None:
        """Fit the received samples; if there are too few keep the last trajectory."""
        degrades = self._degrades
        slowing = degrades and self._mode in SLOWING
        runs_out = slowing or (degrades and self._sources.path_runs_out)
        windows = self._sources.windows(pose, self._settings, runs_out=runs_out)
        along = tuple(
            self._fusion.fuse(
                windows.get("lead"),
                windows.get("predecessor"),
                self._sources.alpha(self._alpha),
                self._settings_for(windows),
            )
        )
        if degrades and self._fitted and not along:
            self._extrapolate(pose.speed)
        self._fitted = bool(along)
        self._trajectories = along or self._trajectories
        self._measure_spacings(pose)
        self._spacings_at = now

    def _settings_for(self, windows: Mapping[Mode, Window]) -> FitSettings:
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
        behind = self._behind[fit.source.item(0) if self._fusion.separate else 0]
        behind.extend(self._driven, errors)
        errors.behind = behind
        return errors

    def _measure_spacings(self, pose: Pose) -> None:
        """Spacings (m) to the newest poses of the sources."""
        for source in self._sources.all.values():
            spacing = source.trace.spacing(pose.east, pose.north)
            if spacing is not None:
                self._spacings[source.name] = spacing

    def _vehicles_ahead(
        self, now: int, pose: Pose, errors: TrackingErrors, margin: float
    ) -> VehiclesAhead:
        """Motion of the vehicles ahead, each predicted by its last announced acceleration.

        The spacing is reduced by a `margin` (m).
        """
        lead, predecessor = self._sources.lead.freshness, self._sources.predecessor.freshness
        gap = gap_rate = gap_age = nan
        if self._measured is not None:
            gap, gap_rate, gap_age = self._measured.at(now)
        if isnan(predecessor.age):
            return VehiclesAhead(
                curvature_ahead=errors.curvature_ahead,
                bend=self._bend(pose),
                measured_gap=gap,
                measured_gap_rate=gap_rate,
                measured_gap_age=gap_age,
            )
        driven, speed, acceleration = predecessor.predicted_motion()
        closed = pose.speed * (now - self._spacings_at) / SECOND
        lead_speed = lead_acceleration = nan
        if not isnan(lead.age):
            _, lead_speed, lead_acceleration = lead.predicted_motion()
        return VehiclesAhead(
            self._spacings.get(self._sources.predecessor.name, nan) + driven - closed - margin,
            speed,
            lead_speed,
            acceleration,
            lead_acceleration,
            errors.curvature_ahead,
            self._bend(pose),
            self._own,
            {
                name: _motion(source.freshness, self._spacings[name] - closed)
                for name, source in self._sources.all.items()
                if name in self._spacings
            },
            gap,
            gap_rate,
            gap_age,
        )

    def _advance_own(self, now: int, pose: Pose) -> None:
        """Motion of the car at the control instant `now` (ns), for the longitudinal controller."""
        step = (now - self._decided_at) / SECOND if self._decided_at else 0.0
        self._decided_at = now
        last = self._decision
        command = last.actuation.acceleration if last else 0.0
        self._own = OwnMotion(
            step,
            command,
            self._own.distance + pose.speed * step,
            achieved_acceleration(self._own.achieved, command, step, self._drive_lag),
        )

    def _bend(self, pose: Pose) -> tuple[float, float] | None:
        """Bend of the received path that allows the lowest speed now (see `BendsAhead`)."""
        lowest: tuple[float, float] | None = None
        for bends in self._bends.values():
            bend = bends.allowed(pose.east, pose.north)
            if bend is not None and (lowest is None or bend[0] < lowest[0]):
                lowest = bend
        return lowest


def _motion(freshness: SourceFreshness, spacing: float) -> SourceMotion:
    return SourceMotion(spacing, freshness.speed, freshness.acceleration, freshness.age)


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
