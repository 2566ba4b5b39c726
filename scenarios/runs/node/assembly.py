"""Builds one vehicle from its part of the scenario."""

from collections.abc import Hashable, Iterator
from functools import partial
from math import cos, sin

import numpy as np

from scenarios.definition.changing.concerned import concerns
from scenarios.definition.changing.links import EffectsOf
from scenarios.definition.channel.build import link_effects
from scenarios.definition.channel.content import content_stage
from scenarios.definition.channel.delay import link_stages
from scenarios.definition.channel.radio import vehicles_between
from scenarios.definition.receivers import assumed_deviation
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.changes import AnyChange
from scenarios.definition.sending import (
    even_rate_hz,
    highest_rate_hz,
    link_rate_hz,
    usual_rate_hz,
)
from scenarios.runs.node.agenda import Agenda, scheduled
from scenarios.runs.node.changed_links import ChangedLinks, ChangingLink
from scenarios.runs.node.changes import Changes
from scenarios.runs.node.node import Handover, Node
from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.phases import Aboard, ByHand, Car, Down, Driving, Software, VehiclePhase
from scenarios.runs.node.probe import Probe
from scenarios.runs.node.replayed import ReplayedNode
from scenarios.runs.node.signals import instants_besides, make_receiver, make_sender
from scenarios.runs.node.sink import Sink
from transport.clock import Tick, ticks
from transport.links.gate import PoseGate
from transport.links.inbox import Inbox, IncomingLink
from transport.links.laws.radio.obstruction import VehiclesBetween
from transport.links.link import Link
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import ExactSensor, InertialSensor
from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.decision import Driver
from vehicles.driver.degradation.slowing.longitudinal import GuardedCar, SpeedGuard
from vehicles.driver.degradation.slowing.waiting import ConvoyWatch, WaitingProfile
from vehicles.driver.degradation.trust.beliefs import Beliefs
from vehicles.driver.degradation.trust.gate import InnovationGate
from vehicles.driver.ego.late_fixes import LatePoseEstimator
from vehicles.driver.ego.own_state import KnownState, OwnState
from vehicles.driver.ego.pose_estimator import PoseEstimator
from vehicles.driver.ego.slip_estimator import Assuming, LoadWatch, SlipEstimator
from vehicles.driver.follower import Follower
from vehicles.driver.leader import Leader
from vehicles.driver.speed import GapKeeping, GapPolicy, ProfileSpeed, SpeedLaw
from vehicles.driver.steering import LateralController, load_controller
from vehicles.geometry.geodesy import LocalPlane, wrap_angle
from vehicles.preview.trajectory import FitSettings
from vehicles.schedule import MILLISECOND, SECOND, Cadence

INERTIAL = 1
"""Tells the random stream of a vehicle's inertial sensor from that of its receiver."""
SOUGHT = 100.0
"""How far from where it is expected by the way driven a car is sought on the road (m)."""


class VehicleBuilder:
    """Builds one vehicle of a scenario as a node, once the start instant is known."""

    def __init__(self, scenario: Scenario, name: str) -> None:
        """Raises ScenarioError if `scenario` has no vehicle called `name`."""
        self.name = name
        self._scenario = scenario
        self._setup = scenario.vehicle(name)
        self._plane = LocalPlane(scenario.origin)
        self._route = scenario.route
        self._changed = ChangedLinks(scenario.vehicle_names, ())
        self.duration_ns = round(scenario.duration_s * SECOND)
        self.control_rate_hz = scenario.control_rate_hz
        rates_hz = [scenario.control_rate_hz, self._setup.gnss.rate_hz]
        if not self._setup.knows_itself:
            rates_hz.append(self._setup.imu_rate_hz)  # usually that of control
        self.rates_hz = tuple(dict.fromkeys(rates_hz))

    @property
    def scenario(self) -> Scenario:
        """The scenario of which the vehicle is one."""
        return self._scenario

    @property
    def schedule(self) -> Hashable:
        """Vehicles for which this is equal have equal ticks."""
        besides = instants_besides(self._scenario, self._setup, 0, 0)
        return (self.rates_hz, self.name) if besides else self.rates_hz

    def ticks(self, start_at: int) -> Iterator[Tick]:
        """The vehicle's schedule from `start_at` (ns) to the end of the run."""
        end_at = start_at + self.duration_ns
        besides = instants_besides(self._scenario, self._setup, start_at, end_at)
        return ticks(start_at, end_at, *self.rates_hz, besides=besides)

    def node(
        self, start_at: int, sink: Sink, probe: Probe, handover: Handover | None = None
    ) -> Node | ReplayedNode:
        """The vehicle as a node that starts at `start_at` (ns) and sends its messages to `sink`.

        With a `handover` it is one whose process ended in a crash, and goes on from there.
        """
        setup, drive = self._setup, self._scenario.replays.get(self.name)
        coming = scheduled(self._scenario.tables.change, start_at, self.concerns)
        by_hand = handover.changed_links if handover else ()
        self._changed = ChangedLinks(self._scenario.vehicle_names, coming, by_hand)
        clock = self._scenario.clock(self.name, start_at)
        inbox = Inbox(
            self.name,
            self.links(start_at),
            start_at=start_at,
            before=handover.inbox if handover else None,
        )
        outbox = Outbox(
            vehicle=self.name,
            sink=sink,
            plane=self._plane,
            parameters=setup.parameters,
            inbox=inbox,
            probe=probe,
            start_at=start_at,
            clock=clock,
            state=handover.outbox if handover else None,
        )
        control = Cadence(start_at, self.control_rate_hz)
        if drive is not None:
            return ReplayedNode(
                drive=drive,
                start_at=start_at,
                wheelbase=setup.parameters.wheelbase,
                control=control,
                gnss=make_receiver(self._scenario, setup, start_at),
                sender=make_sender(self._scenario, setup, start_at),
                inbox=inbox,
                outbox=outbox,
                agenda=Agenda(coming),
            )
        aboard = Aboard(
            start_at=start_at,
            car=handover.car if handover else self._car(start_at),
            clock=clock,
            control=control,
            plan=handover.plan if handover else self._route.plan,
            inbox=inbox,
            outbox=outbox,
            workshop=self,
        )
        if handover is not None:
            changes = Changes(Agenda(handover.pending), self._changed)
            return Node(aboard, changes, Down(aboard, handover.until))
        changes = Changes(Agenda(coming), self._changed)
        return Node(aboard, changes, self._first_phase(aboard))

    def _first_phase(self, aboard: Aboard) -> VehiclePhase:
        """Driven by its software, or by a human until it joins."""
        if self._scenario.joins_late(self.name):
            return ByHand(aboard, aboard.start_at)
        start_at = aboard.start_at
        return Driving(aboard, self._software(start_at, aboard, set_off=False))

    def concerns(self, change: AnyChange) -> bool:
        """Whether this vehicle carries a change out."""
        return concerns(change, self.name, self._scenario.tables, self._scenario.links)

    @property
    def _drives_a_profile(self) -> bool:
        return self._scenario.tables.speed.followers == "same"

    def _car(self, start_at: int) -> Car:
        return Car(
            body=self._body(),
            parameters=self._setup.parameters,
            gnss=make_receiver(self._scenario, self._setup, start_at),
            imu=self._imu(start_at),
            command=Actuation(0.0, 0.0),
        )

    def station(self, body: Body) -> float:
        """Station (m) on the road at which a car is that has driven from its start."""
        expected = self._route.start_station(self._setup.place) + body.distance
        return self._route.path.project(body.east, body.north, expected, SOUGHT).station

    def links(self, start_at: int) -> list[IncomingLink]:
        """Links from all that it listens to, in a run from `start_at` (ns)."""
        senders = () if self.name in self._scenario.replays else self._setup.senders
        links = [self._incoming(sender, start_at) for sender in senders]
        self._changed.adopt(self._changing(one, start_at) for one in links)
        return links

    def software(self, now: int, aboard: Aboard) -> Software:
        """Software that starts at `now` (ns) without memory, but for where the car is.

        The receiver aboard knows its place all the time. A lead that stood is late: it drives its
        speed by where it is, not by when.
        """
        return self._software(now, aboard, set_off=self._setup.predecessor is None)

    def _software(self, now: int, aboard: Aboard, *, set_off: bool) -> Software:
        own = self._setup.predecessor is None or self._drives_a_profile
        law = self._own_profile(aboard.start_at) if own else None
        return Software(
            driver=self._driver(aboard, now, law or self._gap_keeping()),
            sender=make_sender(self._scenario, self._setup, aboard.start_at),
            law=law,
            alone=set_off,
        )

    def human(self, aboard: Aboard) -> tuple[Driver, ProfileSpeed]:
        """A human who drives the road like the lead, and knows where he is."""
        law = self._profile(aboard.start_at)
        body = aboard.car.body
        return Leader(
            own_state=KnownState(),
            controller=self._controller(),
            speed_law=law,
            control=aboard.control,
            path=self._route.path,
            station=self.station(body),
            limit=self._command_limit(aboard.car),
        ), law

    def _changing(self, one: IncomingLink, start_at: int) -> ChangingLink:
        """A link that can be changed."""
        sender = one.link.sender
        asked = self._scenario.links[sender, self.name]
        return ChangingLink(one.link, asked, self._effects_of(sender, start_at))

    def _incoming(self, sender: str, start_at: int) -> IncomingLink:
        """The link from `sender`, and the gate that its poses pass."""
        scenario = self._scenario
        asked, setup = scenario.links[sender, self.name], scenario.vehicle(sender)
        rate_hz = highest_rate_hz(setup.sending, setup.gnss)
        effects = self._effects_of(sender, start_at)(asked, ())
        link = Link(effects, scenario.seed, sender, self.name, link_stages(asked))
        gate = PoseGate(
            sender=sender,
            start_at=start_at,
            rate_hz=rate_hz,
            plane=self._plane,
            clock_error_ns=scenario.clock_error_ns(sender),
        )
        return IncomingLink(link, gate, content_stage(asked.content, link, gate))

    def _effects_of(self, sender: str, start_at: int) -> EffectsOf:
        """What makes the effects of the link from `sender`, as it is or as it is changed."""
        setup = self._scenario.vehicle(sender)
        rate_hz = highest_rate_hz(setup.sending, setup.gnss)
        even_hz = even_rate_hz(setup.sending, setup.gnss) or rate_hz
        setting = self._scenario.link_setting(sender, self.name, start_at)
        between = partial(self._between, sender)
        return lambda asked, besides: link_effects(asked, even_hz, setting, between, besides)

    def _between(self, sender: str) -> VehiclesBetween:
        """Who drives between `sender` and this vehicle."""
        ahead = self._scenario.vehicle(sender).place
        return vehicles_between(self._route, ahead, self._setup.place)

    def _body(self) -> Body:
        """The car at its start: on the path its gap behind the one ahead, with its offsets."""
        setup = self._setup
        place = self._route.path.at(self._route.start_station(setup.place))
        aside = setup.lateral_offset_m
        return Body(
            east=place.east - aside * sin(place.yaw),
            north=place.north + aside * cos(place.yaw),
            yaw=place.yaw + setup.heading_offset_rad,
            speed=self._route.plan.profile.at(0.0)[0],
        )

    def _imu(self, start_at: int) -> InertialSensor | ExactSensor:
        if self._setup.knows_itself:
            return ExactSensor()
        # A stream apart from the receiver's, whose noise is the same with and without this sensor.
        words = [self._scenario.seed, self._setup.place, INERTIAL]
        random = np.random.Generator(np.random.PCG64(words))
        return InertialSensor(self._setup.imu_noise, self._setup.imu_rate_hz, start_at, random)

    def _own_state(self, now: int, aboard: Aboard) -> OwnState:
        """What tells the car where it is, from `now` (ns) on.

        Software that starts later than the run, or whose first fix may come late, is told where it
        starts; so is any other if it has to decide before its first fix.
        """
        setup, body = self._setup, aboard.car.body
        if setup.knows_itself:
            return KnownState()
        gnss = setup.gnss
        place = body.east, body.north, wrap_angle(body.yaw)
        start = Fix(0, now, *place, body.speed, body.yaw_rate)
        estimator = PoseEstimator(
            setup.assumed_parameters,
            setup.gnss_noise,
            setup.imu_noise,
            setup.imu_rate_hz,
            by_accuracy=True,
            start=start,
        )
        if gnss.is_punctual and now == aboard.start_at:
            return estimator
        estimator.correct(start)
        if not gnss.latency_ms:
            return estimator
        return LatePoseEstimator(estimator, round(gnss.latency_ms * MILLISECOND))

    def _driver(self, aboard: Aboard, now: int, speed_law: SpeedLaw) -> Driver:
        setup, control = self._setup, aboard.control
        own_state = self._own_state(now, aboard)
        controller = self._controller()
        load = self._load_watch(own_state, controller)
        if setup.predecessor is None:
            waiting = None
            if isinstance(speed_law, WaitingProfile):
                waiting = self._convoy_watch(now), speed_law
            return Leader(
                own_state=own_state,
                controller=controller,
                speed_law=speed_law,
                waiting=waiting,
                control=control,
                path=self._route.path,
                station=self.station(aboard.car.body),
                limit=self._command_limit(aboard.car),
                load=load,
            )
        steering = setup.steering
        return Follower(
            own_state=own_state,
            controller=controller,
            speed_guard=self._speed_guard(speed_law, setup.predecessor),
            control=control,
            plane=self._plane,
            lead=setup.lead,
            predecessor=setup.predecessor,
            periods={sender: self._least_period(sender) for sender in setup.senders},
            alpha=steering.alpha_ratio,
            fusion=steering.fusion,
            settings=self._fit_settings(),
            degradation=setup.degradation,
            limit=self._command_limit(aboard.car),
            load=load,
            beliefs=self._beliefs(),
        )

    def _beliefs(self) -> Beliefs:
        """Gates for the sources; the baselines of degradation believe everything, as they did."""
        asked = self._setup.steering.degradation
        if asked.reaction != "degrade":
            return Beliefs()
        return Beliefs(
            {
                name: InnovationGate(
                    self._scenario.vehicle(name).gnss_noise,
                    gate=asked.gate_deviations,
                    heading_gate=asked.heading_gate_deviations,
                    settle=asked.probation_s,
                )
                for name in self._setup.senders
            }
        )

    def _load_watch(self, *told: object) -> LoadWatch:
        """What tells those who can assume another car than they were made for."""
        setup = self._setup
        if not setup.steering.estimate_slip:
            return LoadWatch()
        noise = 0.0 if setup.knows_itself else setup.imu.yaw_rate_noise_radps
        estimator = SlipEstimator(setup.assumed_parameters, noise)
        return LoadWatch(estimator, [one for one in told if isinstance(one, Assuming)])

    def _command_limit(self, car: Car) -> CommandLimit:
        """Limit of a driver who takes over with the command that the car has."""
        limits = self._setup.parameters
        return CommandLimit(
            limits.steering_rate_limit,
            1.0 / self.control_rate_hz,
            limits.steering_limit,
            first=car.command.steering,
        )

    def _fit_settings(self) -> FitSettings:
        """The fit assumes the largest error of the receivers received from, at least that of RTK.

        Its tolerance is the scenario's, or five times that noise if that is more (the paper's
        10 cm are five times the 2 cm of RTK). That is the error in the worst state that a receiver
        can be in, without what all have in common; the fit finds out itself where it is smaller.
        """
        steering = self._setup.steering
        receivers = (self._scenario.vehicle(name).gnss for name in self._setup.senders)
        noise = max(FitSettings().position_noise, *map(assumed_deviation, receivers))
        return FitSettings(
            preview_time=steering.preview_s,
            tolerance=max(steering.tolerance_m, 5.0 * noise),
            position_noise=noise,
            trajectory=steering.trajectory,
        )

    def _controller(self) -> LateralController:
        setup = self._setup
        return load_controller(setup.controller, setup.assumed_parameters, setup.gains)

    def _own_profile(self, start_at: int) -> ProfileSpeed:
        """The planned speed, driven more slowly by a lead while it waits for a follower."""
        setup = self._setup
        if setup.predecessor is not None or not setup.senders:
            return self._profile(start_at)
        period, braking = 1.0 / self.control_rate_hz, setup.degradation.comfortable
        return WaitingProfile(self._route.plan.profile, start_at, period, braking)

    def _profile(self, start_at: int) -> ProfileSpeed:
        return ProfileSpeed(self._route.plan.profile, start_at, 1.0 / self.control_rate_hz)

    def _least_period(self, sender: str) -> float:
        """Shortest time (s) between two messages that can come from `sender`."""
        setup, link = self._scenario.vehicle(sender), self._scenario.links[sender, self.name]
        rate_hz = link_rate_hz(setup.sending, setup.gnss)
        return 1.0 / min(rate_hz, link.rate_hz or rate_hz)

    def _gap_keeping(self) -> SpeedLaw:
        return GapKeeping(self._scenario.gap_policy, self._scenario.gap_limits)

    def _speed_guard(self, law: SpeedLaw, predecessor: str) -> SpeedGuard:
        """Make what decides instead of `law` while messages fail.

        The car ahead is as long as this one: both bodies end half their length from their places.
        """
        scenario, setup = self._scenario, self._setup
        ahead = scenario.vehicle(predecessor)
        initial_gap = self._route.gaps[setup.place]
        common = scenario.tables.speed.followers == "same"
        car = GuardedCar(
            length=0.5 * (setup.parameters.length + ahead.parameters.length),
            friction=setup.parameters.friction,
            policy=GapPolicy(initial_gap) if common else scenario.gap_policy,
            limits=scenario.gap_limits,
            initial_gap=initial_gap,
            period=self._usual_period(predecessor),
        )
        return SpeedGuard(law, setup.degradation, car)

    def _convoy_watch(self, now: int) -> ConvoyWatch:
        """What watches over the followers, as far as they are listened to."""
        periods = {name: self._usual_period(name) for name in self._setup.senders}
        return ConvoyWatch(self._setup.degradation, periods, now)

    def _usual_period(self, sender: str) -> float:
        """Time (s) between messages of `sender` to expect, by its sending and its link."""
        setup, speed = self._scenario.vehicle(sender), self._route.profile.at(0.0)[0]
        rate_hz = usual_rate_hz(setup.sending, setup.gnss, speed) or 1.0
        return 1.0 / min(rate_hz, self._scenario.links[sender, self.name].rate_hz or rate_hz)
