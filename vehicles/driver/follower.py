"""A follower fuses the poses received from lead and predecessor and steers along the result."""

from collections.abc import Sequence
from dataclasses import replace
from math import isnan, nan

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix, from_message
from vehicles.car.imu import Motion
from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.decision import Decision
from vehicles.driver.degradation.longitudinal import SpeedGuard
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import Situation, SourceFreshness
from vehicles.driver.ego.own_state import OwnState, Pose
from vehicles.driver.ego.slip_estimator import LoadWatch
from vehicles.driver.speed import SpeedLaw, VehiclesAhead
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import TrackingErrors, track
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import GpsPose, Mode
from vehicles.preview.trace import Trace, Window
from vehicles.preview.trajectory import Fit, FitSettings, Fusion, fuse
from vehicles.schedule import MILLISECOND, SECOND, Cadence, Timer

REFIT_AFTER = 50 * MILLISECOND
"""Without new poses the trajectory is fitted again this often (ns), so that a source that stopped
sending is noticed."""
LEAST_SAMPLES = 3
"""Fewer samples of a source than these determine no trajectory."""


class Follower:
    """Steers along the composite trajectory of its sources (paper, Section III).

    When a source stops sending, its last samples come to lie behind the ego, and the other source
    alone is followed; when both have stopped, the last trajectory is extrapolated.
    """

    def __init__(
        self,
        *,
        own_state: OwnState,
        controller: LateralController,
        speed_law: SpeedLaw,
        control: Cadence,
        plane: LocalPlane,
        lead: str,
        predecessor: str,
        alpha: float,
        fusion: Fusion,
        settings: FitSettings,
        limit: CommandLimit | None = None,
        load: LoadWatch | None = None,
        guard: SpeedGuard | None = None,
    ) -> None:
        """`alpha` in [0, 1] is the weight of the predecessor, 1 - alpha that of the lead.

        `limit` is that of the steering command, `load` watches how heavily the car is laden, and
        `guard` decides the speed, by the law or otherwise, if there are such.
        """
        self._own_state = own_state
        self._controller = controller
        self._speed_law = speed_law
        self._guard = guard
        self._told: dict[str, GpsPose] = {}
        self._control = control
        self._plane = plane
        self._lead = lead
        self._predecessor = predecessor
        self._alpha = alpha
        # The first follower's predecessor is the lead: one source, whatever the fusion.
        self._fusion: Fusion = "composite" if lead == predecessor else fusion
        self._settings = settings
        self._limit = limit or CommandLimit()
        self._load = load or LoadWatch()
        self._traces = {name: Trace() for name in (lead, predecessor)}
        self._sources = (predecessor,) if self._fusion == "predecessor" else tuple(self._traces)
        self._along: tuple[tuple[float, Fit], ...] = ()
        self._mode: Mode = "straight"
        self._reason = ""
        self._refit = Timer(REFIT_AFTER)
        self._gap, self._gap_at = nan, 0
        self._decision: Decision | None = None

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[GpsPose],
    ) -> Decision:
        """Decide at `now` (ns); between control instants the last decision is held.

        Sections III-A to III-E in a row, as in Fig. 1.
        """
        self._load.observe(now, motion)
        self._own_state.update(now, fix, motion)
        for message in received:
            self._receive(now, message)
        if self._decision is not None and not self._control.due(now):
            return replace(self._decision, fresh=False)
        self._decision = self._decide(now, self._own_state.at(now))
        return self._decision

    def _receive(self, now: int, message: GpsPose) -> None:
        fix = from_message(message, self._plane)
        trace = self._traces[message.vehicle]
        trace.add(fix.measured_at, fix.east, fix.north, fix.yaw, fix.speed)
        if trace.newest_at == fix.measured_at:
            self._told[message.vehicle] = message
        if not trace.joined:
            pose = self._own_state.at(now)
            trace.bridge(pose.east, pose.north)
        self._refit.due_at = now

    def _decide(self, now: int, pose: Pose) -> Decision:
        refit = self._refit.is_due(now)
        if refit:
            self._mode, self._reason = self._choose_trajectory(now, pose)
            self._gap, self._gap_at = self._measured_gap(now, pose), now
        errors, asked = self._steer(pose)
        steering = self._limit.held_back(asked)
        ahead = self._vehicles_ahead(now, pose)
        ahead.curvature_ahead = errors.curvature_ahead
        self._load.commanded(steering.steering)
        situation = self._situation(now)
        if self._guard is None:
            speed = self._speed_law.command(now, pose, ahead)
        else:
            speed = self._guard.command(now, pose, ahead, situation, self._mode)
        return Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode=self._mode,
            reason=self._reason,
            fit=self._along[0][1] if refit and self._along and self._mode != "coast" else None,
            target_speed=speed.target_speed,
            gap=ahead.gap,
            situation=situation,
        )

    def _choose_trajectory(self, now: int, pose: Pose) -> tuple[Mode, str]:
        """Fit the received samples; without enough of them keep the last trajectory."""
        windows = {name: self._window(name, pose) for name in self._sources}
        usable = [name for name, window in windows.items() if window is not None]
        along = fuse(
            self._fusion,
            windows.get(self._lead),
            None if self._predecessor == self._lead else windows[self._predecessor],
            alpha=self._alpha,
            settings=self._settings,
        )
        self._along = along or self._along
        reason = self._silence(now, [name for name in windows if name not in usable])
        if not self._along:
            return "straight", "nothing heard yet"
        if not along:
            return "coast", reason
        if len(usable) > 1:
            return "composite", reason
        return ("lead" if usable == [self._lead] else "predecessor"), reason

    def _window(self, name: str, pose: Pose) -> Window | None:
        """Samples of a source around the ego, None if they do not reach ahead of it."""
        settings = self._settings
        window = self._traces[name].window(
            pose.east, pose.north, settings.behind(pose.speed), settings.ahead(pose.speed)
        )
        enough = len(window.station) >= LEAST_SAMPLES and window.station[-1] >= 0.0
        return window if enough else None

    def _silence(self, now: int, missing: Sequence[str]) -> str:
        """The sources missing from the trajectory, in words."""
        ages = [(name, self._age(now, name)) for name in missing]
        return ", ".join(
            f"{name} never heard" if isnan(age) else f"{name} unheard for {age:.1f} s"
            for name, age in ages
        )

    def _steer(self, pose: Pose) -> tuple[TrackingErrors, SteeringCommand]:
        """Errors and command along each trajectory, blended by their shares."""
        if not self._along:
            errors = TrackingErrors(0.0, 0.0, pose.yaw_rate, 0.0)
            return errors, self._controller.steer(errors, pose.speed)
        tracked = [(share, track(fit.spline, pose)) for share, fit in self._along]
        if len(tracked) == 1:
            errors = tracked[0][1]
            return errors, self._controller.steer(errors, pose.speed)
        commands = [(share, self._controller.steer(e, pose.speed)) for share, e in tracked]
        return (
            TrackingErrors(
                lateral=sum(share * e.lateral for share, e in tracked),
                heading=sum(share * e.heading for share, e in tracked),
                yaw_rate=sum(share * e.yaw_rate for share, e in tracked),
                curvature=sum(share * e.curvature for share, e in tracked),
            ),
            SteeringCommand(
                steering=sum(share * c.steering for share, c in commands),
                feedforward=sum(share * c.feedforward for share, c in commands),
                feedback=sum(share * c.feedback for share, c in commands),
            ),
        )

    def _measured_gap(self, now: int, pose: Pose) -> float:
        """Gap (m) from the predecessor's last received place and speed; or NaN."""
        predecessor = self._traces[self._predecessor]
        gap = predecessor.gap(pose.east, pose.north)
        if gap is None or predecessor.newest is None:
            return nan
        return gap + predecessor.newest.speed * self._age(now, self._predecessor)

    def _vehicles_ahead(self, now: int, pose: Pose) -> VehiclesAhead:
        """State of the vehicles ahead, extrapolated to now."""
        lead, predecessor = self._traces[self._lead].newest, self._traces[self._predecessor].newest
        if predecessor is None:
            return VehiclesAhead()
        opened = (predecessor.speed - pose.speed) * (now - self._gap_at) / SECOND
        return VehiclesAhead(
            gap=self._gap + opened,
            predecessor_speed=predecessor.speed,
            lead_speed=nan if lead is None else lead.speed,
        )

    def _situation(self, now: int) -> Situation:
        """What is known of both sources, and what they announced."""
        return Situation(
            lead=self._freshness(now, self._lead),
            predecessor=self._freshness(now, self._predecessor),
        )

    def _freshness(self, now: int, name: str) -> SourceFreshness:
        age, told = self._age(now, name), self._told.get(name)
        if told is None:
            return SourceFreshness(age=age)
        return SourceFreshness(
            status="lost" if age > DegradationSettings().lost_after else "fresh",
            age=age,
            mode=told.mode,
            hazard=told.hazard,
            acceleration=told.acceleration_mps2,
        )

    def _age(self, now: int, name: str) -> float:
        """Time (s) since the newest sample of a source was measured, NaN before the first."""
        newest_at = self._traces[name].newest_at
        return nan if newest_at is None else (now - newest_at) / SECOND
