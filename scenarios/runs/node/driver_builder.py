"""Builds the driver of a vehicle: its software, or a human."""

import math
from collections.abc import Sequence

from scenarios.definition.channel.build import usual_delay_ms
from scenarios.definition.road.route import spacing_policy, summed_spacing
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.point import InstantDraw
from scenarios.definition.topology import relays_stops
from scenarios.runs.node.phases import Car, Driver, VehicleContext
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_settings import stated_errors
from vehicles.driver.command_limit import CommandLimit, PositionLimit
from vehicles.driver.controller import SpacingPolicy
from vehicles.driver.convoy import ConvoyAhead, ConvoyWatch, MemberTrack
from vehicles.driver.follower import Follower
from vehicles.driver.leader import Leader, WaitingProfile
from vehicles.driver.own_state import ExactState
from vehicles.driver.pose_estimator import OwnState, PoseEstimator
from vehicles.driver.reactions import ReactionPolicy
from vehicles.driver.slip_estimator import LoadWatch, ParameterUser, SlipEstimator
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.driver.speed import BendsAhead, GapKeeping, ProfileSpeed, SpeedLaw
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.preview.curve_fit import FitSettings
from vehicles.schedule import MILLISECOND

SEARCH_RADIUS_M = 100.0
"""Distance (m) on the road within which a car is searched around its expected station."""


class DriverBuilder:
    """Builds the drivers of one vehicle, which start from the current state of its car."""

    def __init__(self, scenario: Scenario, name: str) -> None:
        """Raises ScenarioError if `scenario` has no vehicle called `name`."""
        self._name = name
        self._scenario = scenario
        self._setup = scenario.vehicle(name)
        self._route = scenario.route
        self.draw = InstantDraw(scenario.seed, name)

    def software(self, now: int, context: VehicleContext) -> tuple[Driver, ProfileSpeed | None]:
        """Driver that starts at `now` (ns) without memory, and its speed profile, if any."""
        self.draw.start_at = context.start_at
        own = self._setup.predecessor is None or self._scenario.tables.speed.followers == "same"
        law = self._own_profile(context.start_at) if own else None
        return self._driver(context, now, law or self._gap_keeping()), law

    def human(self, context: VehicleContext) -> tuple[Driver, ProfileSpeed]:
        """Human who drives the road like the lead, with the true position."""
        self.draw.start_at = context.start_at
        law = self._profile(context.start_at)
        body = context.car.body
        return Leader(
            own_state=ExactState(),
            controller=self._setup.controller(self.draw),
            speed_law=law,
            control=context.control,
            path=self._route.path,
            station=self.station(body),
            limit=self._command_limit(context.car),
            drive_lag=self._setup.assumed_parameters.drive_lag,
        ), law

    def station(self, body: Body) -> float:
        """Station (m) on the road of a car by its distance driven."""
        expected = self._route.start_station(self._setup.place) + body.distance
        return self._route.path.project(body.east, body.north, expected, SEARCH_RADIUS_M).station

    def _driver(self, context: VehicleContext, now: int, speed_law: SpeedLaw) -> Driver:
        setup, control = self._setup, context.control
        own_state = self._own_state(now, context)
        controller = self._setup.controller(self.draw)
        load = self._load_watch(own_state, controller)
        if setup.predecessor is None:
            speed = self._scenario.tables.speed
            return Leader(
                own_state=own_state,
                controller=controller,
                speed_law=speed_law,
                members=self._members(now, context.car.body),
                watch=ConvoyWatch(setup.degradation) if speed.lead_waits else None,
                ahead=self._convoy_ahead() if speed.lead_keeps_gap else None,
                position_limit=self._position_limit(),
                control=control,
                path=self._route.path,
                station=self.station(context.car.body),
                limit=self._command_limit(context.car),
                load=load,
                relays=self._relays(),
                drive_lag=setup.assumed_parameters.drive_lag,
            )
        steering, remarks = setup.steering, list[str]()
        reaction: ReactionPolicy = steering.degradation.reaction.build(draw=self.draw)
        guard = None  # nothing overrides the law with a baseline reaction
        if setup.degradation.reaction == "degrade":
            start = self._scenario.longitudinal_setup(self._name)
            guard = SpeedGuard(speed_law, setup.degradation, start)
        return Follower(
            own_state=own_state,
            controller=controller,
            speed_law=speed_law,
            guard=guard,
            control=control,
            sources=self._sources(setup.predecessor, remarks),
            least_spacing=self._scenario.least_spacings[setup.place],
            alpha=steering.alpha_ratio,
            fusion=steering.fusion.build(draw=self.draw),
            settings=self._fit_settings(),
            degradation=setup.degradation,
            reaction=reaction,
            limit=self._command_limit(context.car),
            load=load,
            drive_lag=setup.assumed_parameters.drive_lag,
            remarks=remarks,
        )

    def _sources(self, predecessor: str, remarks: list[str]) -> Sources:
        setup, scenario = self._setup, self._scenario
        kept = [scenario.kept_spacing(place) for place in range(len(scenario.vehicle_names))]
        return Sources(
            [self._source(sender, kept, remarks) for sender in setup.senders],
            setup.degradation,
            lead=setup.lead,
            predecessor=predecessor,
            lateral=setup.flow.lateral,
            longitudinal=setup.flow.longitudinal,
            relay=setup.place - 2,
        )

    def _source(self, sender: str, kept: Sequence[SpacingPolicy], remarks: list[str]) -> Source:
        """A source at its place: 0 of the lead, k of the k-th vehicle ahead, -k behind.

        Baselines only refuse impossible jumps. Bends limit the speed if friction is limited.
        """
        scenario, degradation = self._scenario, self._setup.degradation
        other, bends = scenario.vehicle(sender), None
        place = self._setup.place - other.place if other.place else 0
        lateral = scenario.usable_lateral(self._name)
        if place >= 0 and lateral < math.inf:
            bends = BendsAhead(lateral, scenario.gap_limits)
        return Source(
            sender,
            self._least_period(sender),
            degradation,
            place=place,
            delay=self._usual_delay(sender),
            lag=other.assumed_parameters.drive_lag,
            receiver=other.gnss if degradation.reaction == "degrade" else None,
            policy=summed_spacing(kept, other.place, self._setup.place),
            bends=bends,
            remarks=remarks,
        )

    def _relays(self) -> int:
        """Number of followers whose announced stops the lead repeats: all but the last."""
        return len(self._scenario.vehicle_names) - 2 if relays_stops(self._scenario.tables) else 0

    def _gap_keeping(self) -> GapKeeping:
        scenario, start = self._scenario, self._scenario.longitudinal_setup(self._name)
        controller = scenario.longitudinal_controller(self._name, start, self.draw)
        return GapKeeping(start, controller)

    def _own_state(self, now: int, context: VehicleContext) -> OwnState:
        """Estimator of the car's own state from `now` (ns) on.

        It starts from the true state if the software starts later than the run, or if the first
        fix may be late.
        """
        setup, body = self._setup, context.car.body
        if setup.has_exact_state:
            return ExactState()
        gnss = setup.gnss
        place = body.east, body.north, math.remainder(body.yaw, math.tau)
        start = Fix(0, now, *place, body.speed, body.yaw_rate)
        estimator = PoseEstimator(
            setup.assumed_parameters,
            gnss,
            setup.imu,
            setup.imu_rate_hz,
            stated=stated_errors(gnss),
            start=start,
            latency=gnss.latency,
        )
        if not gnss.has_fix_every_instant or now != context.start_at:
            estimator.begin(start)
        return estimator

    def _command_limit(self, car: Car) -> CommandLimit:
        limits = self._setup.parameters
        return CommandLimit(
            limits.steering_rate_limit,
            1.0 / self._scenario.control_rate_hz,
            limits.steering_limit,
            first=car.command.steering,
        )

    def _load_watch(self, *parts: object) -> LoadWatch:
        setup = self._setup
        if not setup.steering.estimate_slip:
            return LoadWatch()
        noise = 0.0 if setup.has_exact_state else setup.imu.yaw_rate_noise
        estimator = SlipEstimator(setup.assumed_parameters, noise)
        return LoadWatch(estimator, [part for part in parts if isinstance(part, ParameterUser)])

    def _fit_settings(self) -> FitSettings:
        """Settings of the fit by the largest assumed noise of the lateral sources' receivers.

        The tolerance is at least five times that noise, like the paper's 10 cm for 2 cm of RTK.
        """
        steering = self._setup.steering
        receivers = (self._scenario.vehicle(name).gnss for name in self._setup.flow.lateral)
        noise = max(
            FitSettings().position_noise, *(receiver.assumed_deviation for receiver in receivers)
        )
        return FitSettings(
            preview_time=steering.preview_s,
            tolerance=max(steering.tolerance_m, 5.0 * noise),
            position_noise=noise,
            trajectory=steering.trajectory,
        )

    def _own_profile(self, start_at: int) -> ProfileSpeed:
        """The planned speed, reduced while a lead waits or is uncertain of its position."""
        setup = self._setup
        slows = setup.senders or self._position_limit() is not None
        if setup.predecessor is not None or not slows:
            return self._profile(start_at)
        period, braking = 1.0 / self._scenario.control_rate_hz, setup.degradation.comfortable
        return WaitingProfile(self._route.plan.profile, start_at, period, braking)

    def _position_limit(self) -> PositionLimit | None:
        """Speed limit of a lead that is uncertain of its position, if all followers adapt to it.

        Followers at the common speed adapt only with the reaction "degrade".
        """
        if self._scenario.tables.speed.followers == "same":
            setups = [self._scenario.vehicle(name) for name in self._scenario.vehicle_names[1:]]
            if any(setup.degradation.reaction != "degrade" for setup in setups):
                return None
        return PositionLimit(self._setup.degradation)

    def _profile(self, start_at: int) -> ProfileSpeed:
        return ProfileSpeed(
            self._route.plan.profile, start_at, 1.0 / self._scenario.control_rate_hz
        )

    def _members(self, now: int, body: Body) -> list[MemberTrack]:
        """Received followers from front to back, at the initial spacings behind `body`."""
        station, members = self.station(body), list[MemberTrack]()
        for place, name in enumerate(self._setup.senders, 1):
            station -= self._route.spacings[place]
            member = MemberTrack(
                name=name,
                car=self._scenario.vehicle(name).parameters,
                period=self._usual_period(name),
                policy=self._scenario.kept_spacing(place),
                path=self._route.path,
                station=station,
                received_at=now,
            )
            members.append(member)
        return members

    def _convoy_ahead(self) -> ConvoyAhead | None:
        if not self._route.lap:
            return None
        return ConvoyAhead(
            lap=self._route.lap,
            car=self._setup.parameters,
            settings=self._setup.degradation,
            policy=spacing_policy(self._scenario.tables, 0.0),
            limits=self._scenario.gap_limits,
        )

    def _least_period(self, sender: str) -> float:
        """Shortest possible time (s) between two messages of `sender`."""
        setup, link = self._scenario.vehicle(sender), self._scenario.links[sender, self._name]
        rate_hz = setup.highest_rate_hz
        return 1.0 / min(rate_hz, link.rate_hz or rate_hz)

    def _usual_delay(self, sender: str) -> float:
        """Time (s) after its measurement within which most messages of `sender` arrive."""
        link = self._scenario.links[sender, self._name]
        latency_ms = self._scenario.vehicle(sender).gnss.latency / MILLISECOND
        return (latency_ms + usual_delay_ms(link)) / 1000.0

    def _usual_period(self, sender: str) -> float:
        """Expected time (s) between messages of `sender`, by its sending and its link."""
        setup, speed = self._scenario.vehicle(sender), self._route.profile.at(0.0)[0]
        rate_hz = setup.usual_rate_hz(speed) or 1.0
        return 1.0 / min(rate_hz, self._scenario.links[sender, self._name].rate_hz or rate_hz)
